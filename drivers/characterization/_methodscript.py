"""MethodSCRIPT, the language of potentiostats by PalmSens: scripts out, lines of points in.

Source:
    PalmSens, MethodSCRIPT manual V1.8: chapters 4 to 6 (numbers, packages, output), 11
    (measurement loops), appendices A (errors) and C (variable types).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

SCALES = (("", 1.0), ("m", 1e-3), ("u", 1e-6), ("n", 1e-9))
"""Prefixes of a script's numbers, chapter 4, as far as they are used here."""

MOST_WHOLE = 2**31 - 1
NEAR = 1e-6
"""What binary fractions leave of a whole number."""

EXPONENTS = {"a": -18, "f": -15, "p": -12, "n": -9, "u": -6, "m": -3, " ": 0, "i": 0} | {
    "k": 3,
    "M": 6,
    "G": 9,
    "T": 12,
    "P": 15,
    "E": 18,
}
"""Powers of ten of a package's prefixes, chapter 4; `i` is a whole number."""

ZERO = 0x8000000
"""What a package adds to each number, chapter 5."""

MA_PER_A = 1000.0
OVERLOAD = 0x2
"""Bit of a point's status: the current was beyond its range, chapter 5."""

TIME, SET_POTENTIAL, READ_POTENTIAL, CURRENT = "eb", "da", "ab", "ba"
"""Variable types of a package, appendix C."""

_VARIABLE = re.compile(r"([a-j][a-z])(?:([0-9A-Fa-f]{7})([afpnum kMGTPEi])|     nan)((?:,\w+)*)")
_STATUS = re.compile(r",1([0-9A-Fa-f])(?:,|$)")
_REFUSED = re.compile(r"[A-Za-z]?!([0-9A-Fa-f]{4})(?:: Line ([0-9]+)(?:, Col ([0-9]+))?)?")

ERRORS = {
    "0003": "it does not know the command",
    "0006": "it is busy: a script runs",
    "000F": "it cannot apply that potential",
    "0014": "the cell is on",
    "001C": "the step is finer than it can set",
    "0021": "it has no such mode",
    "0023": "its mode does not allow that",
    "0032": "the cell is overloaded",
    "005A": "it cannot measure that often",
    "4005": "the script is too long",
    "4029": "there is less than one step",
    "7FFF": "it has failed, and has to be switched off and on",
}
"""What the errors mean that a script from here can meet, appendix A."""


@dataclass(frozen=True, slots=True)
class Technique:
    """A way to measure."""

    name: str
    """As a person says it; also the name of its file."""

    code: str
    """How the output names its loop, chapter 6."""

    kinds: tuple[str, ...]
    """Types of a package's variables, in order."""


OPEN_CIRCUIT = Technique("open_circuit", "000B", (TIME, READ_POTENTIAL))
HOLD = Technique("chronoamperometry", "0007", (TIME, SET_POTENTIAL, CURRENT))
LINEAR = Technique("linear_sweep", "0000", (TIME, SET_POTENTIAL, CURRENT))
CYCLIC = Technique("cyclic_voltammetry", "0005", (TIME, SET_POTENTIAL, CURRENT))


@dataclass(frozen=True, slots=True)
class ScriptPoint:
    """One point, in SI units."""

    time_s: float
    potential_v: float
    current_a: float | None
    """None: it was not measured, or is no number."""

    status: int
    cycle: int


def encode_number(value: float) -> str:
    """Write a number as a script has it: whole, with a prefix.

    Raises:
        PreconditionError: It has more digits than fit.

    Example:
        >>> encode_number(0.1), encode_number(-1.25), encode_number(7200.0)
        ('100m', '-1250m', '7200')
    """
    for prefix, scale in SCALES:
        whole = round(value / scale)
        if abs(whole) <= MOST_WHOLE and abs(value / scale - whole) <= NEAR:
            return f"{whole}{prefix}"
    raise PreconditionError(
        f"{value!r} has more digits than the instrument takes: it counts in 1e-9, and to 2^31",
        code="device.resolution",
    )


def encode_script(setup: Iterable[str], loop: str, technique: Technique) -> bytes:
    r"""Build a whole script, with the command that runs it and the line that ends it.

    Whatever ends it, but for an error, the cell is off afterwards (`on_finished`).

    Example:
        >>> encode_script(["cell_off"], "meas_loop_ocp p 1 10", OPEN_CIRCUIT)[-26:]
        b'op\non_finished:\ncell_off\n\n'
    """
    names = {TIME: "t", SET_POTENTIAL: "p", READ_POTENTIAL: "p", CURRENT: "c"}
    kept = [names[kind] for kind in technique.kinds]
    lines = ["e", *(f"var {name}" for name in kept), *setup, "timer_start", loop, "timer_get t"]
    lines += ["pck_start", *(f"pck_add {name}" for name in kept), "pck_end", "endloop"]
    return "\n".join([*lines, "on_finished:", "cell_off", "", ""]).encode("ascii")


def decode_lines(frame: bytes) -> list[str]:
    r"""Part what came into lines without their ends; XON and XOFF are left out.

    Raises:
        FrameError: It is no text, or ends within a line.

    Example:
        >>> decode_lines(b"e\nM0000\n")
        ['e', 'M0000']
    """
    plain = frame.translate(None, b"\x11\x13\r")
    try:
        lines = plain.decode("ascii").split("\n")
    except UnicodeDecodeError as error:
        raise FrameError("the answer is no text", context={"frame": frame[:200].hex()}) from error
    if lines.pop():
        raise FrameError("the answer ends within a line", context={"frame": frame[:200].hex()})
    return lines


def decode_refusal(line: str) -> RejectedError | None:
    """Read a line that tells of an error; None: it does not.

    Example:
        >>> str(decode_refusal("e!0006"))
        'the potentiostat refused: it is busy: a script runs (0006)'
    """
    found = _REFUSED.fullmatch(line)
    if found is None:
        return None
    code = found[1].upper()
    reason = ERRORS.get(code, "of a reason that its manual tells")
    where = f", line {found[2]} of the script" if found[2] else ""
    return RejectedError(
        f"the potentiostat refused: {reason} ({code}{where})", context={"code": code, "line": line}
    )


def decode_package(line: str, technique: Technique, cycle: int) -> ScriptPoint:
    """Read a line of a point.

    Raises:
        FrameError: It is none, or holds other variables than were asked for.

    Example:
        >>> decode_package("Peb80F4240u;da80186A0u;ba7FFFF9Cn,12,20A", LINEAR, 1)
        Point(time_s=1.0, potential_v=0.1, current_a=-1e-07, status=2, cycle=1)
    """
    read = [_VARIABLE.fullmatch(part) for part in line[1:].split(";")]
    told = [one for one in read if one is not None]
    kinds = tuple(one[1] for one in told)
    if not line.startswith("P") or len(told) != len(read) or kinds != technique.kinds:
        raise FrameError("the answer is no point of this measurement", context={"line": line[:200]})
    values, status = [], 0
    for one in told:
        values.append(_value(one[2], one[3]))
        marks = _STATUS.search(one[4])
        status |= int(marks[1], 16) if marks else 0
    if values[0] is None or values[1] is None:
        raise FrameError("a point has no time or no potential", context={"line": line[:200]})
    return ScriptPoint(values[0], values[1], values[2] if len(values) > 2 else None, status, cycle)


def _value(digits: str | None, prefix: str | None) -> float | None:
    if digits is None or prefix is None:
        return None
    # By decimal text: 250 µ is 0.00025, and not what a product of binary fractions leaves.
    return float(f"{int(digits, 16) - ZERO}e{EXPONENTS[prefix]}")


@dataclass(slots=True)
class ScriptOutput:
    """What a script sends, line by line, until the empty one that ends it."""

    technique: Technique
    points: list[ScriptPoint] = field(default_factory=list)
    is_over: bool = False
    _scans: int = 0
    _has_begun: bool = False
    _has_ended: bool = False

    def take(self, lines: Iterable[str]) -> None:
        """Read the next lines.

        Raises:
            DeviceError: The script failed, `device.alarm`; the cell may be on.
            FrameError: A line is none that this measurement has.
        """
        for line in lines:
            if self.is_over:
                raise FrameError("more comes after the end", context={"line": line[:200]})
            self._take(line)

    def _take(self, line: str) -> None:
        refusal = decode_refusal(line)
        if refusal is not None:
            text = refusal.message.replace("refused", "gave up")
            raise DeviceError(text, code="device.alarm", context=refusal.context)
        if not line:
            if not self._has_ended:
                raise FrameError("the script ended before its measurement")
            self.is_over = True
        elif line == f"M{self.technique.code}" and not self._has_begun:
            self._has_begun = True
        elif not self._has_begun or self._has_ended:
            raise FrameError("no line of a measurement", context={"line": line[:200]})
        elif line == "*":
            self._has_ended = True
        elif re.fullmatch(r"C[0-9A-Fa-f]{4}", line):
            self._scans += 1
        elif line != "-":
            self.points.append(decode_package(line, self.technique, max(1, self._scans)))


def summarise(output: ScriptOutput) -> dict[str, Any]:
    """Tell how many points have come, their last potential, and their extreme currents."""
    points = output.points
    told: dict[str, Any] = {"technique": output.technique.name, "points_count": len(points)}
    if points:
        told["last_potential_v"] = points[-1].potential_v
        told["overload_count"] = sum(bool(one.status & OVERLOAD) for one in points)
    currents = [one.current_a for one in points if one.current_a is not None]
    if currents:
        told["min_current_ma"] = round(min(currents) * MA_PER_A, 12)
        told["max_current_ma"] = round(max(currents) * MA_PER_A, 12)
    return told


def render_table(
    technique: Technique, points: Iterable[ScriptPoint], facts: Iterable[str]
) -> bytes:
    """Write points as a table with units: format `csv` of `docs/files.md`."""
    has_current = CURRENT in technique.kinds
    head = "time (s),potential (V)" + (",current (A),cycle (1)" if has_current else "")
    rows = [f"# technique: {technique.name}", *(f"# {fact}" for fact in facts)]
    rows.append(f"{head},status (1)")
    for point in points:
        cells = [f"{point.time_s:.9g}", f"{point.potential_v:.9g}"]
        if has_current:
            cells += ["" if point.current_a is None else f"{point.current_a:.9g}"]
            cells += [str(point.cycle)]
        rows.append(",".join([*cells, str(point.status)]))
    return "\n".join([*rows, ""]).encode("utf-8")
