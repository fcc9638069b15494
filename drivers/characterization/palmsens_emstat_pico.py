"""PalmSens EmStat Pico, a potentiostat module.

Protocol: MethodSCRIPT over serial 230400 8N1, LF; software flow control, `flow=xonxoff`.
Quality: bronze, simulated instrument.
Safe state: cell off; on a lost link the measurement goes on to its end and turns the cell off.

A measurement is one script that the instrument runs by itself, and that ends with the cell off
also when it is aborted. A script that fails leaves the cell as it is: then, and with every halt,
a script of its own turns it off.

Source:
    PalmSens, EmStat Pico communication protocol V1.6, chapters 2 to 4 (line, commands, errors);
    MethodSCRIPT manual V1.8, appendix B (limits of the EmStat Pico).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import DataFile, Driver, Range, Report, action, before_acting, status
from drivers.characterization._emstat import (
    MODES,
    count_points,
    count_steps,
    decode_version,
    lines_before,
    lines_on,
    ordered,
    refuse_potentials,
    refuse_short,
    refuse_too_many,
    whole_after_abort,
    whole_after_script,
    whole_lines,
    whole_version,
)
from drivers.characterization._methodscript import (
    CYCLIC,
    HOLD,
    LINEAR,
    MA_PER_A,
    OPEN_CIRCUIT,
    ScriptOutput,
    Technique,
    decode_lines,
    decode_refusal,
    encode_number,
    encode_script,
    render_table,
    summarise,
)
from drivers.interfaces.potentiostat import Potentiostat
from drivers.transports.base import ByteTransport, Ending
from drivers.waiting import once_started
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    FrameError,
)

ANSWER_S = 2.0
ABORT_S = 10.0
"""So long a script may take to end once it was told to."""

AFTER_ERROR_S = 0.15
"""For 100 ms after an error nothing is listened to, chapter 4 of the protocol."""

LONGEST_BYTES = 1_000_000
SPARSE_S = 0.2
"""Points further apart leave the line silent long enough to be spoken to between two of them."""

VERSION, ABORT, CELL_OFF = b"t\n", b"\nZ\n", b"e\ncell_off\n\n"
"""The empty line before `Z` ends a command that was cut off on its way, chapter 3."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One module with its cell."""

    mode: Literal["low_speed", "high_speed"] = "low_speed"
    """Low speed: -1.25 to 2 V, 25 points a second; high speed: -1.7 to 2 V, 100 a second."""

    max_current_ma: Annotated[float, Range(0.0001, 3.0)] = 3.0
    """The coarsest range that it may choose: about the largest current that is expected."""

    min_potential_v: Annotated[float, Range(-1.7, 2.0)] = -1.7
    """What the cell of this lab bears; the mode narrows it further."""

    max_potential_v: Annotated[float, Range(-1.7, 2.0)] = 2.0


class PalmsensEmstatPico(Driver[ByteTransport, Config], Potentiostat):
    """One module; its second channel is not used."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _identity: bytes = b""
    _output: ScriptOutput | None = None
    _planned_count: int = 1
    _is_measuring: bool = False
    _gap_s: float = 0.0
    _interval_s: float = 0.0

    def identify(self) -> None:
        """Ask which instrument answers, and refuse another than an EmStat Pico."""
        self._identity = decode_version(self._exchange(VERSION, until=whole_version))

    def halt(self) -> None:
        """Abort what runs, and turn the cell off."""
        with self.transport.lock:
            self._abort()
            answer = self._exchange(CELL_OFF, until=whole_after_script)
            lines = decode_lines(answer)
            if lines[:1] != ["e"] or any(decode_refusal(line) for line in lines):
                self._note_error(answer)
                raise DeviceError("the cell was not turned off", context={"lines": lines[:5]})

    @status(every_s=10.0)
    def is_connected(self) -> bool:
        """Tell whether the instrument that was found at first still answers."""
        if self._is_measuring:
            return True
        with before_acting():
            found = decode_version(self._exchange(VERSION, until=whole_version))
            if found != self._identity:
                raise FrameError("another instrument answers", context={"frame": found.hex()})
        return True

    @status(every_s=2.0)
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""
        return self._is_measuring

    @status(every_s=2.0)
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""
        count = 0 if self._output is None else len(self._output.points)
        return min(1.0, count / self._planned_count)

    @status(every_s=2.0)
    def potential_v(self) -> float | None:
        """Tell the potential of the last point; None: none was measured yet."""
        points = () if self._output is None else self._output.points
        return points[-1].potential_v if points else None

    @status(every_s=2.0)
    def current_ma(self) -> float | None:
        """Tell the current of the last point; None: none was measured yet."""
        points = () if self._output is None else self._output.points
        current_a = points[-1].current_a if points else None
        return None if current_a is None else round(current_a * MA_PER_A, 12)

    @action(timeout_s=90_000.0, recovery="R1", operation="read")
    def measure_open_circuit(
        self,
        duration_s: Annotated[float, Range(0.1, 86_400.0)],
        interval_s: Annotated[float, Range(0.01, 60.0)],
    ) -> Report:
        """Read the potential of the open cell, every so often; evidence `last_potential_v`.

        Args:
            duration_s: How long, at most a day.
            interval_s: Time from point to point; not shorter than the mode allows.

        Raises:
            PreconditionError: Beyond what the mode or a table of points holds (NONE).
            RejectedError: A script runs already (NONE).
            DeviceError: It failed or was stopped (PARTIAL), or the link broke (UNKNOWN).

        Effect:
            None on matter: no current flows.
        """
        self.refuse_if_stopped()
        count = count_points(duration_s, interval_s)
        loop = f"meas_loop_ocp p {encode_number(interval_s)} {encode_number(duration_s)}"
        return self._measure(OPEN_CIRCUIT, ["cell_off"], loop, interval_s, count)

    @action(timeout_s=90_000.0, recovery="R3", hazards=("electricity",))
    def hold_potential(
        self,
        potential_v: Annotated[float, Range(-1.7, 2.0)],
        duration_s: Annotated[float, Range(0.1, 86_400.0)],
        interval_s: Annotated[float, Range(0.01, 60.0)],
    ) -> Report:
        """Hold a potential and read the current (chronoamperometry), then turn the cell off.

        Args:
            potential_v: Of the working electrode against the reference.
            duration_s: How long, at most a day.
            interval_s: Time from point to point; not shorter than the mode allows.

        Raises:
            PreconditionError: Beyond mode, cell or a table of points (NONE).
            RejectedError: A script runs already, or it refused (NONE).
            DeviceError: It failed or was stopped, and the cell is off (PARTIAL); or the link
                broke, and it goes on to its end (UNKNOWN).

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """
        self.refuse_if_stopped()
        self._check_potentials(potential_v)
        count = count_points(duration_s, interval_s)
        at = encode_number(potential_v)
        loop = f"meas_loop_ca p c {at} {encode_number(interval_s)} {encode_number(duration_s)}"
        return self._measure(HOLD, lines_on(at, at, at), loop, interval_s, count)

    @action(timeout_s=90_000.0, recovery="R3", hazards=("electricity",))
    def sweep_linear(
        self,
        first_v: Annotated[float, Range(-1.7, 2.0)],
        last_v: Annotated[float, Range(-1.7, 2.0)],
        step_v: Annotated[float, Range(0.0001, 0.25)],
        rate_v_s: Annotated[float, Range(0.00001, 10.0)],
    ) -> Report:
        """Sweep the potential once and read the current (LSV), then turn the cell off.

        Args:
            first_v: Where it begins.
            last_v: Where it ends.
            step_v: From point to point.
            rate_v_s: How fast; step over rate is what the mode allows to 60 s, a day in all.

        Raises:
            DeviceError, PreconditionError: As `hold_potential`.

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """
        self.refuse_if_stopped()
        self._check_potentials(first_v, last_v)
        count = count_steps(step_v, (first_v, last_v), rate_v_s) + 1
        first, last = encode_number(first_v), encode_number(last_v)
        ways = f"{first} {last} {encode_number(step_v)} {encode_number(rate_v_s)}"
        on = lines_on(first, *ordered(first_v, last_v))
        return self._measure(LINEAR, on, f"meas_loop_lsv p c {ways}", step_v / rate_v_s, count)

    @action(timeout_s=90_000.0, recovery="R3", hazards=("electricity",))
    def sweep_cyclic(
        self,
        first_v: Annotated[float, Range(-1.7, 2.0)],
        vertex_1_v: Annotated[float, Range(-1.7, 2.0)],
        vertex_2_v: Annotated[float, Range(-1.7, 2.0)],
        step_v: Annotated[float, Range(0.0001, 0.25)],
        rate_v_s: Annotated[float, Range(0.00001, 10.0)],
        cycles_count: Annotated[int, Range(1, 1000)],
    ) -> Report:
        """Sweep from the first potential over both vertices and back (CV), then cell off.

        Args:
            first_v: Where each cycle begins and ends.
            vertex_1_v: Where it turns first.
            vertex_2_v: Where it turns then.
            step_v: From point to point.
            rate_v_s: How fast; step over rate is what the mode allows to 60 s, a day in all.
            cycles_count: How often.

        Raises:
            DeviceError, PreconditionError: As `hold_potential`.

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """
        self.refuse_if_stopped()
        way = (first_v, vertex_1_v, vertex_2_v, first_v)
        self._check_potentials(*way)
        count = count_steps(step_v, way, rate_v_s, cycles_count)
        ways = " ".join(map(encode_number, (*way[:3], step_v, rate_v_s)))
        scans = f" nscans({cycles_count})" if cycles_count > 1 else ""
        on = lines_on(encode_number(first_v), *ordered(*way))
        loop = f"meas_loop_cv p c {ways}{scans}"
        return self._measure(CYCLIC, on, loop, step_v / rate_v_s, count)

    @action(timeout_s=100.0, recovery="R1")
    def stop_measuring(self) -> Report:
        """End what is measured and turn the cell off; nothing of it is stored.

        Effect:
            No current flows through the cell.
        """
        self.halt()
        return Report(evidence={"is_cell_on": False})

    def _measure(
        self, technique: Technique, on: list[str], loop: str, interval_s: float, count: int
    ) -> Report:
        """Run one script to its end, and hand its points over."""
        front = lines_before(
            MODES[self.config.mode], interval_s, self.config.max_current_ma / MA_PER_A
        )
        refuse_too_many(count)
        script = encode_script([*front, *on], loop, technique)
        output = ScriptOutput(technique)
        with self.transport.lock, self._measuring(output, count, interval_s):
            rest = self._begin(script)
            with once_started(self.halt, lambda: summarise(output), driver=self):
                self._follow(output, rest)
        return self._report(output)

    @contextmanager
    def _measuring(self, output: ScriptOutput, count: int, interval_s: float) -> Iterator[None]:
        self._output, self._planned_count = output, max(1, count)
        self._is_measuring, self._interval_s = True, interval_s
        try:
            yield
        finally:
            self._is_measuring, self._interval_s = False, 0.0

    def _check_potentials(self, *potentials_v: float) -> None:
        low_v, high_v = self.config.min_potential_v, self.config.max_potential_v
        refuse_potentials(MODES[self.config.mode], low_v, high_v, potentials_v)

    def _begin(self, script: bytes) -> list[str]:
        """Start, once, and return the lines that have come with the answer."""
        try:
            frame = self._exchange(script, until=whole_lines)
            lines = decode_lines(frame)
            refusal = decode_refusal(lines[0])
            if refusal is None and lines[0] != "e":
                raise FrameError("no answer to a script", context={"line": lines[0][:200]})
        except DeviceError:
            with suppress(DeviceError):
                self.halt()  # nobody knows whether it runs
            raise
        if refusal is not None:
            self._note_error(frame)
            raise refusal
        return lines[1:]

    def _follow(self, output: ScriptOutput, lines: list[str]) -> None:
        """Read points until the script has ended."""
        # Where points come so fast that the line is never silent, a stop waits for the next one.
        unless = (lambda: self.is_stopped) if self._interval_s > SPARSE_S else None
        while True:
            self._take(output, lines)
            if output.is_over:
                break
            self.pause(0)
            try:
                frame = self.transport.receive(
                    until=whole_lines,
                    timeout_s=self._interval_s / self.pace + ANSWER_S,
                    longest_bytes=LONGEST_BYTES,
                    unless=unless,
                )
            except DeviceTimeoutError:
                self.pause(0)
                raise
            lines = decode_lines(frame)
        refuse_short(len(output.points), self._planned_count)

    def _take(self, output: ScriptOutput, lines: list[str]) -> None:
        try:
            output.take(lines)
        except DeviceError:
            self._gap_s = AFTER_ERROR_S
            raise

    def _report(self, output: ScriptOutput) -> Report:
        model = self._identity[1:].partition(b"#")[0].decode("ascii")
        table = render_table(output.technique, output.points, (f"instrument: {model}",))
        name = f"{output.technique.name}.csv"
        file = DataFile(name=name, format="csv", data=table, media_type="text/csv")
        return Report(evidence=summarise(output), files=(file,))

    def _abort(self) -> None:
        """Tell what runs to end, and wait until it has."""
        self.transport.send(ABORT, gap_s=self._take_gap_s())
        heard, until_s = b"", time.monotonic() + ABORT_S + self._interval_s / self.pace
        while whole_after_abort(heard) is None:
            # The answer comes at once; the end only after the point that is being measured.
            left_s = until_s - time.monotonic()
            limit_s = left_s if b"Z\n" in heard else min(left_s, ANSWER_S)
            heard += self.transport.receive(
                until=whole_lines, timeout_s=limit_s, longest_bytes=LONGEST_BYTES
            )
        self._note_error(heard)

    def _exchange(self, request: bytes, *, until: Ending) -> bytes:
        return self.transport.exchange(
            request,
            until=until,
            timeout_s=ANSWER_S,
            gap_s=self._take_gap_s(),
            longest_bytes=LONGEST_BYTES,
        )

    def _take_gap_s(self) -> float:
        gap_s, self._gap_s = self._gap_s, 0.0
        return gap_s

    def _note_error(self, frame: bytes) -> None:
        if b"!" in frame:
            self._gap_s = AFTER_ERROR_S
