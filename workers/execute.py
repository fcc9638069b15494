"""Run one action of a device under a watchdog, and turn whatever happens into a report."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import Any, Literal

from drivers.base import DataFile
from drivers.base import Report as DriverReport
from labweb.domain.calibration.model import Quantity
from labweb.domain.crutd.decide import confirmed_nl
from labweb.domain.enrollment.guards import watchdog_s
from labweb.domain.errors import DeviceError, Effect, LabError
from labweb.domain.files import MEDIA_TYPES, NamedFile, check_files, plain_media_type
from labweb.domain.messages import Do
from labweb.domain.ports import Clock
from labweb.domain.runs.bodies import plain
from labweb.domain.runs.edge import Report
from workers import faults
from workers.unit import Unit

log = logging.getLogger(__name__)

POLL_S = 0.05
HALT_GRACE_S = 15.0
"""How long a device that was told to halt may take to stand still."""

NL_PER_UL = 1000


@dataclass(frozen=True, slots=True)
class Acted:
    """What came of an action."""

    report: Report
    is_hung: bool = False
    """The driver has not come back; its process has to end."""

    files: tuple[DataFile, ...] = ()
    """What the action hands over, as the report names it; not on disk yet."""


def outer_limit_s(do: Do) -> float:
    """Return after how long the watchdog stops a device whose driver has not."""
    return watchdog_s(do.timeout_s)


class Actor:
    """The thread on which the actions of one line call their drivers, one after the other."""

    def __init__(self) -> None:
        self._tasks: SimpleQueue[_Task | None] | None = None

    def act(
        self, unit: Unit, do: Do, clock: Clock, *, is_cancel_wanted: Callable[[], bool]
    ) -> Acted:
        """Carry out the action on the thread and wait for its end.

        Effect:
            The device acts, once. Nothing is ever sent again from here.
        """
        task = _Task(unit, do)
        unit.is_acting = True
        self._begin(task)
        deadline_s = clock.monotonic_s() + outer_limit_s(do)
        is_halted = False
        while not task.wait(POLL_S):
            if clock.monotonic_s() > deadline_s:
                acted = _overrun(task, unit, clock)
                if acted.is_hung:
                    self._tasks = None  # its thread is lost with it
                return acted
            if not is_halted and is_cancel_wanted():
                is_halted = True
                unit.stop()
        unit.is_acting = False
        return Acted(task.report(), files=task.files)

    def close(self) -> None:
        """End the thread after what it does now."""
        if self._tasks is not None:
            self._tasks.put(None)
            self._tasks = None

    def _begin(self, task: _Task) -> None:
        if self._tasks is None:
            self._tasks = SimpleQueue()
            threading.Thread(target=_work, args=(self._tasks,), name="action", daemon=True).start()
        self._tasks.put(task)


def _work(tasks: SimpleQueue[_Task | None]) -> None:
    while (task := tasks.get()) is not None:
        task.run()


def _overrun(task: _Task, unit: Unit, clock: Clock) -> Acted:
    unit.stop()
    deadline_s = clock.monotonic_s() + HALT_GRACE_S
    while not task.wait(POLL_S) and clock.monotonic_s() < deadline_s:
        continue
    is_hung = not task.is_done
    late = {} if is_hung else plain(task.report().evidence)
    report = Report(
        ok=False,
        effect=Effect.UNKNOWN,
        code="edge.watchdog",
        message="the action did not end in time; the device was told to halt",
        evidence={"late": late, "is_hung": is_hung},
    )
    unit.is_acting = is_hung
    return Acted(report, is_hung=is_hung)


class _Task:
    """One call of a driver, and what came of it."""

    def __init__(self, unit: Unit, do: Do) -> None:
        self._unit = unit
        self._do = do
        self._done = threading.Event()
        self._report: Report | None = None
        self.files: tuple[DataFile, ...] = ()

    @property
    def is_done(self) -> bool:
        return self._done.is_set()

    def wait(self, duration_s: float) -> bool:
        return self._done.wait(duration_s)

    def report(self) -> Report:
        assert self._report is not None  # noqa: S101 - set before the event
        return self._report

    def run(self) -> None:
        try:
            with _observed(self._unit):
                told = self._call()
                self._report = to_report(self._do, self._unit, told)
                self.files = told.files
        except LabError as error:
            self._report = _failed(self._do, error)
        except Exception as error:
            log.exception("driver of %s failed", self._unit.config.key)
            self._report = Report(
                ok=False,
                effect=Effect.UNKNOWN,
                code="driver.bug",
                message=f"{type(error).__name__}: {error}",
            )
        finally:
            if self._report is None:
                self._report = Report(ok=False, effect=Effect.UNKNOWN, code="driver.bug")
            self._done.set()

    def _call(self) -> DriverReport:
        if is_plain_read(self._do, self._unit):
            statuses = [str(name) for name in self._do.operation.get("statuses", ())]
            return DriverReport(evidence={name: self._unit.read(name) for name in statuses})
        do = self._do
        return self._unit.act(do.action, dict(do.args), str(do.action_id))


def is_plain_read(do: Do, unit: Unit) -> bool:
    """Say whether the action is to read statuses and nothing else."""
    return do.operation.get("op") == "read" and do.action == "read" and not unit.has_action("read")


def to_report(do: Do, unit: Unit, report: DriverReport) -> Report:
    """Turn a driver's report into the journal's.

    Raises:
        DeviceError: It hands files over that cannot be; the device has acted.
    """
    files = _named(do, report)
    evidence = plain(report.evidence)
    data: dict[str, Any] = {}
    if do.operation.get("op") in {"update", "read"}:
        data = {key: evidence[key] for key in evidence if key in unit.config.statuses}
    return Report(
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


def without_files(do: Do, report: Report, error: LabError) -> Report:
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
    volumes = (one for one in do.corrections if one.quantity is Quantity.VOLUME)
    correction = next(volumes, None)
    if told_nl is None or correction is None:
        return told_nl
    return _to_nl(correction.true_of(told_nl / NL_PER_UL))


def _failed(do: Do, error: LabError) -> Report:
    return Report(
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

    def __init__(self, unit: Unit) -> None:
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
