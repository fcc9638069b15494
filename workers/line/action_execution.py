"""Run one action of a device under a watchdog, and turn whatever happens into a report."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from drivers.base import DataFile
from drivers.base import Report as DriverReport
from labweb.domain.action_files import MEDIA_TYPES, NamedFile, check_files, plain_media_type
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.clock_and_ids import Clock
from labweb.domain.crutd.settlement import confirmed_nl
from labweb.domain.enrollment.action_guards import watchdog_s
from labweb.domain.errors import DeviceError, Effect, LabError
from labweb.domain.messages.commands import Do
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.domain.runs.host_journal.event_bodies import plain
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from workers.base import faults
from workers.line.device_unit import DeviceUnit

log = logging.getLogger(__name__)

POLL_S = 0.05
HALT_GRACE_S = 15.0
"""How long a device that was told to halt may take to stand still."""

NL_PER_UL = 1000


@dataclass(frozen=True, slots=True)
class ActionResult:
    """What came of an action."""

    report: ActionReport
    files: tuple[DataFile, ...] = ()
    """What the action hands over, as the report names it; not on disk yet."""


def outer_limit_s(do: Do, pace: float = 1.0) -> float:
    """Return after how long, in real time, the watchdog stops a device whose driver has not."""
    return watchdog_s(do.timeout_s, pace)


class ActionExecution:
    """One call of a driver, on its line's thread, which another one watches."""

    def __init__(self, unit: DeviceUnit, row: ActionRow, clock: Clock) -> None:
        self.row = row
        self.unit = unit
        self._clock = clock
        self._late_at_s = clock.monotonic_s() + outer_limit_s(row.do, unit.driver.pace)
        self._ending = threading.Lock()
        self._is_over = False
        self._is_halted = False
        self._is_late = False
        self._is_given_up = False

    def carry_out(self) -> ActionResult | None:
        """Carry out the action and return what came of it.

        Returns:
            None when it took so long that whoever watches has given it up and written that down:
            nothing may be done on this thread any more.

        Effect:
            The device acts, once. Nothing is ever sent again from here.
        """
        self.unit.is_acting = True
        report, files = self._report()
        with self._ending:  # a halt that has begun is part of it; none comes after
            self._is_over = True
        if self._is_given_up:
            return None
        self.unit.is_acting = False
        if self._is_late:
            return ActionResult(_watchdog_report(late=plain(report.evidence), is_hung=False))
        return ActionResult(report, files=files)

    def look(self, is_cancel_wanted: Callable[[], bool]) -> ActionReport | None:
        """Halt the device when its time is over, or once when a person wants it to end.

        Called by another thread again and again. A halt never meets what comes after the action.

        Returns:
            What there is to tell of an action whose driver does not come back although its device
            was halted: it is given up, and its process has to end. None: nothing.

        Effect:
            The device is halted.
        """
        is_late = self._clock.monotonic_s() > self._late_at_s
        if not is_late and (self._is_halted or not is_cancel_wanted()):
            return None
        with self._ending:
            if self._is_over:
                return None
            self._is_halted, self._is_late = True, is_late
            self.unit.stop()
        if not is_late or self._comes_back():
            return None
        return _watchdog_report(late={}, is_hung=True)

    def _comes_back(self) -> bool:
        deadline_s = self._clock.monotonic_s() + HALT_GRACE_S
        while not self._is_over and self._clock.monotonic_s() < deadline_s:
            self._clock.wait(POLL_S)
        with self._ending:
            self._is_given_up = not self._is_over
        return self._is_over

    def _report(self) -> tuple[ActionReport, tuple[DataFile, ...]]:
        try:
            with _observed(self.unit):
                told = self._call()
                return to_report(self.row.do, self.unit, told), told.files
        except LabError as error:
            return _failed(self.row.do, error), ()
        except Exception as error:
            log.exception("driver of %s failed", self.unit.config.key)
            text = f"{type(error).__name__}: {error}"
            return ActionReport(
                ok=False, effect=Effect.UNKNOWN, code="driver.bug", message=text
            ), ()
        except BaseException:  # a driver that would end the process
            log.exception("driver of %s failed", self.unit.config.key)
            return ActionReport(ok=False, effect=Effect.UNKNOWN, code="driver.bug"), ()

    def _call(self) -> DriverReport:
        do = self.row.do
        if is_plain_read(do, self.unit):
            statuses = [str(name) for name in do.operation.get("statuses", ())]
            return DriverReport(evidence={name: self.unit.read(name) for name in statuses})
        return self.unit.act(do.action, dict(do.args), str(do.action_id))


def _watchdog_report(*, late: dict[str, Any], is_hung: bool) -> ActionReport:
    return ActionReport(
        ok=False,
        effect=Effect.UNKNOWN,
        code="edge.watchdog",
        message="the action did not end in time; the device was told to halt",
        evidence={"late": late, "is_hung": is_hung},
    )


def is_plain_read(do: Do, unit: DeviceUnit) -> bool:
    """Say whether the action is to read statuses and nothing else."""
    return do.operation.get("op") == "read" and do.action == "read" and not unit.has_action("read")


def to_report(do: Do, unit: DeviceUnit, report: DriverReport) -> ActionReport:
    """Turn a driver's report into the journal's.

    Raises:
        DeviceError: It hands files over that cannot be; the device has acted.
    """
    files = _named(do, report)
    evidence = plain(report.evidence)
    data: dict[str, Any] = {}
    if do.operation.get("op") in {"update", "read"}:
        data = {key: evidence[key] for key in evidence if key in unit.config.statuses}
    return ActionReport(
        ok=True, moved_nl=_moved_nl(do, report), evidence=evidence, data=data, files=files
    )


def _named(do: Do, report: DriverReport) -> tuple[NamedFile, ...]:
    """Return how the record names the files of a report, once they are known to fit."""
    named = tuple(
        NamedFile(
            name=file.name,
            format=file.format,
            media_type=MEDIA_TYPES.get(file.format, plain_media_type(file.media_type)),
            size_bytes=len(file.data),
            sha256=file.sha256,
        )
        for file in report.files
    )
    findings = check_files(named)
    if findings:
        raise DeviceError(
            "the files of the action cannot be kept: " + "; ".join(one.message for one in findings),
            code=findings[0].code,
            effect=_effect_of_loss(do),
            context={"moved_ul": report.moved_ul, "files": [one.name for one in named]},
        )
    return named


def without_files(do: Do, report: ActionReport, error: LabError) -> ActionReport:
    """Return the report of an action that was done, and whose files could not be kept."""
    return replace(
        report,
        ok=False,
        effect=_effect_of_loss(do),
        code=error.code,
        message=f"the files of the action could not be kept: {error.message}",
        files=(),
    )


def _effect_of_loss(do: Do) -> Effect:
    """Say what an action did to matter whose files are lost: all that it was asked to."""
    return Effect.NONE if do.operation.get("op") == "read" else Effect.PARTIAL


def _moved_nl(do: Do, report: DriverReport) -> int | None:
    moved_nl, asked_nl = _true_nl(do, report.moved_ul), do.operation.get("amount_nl")
    if moved_nl is None or not isinstance(asked_nl, int):
        return moved_nl
    return confirmed_nl(asked_nl, moved_nl, _true_nl(do, report.resolution_ul) or 0)


def _true_nl(do: Do, told_ul: object) -> int | None:
    """Return what a volume that the device tells is by the calibration that it was sent with."""
    told_nl = _to_nl(told_ul)
    volumes = (one for one in do.corrections if one.quantity is CalibrationQuantity.VOLUME)
    correction = next(volumes, None)
    if told_nl is None or correction is None:
        return told_nl
    return _to_nl(correction.true_of(told_nl / NL_PER_UL))


def _failed(do: Do, error: LabError) -> ActionReport:
    return ActionReport(
        ok=False,
        effect=error.effect,
        moved_nl=_true_nl(do, error.context.get("moved_ul")),
        code=error.code,
        message=error.message,
        evidence=plain(error.context),
    )


def _to_nl(moved_ul: object) -> int | None:
    if isinstance(moved_ul, bool) or not isinstance(moved_ul, int | float):
        return None
    return round(moved_ul * NL_PER_UL)


class _observed:  # noqa: N801 - used as a context manager
    """Pass the fault points of the wire while a test asks for them."""

    def __init__(self, unit: DeviceUnit) -> None:
        self._transport = unit.driver.transport
        self._is_wanted = faults.are_armed()
        self._before = self._transport.observer
        self._thread_id = 0
        self._writes = 0

    def __enter__(self) -> None:
        if self._is_wanted:
            self._thread_id = threading.get_ident()
            self._transport.observer = self._see

    def __exit__(self, *_: object) -> None:
        if self._is_wanted:
            self._transport.observer = self._before

    def _see(self, direction: Literal["out", "in"], data: bytes) -> None:
        if self._before is not None:
            self._before(direction, data)
        if threading.get_ident() != self._thread_id:
            return
        if direction == "in":
            faults.point("execute.after_first_byte")
            return
        self._writes += 1
        faults.point("execute.before_first_byte" if self._writes == 1 else "execute.mid_action")
