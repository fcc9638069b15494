"""What the EmStat Pico measures within, and where its answers end.

Source:
    PalmSens, EmStat Pico communication protocol V1.6, chapters 2 to 4; MethodSCRIPT manual V1.8,
    appendix B (modes, potentials, bandwidths of the EmStat Pico).
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import NamedTuple

from drivers.characterization._methodscript import encode_number
from drivers.waiting import refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, PreconditionError, RejectedError

MOST_POINTS = 200_000
MOST_INTERVAL_S, MOST_DURATION_S = 60.0, 86_400.0
"""From point to point, and of a whole measurement: a stop waits for the point that is measured."""

BANDWIDTH_PER_RATE = 4.0
"""As the maker's own software sets it: four times the rate of points."""


_TYPE = re.compile(rb"(?:^|\n)(t(espico[0-9]*)#[^\n]*\n[RB]\*\n)")


class EmstatMode(NamedTuple):
    """How the front end works, appendix B."""

    name: str
    number: int
    low_v: float
    high_v: float
    window_v: float
    """Furthest that two potentials of one measurement may be apart."""

    most_hz: float
    least_interval_s: float


MODES = {
    "low_speed": EmstatMode("low_speed", 2, -1.25, 2.0, 2.2, 100.0, 0.04),
    "high_speed": EmstatMode("high_speed", 3, -1.7, 2.0, 1.214, 200_000.0, 0.01),
}


def lines_before(mode: EmstatMode, interval_s: float, coarsest_a: float) -> list[str]:
    """Return the lines that set channel, mode and ranges.

    Raises:
        PreconditionError: The mode does not measure that often.
    """
    if interval_s < mode.least_interval_s:
        raise PreconditionError(
            f"a point every {interval_s:g} s was asked for; {mode.name} measures one every "
            f"{mode.least_interval_s:g} s at most",
            code="device.limit",
            context={"least_interval_s": mode.least_interval_s},
        )
    bandwidth_hz = min(mode.most_hz, max(1.0, round(BANDWIDTH_PER_RATE / interval_s)))
    coarsest = encode_number(coarsest_a)
    return [
        "set_pgstat_chan 0",
        f"set_pgstat_mode {mode.number}",
        f"set_max_bandwidth {encode_number(bandwidth_hz)}",
        f"set_range ba {coarsest}",
        f"set_autoranging ba 100n {coarsest}",
    ]


def lines_on(first: str, low: str, high: str) -> list[str]:
    """Return the lines that turn the cell on at a potential."""
    return [f"set_range_minmax da {low} {high}", f"set_e {first}", "cell_on"]


def ordered(*potentials_v: float) -> tuple[str, str]:
    """Write the lowest and the highest of some potentials."""
    return encode_number(min(potentials_v)), encode_number(max(potentials_v))


def refuse_potentials(
    mode: EmstatMode, low_v: float, high_v: float, potentials_v: tuple[float, ...]
) -> None:
    """Refuse what the mode or the cell of this lab do not bear.

    Raises:
        PreconditionError: One is beyond them, or two are too far apart.
    """
    for potential_v in potentials_v:
        refuse_beyond("potential", potential_v, max(mode.low_v, low_v), min(mode.high_v, high_v))
    spread_v = max(potentials_v) - min(potentials_v)
    refuse_beyond("span of potentials", spread_v, 0, mode.window_v)


def refuse_too_many(count: int) -> None:
    """Refuse more points than one table holds.

    Raises:
        PreconditionError: There are more.
    """
    if count > MOST_POINTS:
        raise PreconditionError(
            f"{count} points were asked for; at most {MOST_POINTS} are kept", code="device.limit"
        )


def count_points(duration_s: float, interval_s: float) -> int:
    """Return how many points a time holds.

    Raises:
        PreconditionError: None.
    """
    if duration_s < interval_s:
        raise PreconditionError(
            f"{duration_s:g} s hold no point every {interval_s:g} s", code="device.limit"
        )
    return round(duration_s / interval_s)


def count_steps(
    step_v: float, way: tuple[float, ...], rate_v_s: float, cycles_count: int = 1
) -> int:
    """Return how many steps a way from potential to potential has, over all its cycles.

    Raises:
        PreconditionError: None, or a step or the whole way takes longer than is waited for.

    Example:
        >>> count_steps(0.1, (0.0, 0.5, 0.0), 1.0, 2)
        20
    """
    steps = sum(round(abs(there - here) / step_v) for here, there in pairwise(way))
    if steps < 1:
        raise PreconditionError(
            f"a step of {step_v:g} V leaves nothing between {way}", code="device.resolution"
        )
    way_v = sum(abs(there - here) for here, there in pairwise(way))
    refuse_beyond("time of a step in s", step_v / rate_v_s, 0, MOST_INTERVAL_S)
    refuse_beyond("time of the sweep in s", cycles_count * way_v / rate_v_s, 0, MOST_DURATION_S)
    return steps * cycles_count


def refuse_short(count: int, planned: int) -> None:
    """Refuse a measurement that has ended early, as one that somebody aborted at another place.

    The last point of a cycle may be counted with the next one.

    Raises:
        DeviceError: Points are missing.
    """
    missing = planned - count
    if missing > 1 + planned // 100:
        raise DeviceError(
            f"it ended {missing} points early: somebody aborted it, or lines were lost",
            code="device.not_reached",
        )


def decode_version(frame: bytes) -> bytes:
    r"""Read the answer to `t`, without the points of a script that may stand before it.

    Raises:
        RejectedError: Another instrument answers.
        FrameError: It is no such answer.

    Example:
        >>> decode_version(b"tespico1400#Oct 10 2026 12:00:00\nR*\n")[:11]
        b'tespico1400'
    """
    found = _TYPE.search(frame)
    if found is None:
        kind = RejectedError if re.search(rb"(?:^|\n)t[a-z]", frame) else FrameError
        raise kind("no EmStat Pico answers", context={"frame": frame[:200].hex()})
    return found[1]


def whole_lines(received: bytes) -> int | None:
    """Tell where the last line has ended, if nothing is begun behind it."""
    return len(received) if received.endswith(b"\n") else None


def whole_version(received: bytes) -> int | None:
    r"""Tell where the answer to `t` has ended: an asterisk ends its second line, or it is an error.

    Example:
        >>> whole_version(b"tespico1400#Oct 10 2026 12:00:00\nR*\n")
        36
    """
    found = re.search(rb"(?:^|\n)t(?:![^\n]*|[^\n]*\n[^\n]*\*)\n", received)
    return None if found is None else found.end()


def whole_after_script(received: bytes) -> int | None:
    r"""Tell where a script without a measurement has ended: by an empty line, or by an error.

    Example:
        >>> whole_after_script(b"e\n"), whole_after_script(b"e\n\n")
        (None, 3)
    """
    found = re.search(rb"(?:^|\n)(?:[A-Za-z]?![^\n]*)?\n", received)
    return None if found is None else found.end()


def whole_after_abort(received: bytes) -> int | None:
    r"""Tell where a script has ended that was told to: `Z`, then its last lines and an empty one.

    Example:
        >>> whole_after_abort(b"Pab8000000 \nZ\n*\n"), whole_after_abort(b"Z!0006\n")
        (None, 7)
    """
    found = re.search(rb"(?:^|\n)Z(![^\n]*)?(?=\n)", received)
    if found is None:
        return None
    if found[1]:
        return found.end() + 1
    end = re.compile(rb"\n(?:![^\n]*)?(?=\n)").search(received, found.end())
    return None if end is None else end.end() + 1
