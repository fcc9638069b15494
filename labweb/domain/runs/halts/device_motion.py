"""Whether a device stands, by what it tells of itself."""

from __future__ import annotations

_PLACES = ("_ul", "_mm", "_deg", "_index", "_state", "position")
"""Ends of the names of places and states: what stands tells the same twice."""

_RATES = ("_ul_s", "_mm_s", "_rpm")
"""Ends of the names of rates: what stands tells nought, and what turns evenly the same twice."""

_GOING = frozenset({"is_driving", "is_measuring", "is_moving", "is_pumping", "is_running"})
"""What a device tells of its own motion. That it is connected, open or ready tells nothing."""


def tells_motion(status: str) -> bool:
    """Say whether a status shows whether a device stands.

    Temperature, pressure and mass go on changing at a device that stands; a set-point is a
    number that it keeps.

    Example:
        >>> [tells_motion(name) for name in ("volume_ul", "is_running", "speed_setpoint_rpm")]
        [True, True, False]
    """
    return status in _GOING or ("_setpoint_" not in status and status.endswith(_PLACES + _RATES))


def is_moving(status: str, before: object, now: object) -> bool:
    """Say whether two readings in a row of a status that tells motion show some.

    Example:
        >>> is_moving("speed_rpm", 400.0, 400.0), is_moving("volume_ul", 80.0, 80.0)
        (True, False)
    """
    if status in _GOING or status.endswith(_RATES):
        return bool(now)
    return now != before
