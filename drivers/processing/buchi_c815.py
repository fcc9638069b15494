"""Büchi Pure C-815 flash chromatography system.

Protocol: HTTP, JSON by the maker's OpenInterface v1; the whole process is read, parts are put.
Quality: bronze, simulated instrument.
Safe state: pump off; on a lost link it pumps on until the bottle is empty or a sensor trips.

The interface says no units: a flow rate is in whole mL/min and a pressure in bar, as the panel of
the system has them. A part that is put is read back, and a system that prepares or cleans itself is
left alone.

Source:
    BÜCHI, Pure C-8xx OpenInterface v1: Info_Get, Process_Get, Process_Update and their schemas.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.chromatography import Chromatography
from drivers.transports.http import HttpReply, HttpTransport
from drivers.waiting import await_true, once_started, refuse_between_steps, refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

INFO, PROCESS = "/api/v1/Info", "/api/v1/Process"
MODEL = "815"
OWN_PROGRAMS = frozenset({"Preparing", "Cleaning"})
"""States in which the system does what nobody asked for here."""

POSITIONS = {"load": "Load", "separation": "Separation"}
TARGETS = {"waste": "Waste", "vial": "Vial"}
ML_MIN_PER_UL_S = 0.06
KPA_PER_BAR = 100.0
PERCENT = 100.0
RESOLUTION = 1e-6
LINES = ("line1Percentage", "line2Percentage", "line3Percentage", "line4Percentage")
GOOD, BAD_REQUEST = 200, 400
LONGEST_BYTES = 1_000_000
ANSWER_S = 5.0

Ratio = Annotated[float, Range(0.0, 1.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One system with one column."""

    max_rate_ul_s: Annotated[float, Range(0.0, 5000.0)]
    """Highest rate that column and tubing of this lab stand."""

    max_pressure_kpa: Annotated[float, Range(0.0, 5000.0)]
    """Highest pressure behind the pump; the system has a limit of its own."""

    start_limit_s: Annotated[float, Range(0.1, 50.0)] = 10.0
    """Longest time until a part that was put is read back."""

    settle_s: Annotated[float, Range(0.0, 60.0)] = 2.0
    """Time between turning the flow on and reading its pressure."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


def encode_parts(**parts: object) -> bytes:
    """Build the body that changes some parts of the process, and leaves the others.

    Example:
        >>> encode_parts(solventSystem={"flowIsEnabled": False})
        b'{"solventSystem": {"flowIsEnabled": false}}'
    """
    return json.dumps(parts).encode("ascii")


def decode_object(reply: HttpReply) -> dict[str, Any]:
    """Read the JSON object of a reply.

    Raises:
        FrameError: It is none.
    """
    try:
        found = json.loads(reply.body.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FrameError(
            "the answer is no JSON", context={"body": reply.body[:200].hex()}
        ) from error
    if not isinstance(found, dict):
        raise FrameError("the answer is no JSON object", context={"body": str(found)[:200]})
    return found


def refuse_failure(reply: HttpReply, what: str) -> None:
    """Pass a reply that says that it was done.

    Raises:
        RejectedError: The system refused (400); nothing was done.
        DeviceError: It failed while it did it, or it is not known what it says.
    """
    if reply.status == GOOD:
        return
    text = reply.body[:500].decode("utf-8", "replace")
    context = {"status": reply.status, "detail": text}
    if reply.status == BAD_REQUEST:
        raise RejectedError(f"{what} was refused: {text}", context=context)
    raise DeviceError(
        f"{what} failed with status {reply.status}", code="device.alarm", context=context
    )


def take(process: Mapping[str, Any], path: str, sort: type | tuple[type, ...]) -> Any:  # noqa: ANN401
    """Return a value of the process by its path.

    Raises:
        FrameError: It is not there, or of another sort.

    Example:
        >>> take({"solventSystem": {"flowRate": 30}}, "solventSystem.flowRate", int)
        30
    """
    found: Any = process
    for name in path.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    if not isinstance(found, sort) or (sort is not bool and isinstance(found, bool)):
        raise FrameError(f"{path} is {found!r}")
    if isinstance(found, float) and not math.isfinite(found):
        raise FrameError(f"{path} is {found!r}, no number")
    return found


class BuchiC815(Driver[HttpTransport, Config], Chromatography):
    """One system."""

    transport_type: ClassVar[type] = HttpTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the model, and refuse another one."""
        info = self._get(INFO)
        names = [str(info.get(name) or "") for name in ("systemModel", "systemName")]
        if not any(MODEL in name for name in names):
            raise RejectedError(
                f"{self.transport.line} answers as {names}, expected a C-{MODEL}",
                context={"model": names},
            )
        self._process()

    def halt(self) -> None:
        """Stop the pump, and see that it is off.

        Raises:
            DeviceError: It pumps on.
        """
        self._put("the stop", solventSystem={"flowIsEnabled": False})
        if self.is_running():
            raise DeviceError("the pump is on after a stop", code="device.slow")

    @status(every_s=2.0)
    def is_running(self) -> bool:
        """Tell whether solvent flows."""
        return bool(take(self._process(), "solventSystem.flowIsEnabled", bool))

    @status(every_s=5.0)
    def rate_setpoint_ul_s(self) -> float:
        """Tell the wanted rate."""
        rate = take(self._process(), "solventSystem.flowRate", int)
        return float(round(rate / ML_MIN_PER_UL_S, 6))

    @status(every_s=2.0)
    def pressure_kpa(self) -> float:
        """Tell the pressure behind the pump."""
        bar = take(self._process(), "sensors.solventPressureAfterPump", (int, float))
        return float(round(bar * KPA_PER_BAR, 6))

    @status(every_s=5.0)
    def position(self) -> str:
        """Tell where the injection valve stands: load or separation."""
        return self._named("solventSystem.sampleInjectionValvePos", POSITIONS)

    @status(every_s=5.0)
    def collects_to(self) -> str:
        """Tell where what leaves the column goes: waste or vial."""
        return self._named("fractionCollector.collectionTask.action", TARGETS)

    @status(every_s=2.0)
    def running_state(self) -> str:
        """Tell what the system does by its own program: Idle, Preparing, Separating, Cleaning."""
        return str(take(self._process(), "runningState", str))

    @action(timeout_s=120.0, recovery="R1", hazards=("expels_liquid",))
    def start_flow(
        self,
        rate_ul_s: Annotated[float, Range(0.0, 5000.0)],
        line_1_ratio: Ratio,
        line_2_ratio: Ratio,
        line_3_ratio: Ratio,
        line_4_ratio: Ratio,
    ) -> Report:
        """Pump a mixture of the solvent lines, and return once it flows.

        Raises:
            PreconditionError: Faster than this lab allows, between two whole mL/min, or parts
                that do not make one whole (NONE).
            RejectedError: The system runs a program of its own, or refuses (NONE).
            DeviceError: It was not taken, the pressure is too high, or stopped: the pump is off,
                and `context` says what is read (PARTIAL); after a lost answer UNKNOWN.

        Effect:
            Solvent goes over the column until it is stopped, or its bottle is empty.
        """
        self.refuse_if_stopped()
        refuse_beyond("rate", rate_ul_s, 1 / ML_MIN_PER_UL_S, self.config.max_rate_ul_s)
        rate = refuse_between_steps("rate in mL/min", rate_ul_s * ML_MIN_PER_UL_S, 1.0)
        ratios = (line_1_ratio, line_2_ratio, line_3_ratio, line_4_ratio)
        if abs(sum(ratios) - 1.0) > RESOLUTION:
            raise PreconditionError(
                f"the parts of the solvent lines make {sum(ratios):g}, and 1 is the whole",
                code="device.limit",
            )
        mixture = {name: one * PERCENT for name, one in zip(LINES, ratios, strict=True)}
        wanted = {"flowIsEnabled": True, "flowRate": rate, "solventMixture": mixture}
        self._change(
            "the flow",
            {"solventSystem": wanted},
            lambda process: _holds(process.get("solventSystem"), wanted),
        )
        with once_started(self.halt, self._evidence, driver=self):
            self.pause(self.config.settle_s)
            evidence = self._evidence()
            if evidence["pressure_kpa"] > self.config.max_pressure_kpa:
                raise DeviceError(
                    f"the pressure is {evidence['pressure_kpa']:g} kPa, and the column is limited "
                    f"to {self.config.max_pressure_kpa:g} kPa",
                    code="device.alarm",
                )
            return Report(evidence=evidence)

    @action(timeout_s=60.0, recovery="R1")
    def stop_flow(self) -> Report:
        """Stop the pump.

        Effect:
            No solvent flows.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    @action(timeout_s=60.0, recovery="R1")
    def select_position(self, position: Literal["load", "separation"]) -> Report:
        """Turn the injection valve to `load` or to `separation`.

        Raises:
            RejectedError: The system runs a program of its own, or refuses (NONE).
            DeviceError: It does not stand there; the pump is off (PARTIAL or UNKNOWN).

        Effect:
            In `separation` the flow takes what was loaded onto the column.
        """
        wanted = {"sampleInjectionValvePos": POSITIONS[position]}
        self._change(
            "the injection valve",
            {"solventSystem": wanted},
            lambda process: _holds(process.get("solventSystem"), wanted),
        )
        return Report(evidence=self._evidence())

    @action(timeout_s=60.0, recovery="R1")
    def collect(self, target: Literal["waste", "vial"]) -> Report:
        """Lead what leaves the column to `waste`, or to the next `vial`.

        Raises:
            RejectedError: The system runs a program of its own, or refuses (NONE).
            DeviceError: It does not go there; the pump is off (PARTIAL or UNKNOWN).

        Effect:
            From now on it goes there.
        """
        wanted = {"collectionTask": {"action": TARGETS[target]}}
        self._change(
            "the fraction collector",
            {"fractionCollector": wanted},
            lambda process: _holds(process.get("fractionCollector"), wanted),
        )
        return Report(evidence=self._evidence())

    def _change(
        self,
        what: str,
        parts: Mapping[str, object],
        is_so: Callable[[Mapping[str, Any]], bool],
    ) -> None:
        """Put parts of the process once, and wait until they are read back."""
        self.refuse_if_stopped()
        with before_acting():
            if (state := self.running_state()) in OWN_PROGRAMS:
                raise RejectedError(
                    f"the system is {state} by its own program: end that first",
                    context={"state": state},
                )
        try:
            self._put(what, **parts)
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise
        with once_started(self.halt, self._evidence, driver=self):
            await_true(
                self,
                lambda: is_so(self._process()),
                f"{what} as it was put",
                limit_s=self.config.start_limit_s,
                poll_s=self.config.poll_s,
            )

    def _named(self, path: str, names: Mapping[str, str]) -> str:
        told = take(self._process(), path, str)
        for ours, theirs in names.items():
            if told == theirs:
                return ours
        raise FrameError(f"{path} is {told!r}, none of {sorted(names.values())}")

    def _evidence(self) -> dict[str, Any]:
        process = self._process()
        bar = take(process, "sensors.solventPressureAfterPump", (int, float))
        rate = take(process, "solventSystem.flowRate", int)
        return {
            "is_running": take(process, "solventSystem.flowIsEnabled", bool),
            "rate_setpoint_ul_s": round(rate / ML_MIN_PER_UL_S, 6),
            "pressure_kpa": round(bar * KPA_PER_BAR, 6),
            "position": take(process, "solventSystem.sampleInjectionValvePos", str).lower(),
        }

    def _process(self) -> dict[str, Any]:
        return self._get(PROCESS)

    def _get(self, path: str) -> dict[str, Any]:
        reply = self.transport.get(path, timeout_s=ANSWER_S, longest_bytes=LONGEST_BYTES)
        refuse_failure(reply, path)
        return decode_object(reply)

    def _put(self, what: str, **parts: object) -> None:
        body = encode_parts(**parts)
        reply = self.transport.put(PROCESS, body, timeout_s=ANSWER_S, longest_bytes=LONGEST_BYTES)
        refuse_failure(reply, what)


def _holds(told: object, wanted: Mapping[str, Any]) -> bool:
    """Tell whether a part has all that was put, whatever else it has."""
    if not isinstance(told, dict):
        return False
    for name, value in wanted.items():
        found = told.get(name)
        if isinstance(value, dict):
            if not _holds(found, value):
                return False
        elif isinstance(value, float):
            if not isinstance(found, int | float) or abs(found - value) > RESOLUTION * PERCENT:
                return False
        elif found != value:
            return False
    return True
