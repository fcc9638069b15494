"""What drivers of moving parts share: a motion watched to its end, and strokes in whole steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from drivers.base import DeviceStoppedError, Driver, Report, after_acting, before_acting
from labweb.domain.errors import DeviceError, Effect, PreconditionError

POLL_S = 0.1
SLACK_S = 10.0
"""What ramps, backlash and a slow line may add to a motion."""

VALVE_S = 10.0
"""Longest time for a valve to turn."""

FULL_STROKE_S = 1200.0
"""Longest stroke that is accepted; the actions' time limit is longer."""

Progress = Callable[[], dict[str, Any] | None]
"""How far a cut-short motion came, as context of its error; None: nobody knows."""


class Mechanism(Protocol):
    """What a stroke needs of a pump that counts its plunger's steps."""

    def position(self) -> int:
        """Return the plunger's step, 0 when empty."""

    def port_index(self) -> int | None:
        """Return the selected port, None without a valve."""

    def is_idle(self) -> bool:
        """Tell whether nothing moves.

        Raises:
            DeviceError: The device reports a failure of the motion.
        """

    def knows_position(self) -> bool:
        """Tell whether the position is counted from a zero that was found."""


@dataclass(frozen=True, slots=True)
class SteppedPlunger:
    """A syringe driven in steps."""

    syringe_ul: float
    steps_full_count: int

    @property
    def ul_per_step(self) -> float:
        """Return the volume of one step, µL."""
        return self.syringe_ul / self.steps_full_count

    def volume_ul(self, steps: int) -> float:
        """Return the volume of so many steps."""
        return round(steps * self.ul_per_step, 3)

    def steps(self, volume_ul: float) -> int:
        """Return the whole steps nearest to a volume.

        Raises:
            PreconditionError: Less than one step, or more than the syringe holds.
        """
        steps = round(volume_ul / self.ul_per_step)
        if steps < 1:
            raise PreconditionError(
                f"{volume_ul:g} µL is less than one step of {self.ul_per_step:g} µL",
                code="device.volume_too_small",
            )
        if steps > self.steps_full_count:
            raise PreconditionError(
                f"{volume_ul:g} µL was asked for; the syringe holds {self.syringe_ul:g} µL",
                code="device.stroke_out_of_range",
            )
        return steps

    def check_target(self, target: int) -> None:
        """Refuse a step that the plunger cannot reach.

        Raises:
            PreconditionError: It lies outside the stroke.
        """
        if not 0 <= target <= self.steps_full_count:
            raise PreconditionError(
                f"the stroke would take the plunger to step {target}; "
                f"it goes from 0 to {self.steps_full_count}",
                code="device.stroke_out_of_range",
                context={"target_steps": target},
            )


def run_stroke(
    driver: Driver[Any, Any],
    plunger: SteppedPlunger,
    mechanism: Mechanism,
    *,
    steps: int,
    speed_steps_s: float,
    begin: Callable[[int], None],
) -> Report:
    """Move the plunger by steps, positive to draw in, and prove by its position what moved.

    Args:
        driver: The driver that acts; stopped, it ends the stroke.
        plunger: The syringe.
        mechanism: How to ask the pump.
        steps: Whole steps to move, never zero.
        speed_steps_s: Speed that was or will be set.
        begin: Sends the move to a step.

    Raises:
        PreconditionError: The stroke does not fit; nothing was moved.
        DeviceError: `effect` is PARTIAL with `moved_ul` where the pump still knows its zero.
    """
    refuse_slow_stroke(abs(steps) / speed_steps_s)
    with before_acting():
        port = mechanism.port_index()
        before = mechanism.position()
    target = before + steps
    plunger.check_target(target)
    begin(target)
    with after_acting():
        progress = partial(_progress, plunger, mechanism, before)
        watch(driver, mechanism.is_idle, limit_of(abs(steps) / speed_steps_s), progress)
        after = mechanism.position()
        if after != target:
            _fail_short(f"plunger stands at step {after}, asked for {target}", progress())
    report = _moved(plunger, before, after)
    return Report(report.pop("moved_ul"), {**report, "port_index": port}, plunger.ul_per_step)


def limit_of(duration_s: float) -> float:
    """Return how long a motion of this duration may take."""
    return duration_s * 1.5 + SLACK_S


def refuse_slow_stroke(duration_s: float) -> None:
    """Refuse a stroke that no time limit covers.

    Raises:
        PreconditionError: It takes longer than `FULL_STROKE_S`.
    """
    if duration_s > FULL_STROKE_S:
        raise PreconditionError(
            f"the stroke takes {duration_s:.0f} s at this rate, over {FULL_STROKE_S:g} s",
            code="device.rate_out_of_range",
        )


def refuse_rate(rate_ul_s: float, low_ul_s: float, high_ul_s: float) -> None:
    """Refuse a rate that the pump cannot do.

    Raises:
        PreconditionError: It lies outside the closed range.
    """
    if not low_ul_s <= rate_ul_s <= high_ul_s:
        raise PreconditionError(
            f"{rate_ul_s:g} µL/s was asked for; this pump does {low_ul_s:g} to {high_ul_s:g} µL/s",
            code="device.rate_out_of_range",
        )


def turn_valve(
    driver: Driver[Any, Any],
    wanted: int | str,
    *,
    begin: Callable[[], None],
    is_idle: Callable[[], bool],
    where: Callable[[], int | str],
    name: str = "port_index",
) -> Report:
    """Turn a valve, watch it, and prove where it stands.

    Raises:
        DeviceError: PARTIAL with the place it stands at, where it tells one; no liquid moved.
    """
    begin()
    with after_acting():
        watch(driver, is_idle, VALVE_S, lambda: {"moved_ul": 0.0, name: where()})
        reached = where()
    if reached != wanted:
        stands = {"moved_ul": 0.0, name: reached}
        _fail_short(f"valve stands at {reached}, asked for {wanted}", stands)
    return Report(evidence={name: reached})


def refuse_port(port_index: int, ports_count: int) -> None:
    """Refuse a port that the valve does not have.

    Raises:
        PreconditionError: The port is not one of 1 to the count.
    """
    if not 1 <= port_index <= ports_count:
        raise PreconditionError(
            f"port {port_index} was asked for; the valve has 1 to {ports_count}",
            code="device.no_port",
        )


def watch(
    driver: Driver[Any, Any],
    is_idle: Callable[[], bool],
    limit_s: float,
    progress: Progress | None = None,
) -> None:
    """Wait until nothing moves; a stop or too long a motion is halted and measured.

    Raises:
        DeviceStoppedError: Somebody stopped the device.
        DeviceError: Code `device.slow`, or what the device reports.
    """
    deadline_s = driver.deadline_s(limit_s)
    try:
        driver.pause(0)
        while not is_idle():
            if driver.now_s() > deadline_s:
                raise DeviceError(f"still busy after {limit_s:g} s", code="device.slow")
            driver.pause(POLL_S)
        driver.pause(0)
    except DeviceError as error:
        if error.code in {"device.slow", DeviceStoppedError.default_code}:
            _describe_standstill(driver, is_idle, error, progress)
        raise


def _describe_standstill(
    driver: Driver[Any, Any],
    is_idle: Callable[[], bool],
    error: DeviceError,
    progress: Progress | None,
) -> None:
    """Halt, and when it can be read, say how far the motion came."""
    driver.halt()
    deadline_s = driver.deadline_s(SLACK_S)
    while not is_idle():
        if driver.now_s() > deadline_s:
            return
        driver.rest(POLL_S)
    facts = progress() if progress is not None else None
    if facts is not None:
        error.context.update(facts)
        error.effect = Effect.PARTIAL


def _progress(plunger: SteppedPlunger, mechanism: Mechanism, before: int) -> dict[str, Any] | None:
    if not mechanism.knows_position():
        return None
    return _moved(plunger, before, mechanism.position())


def _moved(plunger: SteppedPlunger, before: int, after: int) -> dict[str, Any]:
    moved_ul = plunger.volume_ul(abs(after - before))
    return {"moved_ul": moved_ul, "steps_before": before, "steps_after": after}


def _fail_short(message: str, facts: dict[str, Any] | None) -> None:
    raise DeviceError(
        message,
        code="device.not_reached",
        effect=Effect.UNKNOWN if facts is None else Effect.PARTIAL,
        context=facts,
    )
