"""What an action leaves set on its device, by which readings one sees it, and when it is gone.

The words are those of `drivers/interfaces`. A driver that has a status of that name can be read
back; one that has none cannot, and only the progress of its actions is watched. Times are lab
time: seconds of the clock that the instruments live by.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from labweb.domain.enrollment.status_wording import spoken_name, spoken_value

LOOK_S = 5.0
"""How often a device is read back while an action waits for it, lab time."""

SURE_S = 10.0
"""How long a reading has to be wrong before what was set counts as gone."""

TAKE_S = 30.0
"""The same for a set-point that was never read back as it was set."""

QUIET_S = 30.0
"""How long what stands may stay unread before a person is told, lab time."""

TRAVEL_S = 2.0
"""The same in real time, at least: a reading needs some to reach the server."""


class ReadbackVerdict(StrEnum):
    """What a reading says of what was set."""

    SETPOINT = "setpoint"
    """The number that was asked for, as the device keeps it."""

    SWITCH = "switch"
    """Whether it is on."""

    MOTION = "motion"
    """How fast it really turns: the code `device.stalled`."""


@dataclass(frozen=True, slots=True)
class Near:
    """How far a reading may be from what was asked for: what devices round."""

    absolute: float
    ratio: float = 0.0

    def of(self, value: float) -> float:
        """Return how far it may be from a value, in the value's unit."""
        return self.absolute + self.ratio * abs(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptReading:
    """One reading that has to stay as an action has set it."""

    status: str
    sort: ReadbackVerdict
    asked: float

    def fits(self, value: float) -> bool:
        """Say whether a reading shows what was asked for, as the device rounds it."""
        if self.sort is ReadbackVerdict.SWITCH:
            return bool(value) == bool(self.asked)
        if self.sort is ReadbackVerdict.MOTION:
            return abs(value) >= STALLED_RATIO * abs(self.asked)
        return abs(value - self.asked) <= _NEAR[self.status].of(self.asked)

    def stays(self, value: float, base: float) -> bool:
        """Say whether a reading is as it was when it was first read back."""
        if self.sort is not ReadbackVerdict.SETPOINT:
            return self.fits(value)
        return abs(value - base) <= _NEAR[self.status].of(self.asked) / 2

    def reason(self, value: float) -> str:
        """Say what is read, what it should be, and what may be the cause."""
        why = "the device has restarted, or somebody has changed it"
        if self.sort is ReadbackVerdict.MOTION:
            why = "what it moves is blocked, or the motor is off"
        return f"{self.wording(value)}: {why}"

    def wording(self, value: float) -> str:
        """Say what is read and what it should be, as people say it.

        Example:
            >>> Kept(status="speed_rpm", sort=Sort.MOTION, asked=400.0).wording(0.0)
            'the speed reads 0 rpm; 400 rpm was set'
            >>> Kept(status="is_heating", sort=Sort.SWITCH, asked=True).wording(False)
            'heating is off; it was switched on'
        """
        name = spoken_name(self.status)
        if self.sort is ReadbackVerdict.SWITCH:
            is_on, was_on = ("on" if one else "off" for one in (value, self.asked))
            return f"{name} is {is_on}; it was switched {was_on}"
        read, asked = (spoken_value(self.status, float(one)) for one in (value, self.asked))
        return f"the {name} reads {read}; {asked} was set"


@dataclass(frozen=True, slots=True)
class Seen:
    """What was read back so far of one thing that is kept."""

    base: float | None = None
    """The first reading that fitted; None: none did yet."""

    wrong_since_s: float | None = None
    """Since when every reading was wrong; None: the last one was right, or there was none."""

    is_lost: bool = False


STALLED_RATIO = 0.5
"""What turns at less than this share of its speed is stalled or off."""

_NEAR: Mapping[str, Near] = {
    "bath_setpoint_c": Near(0.6),
    "current_setpoint_ma": Near(2.0, 0.02),
    "pressure_setpoint_kpa": Near(0.2, 0.02),
    "rate_setpoint_ul_s": Near(0.0, 0.1),
    "speed_setpoint_rpm": Near(1.0, 0.02),
    "temperature_setpoint_c": Near(0.6),
    "voltage_setpoint_v": Near(0.02, 0.02),
}
"""What set-points may differ by from what was asked for: the coarsest steps of the devices."""


def _setpoint(status: str, argument: str) -> tuple[str, ReadbackVerdict, str]:
    return status, ReadbackVerdict.SETPOINT, argument


def _switch(status: str) -> tuple[str, ReadbackVerdict, str]:
    return status, ReadbackVerdict.SWITCH, ""


_TURNS = (
    _setpoint("speed_setpoint_rpm", "speed_rpm"),
    ("speed_rpm", ReadbackVerdict.MOTION, "speed_rpm"),
)
_CONTROLS = (
    _setpoint("temperature_setpoint_c", "temperature_c"),
    _switch("is_controlling"),
    _switch("is_heating"),
)
_SETS: Mapping[str, tuple[tuple[str, ReadbackVerdict, str], ...]] = {
    "deliver": (_setpoint("rate_setpoint_ul_s", "rate_ul_s"),),
    "evacuate_to": (
        _setpoint("pressure_setpoint_kpa", "pressure_kpa"),
        _switch("is_controlling"),
    ),
    "heat_bath_to": (_setpoint("bath_setpoint_c", "temperature_c"),),
    "heat_to": _CONTROLS,
    "hold": _CONTROLS,
    "ramp_to": _CONTROLS,
    "reach_temperature": _CONTROLS,
    "rotate": _TURNS,
    "shake": _TURNS,
    "start_flow": (_setpoint("rate_setpoint_ul_s", "rate_ul_s"), _switch("is_running")),
    "stir": _TURNS,
    "supply": (
        _setpoint("voltage_setpoint_v", "voltage_v"),
        _setpoint("current_setpoint_ma", "current_ma"),
    ),
}
"""Actions that leave something set, each with the statuses by which one sees it.

Not among them: `is_pumping`, since a pump that holds a pressure rests by itself, and `voltage_v`,
which the load decides.
"""


def setting_actions() -> frozenset[str]:
    """Return the actions that leave something set."""
    return frozenset(_SETS)


def names_set_by(action: str) -> frozenset[str]:
    """Return the statuses that tell what an action has set."""
    return frozenset(status for status, _, _ in _SETS.get(action, ()))


def kept_by(
    action: str, args: Mapping[str, Any], statuses: Collection[str]
) -> tuple[KeptReading, ...]:
    """Return what has to stay as an action sets it, as far as its device tells.

    Args:
        action: Name of the action.
        args: As they are sent to the device.
        statuses: What the device tells. None of them: it cannot be read back.

    Example:
        >>> [one.status for one in kept_by("heat_to", {"temperature_c": 60.0},
        ...     ["temperature_c", "temperature_setpoint_c"])]
        ['temperature_setpoint_c']
    """
    found = []
    for status, sort, argument in _SETS.get(action, ()):
        asked = True if sort is ReadbackVerdict.SWITCH else args.get(argument)
        if status in statuses and asked is not None:
            found.append(KeptReading(status=status, sort=sort, asked=asked))
    return tuple(found)


def completed(kept: KeptReading) -> Seen:
    """Return where to begin with an action that has completed: it runs, or turns, by then."""
    return Seen() if kept.sort is ReadbackVerdict.SETPOINT else Seen(kept.asked)


def look(kept: KeptReading, seen: Seen, value: object, at_s: float) -> Seen:
    """Judge one reading.

    What is no number says nothing. A set-point counts as gone once it was wrong for `SURE_S`;
    one that was never read back as it was set, for `TAKE_S`. A switch and a motion have to be
    seen on first: what takes time to begin is not lost.

    Args:
        kept: What has to stay.
        seen: What was read before.
        value: The reading.
        at_s: When it was read, lab time.

    Example:
        >>> stirs = Kept(status="speed_rpm", sort=Sort.MOTION, asked=400.0)
        >>> seen = Seen()
        >>> for at_s, rpm in ((0, 0.0), (2, 398.0), (4, 0.0), (15, 0.0)):
        ...     seen = look(stirs, seen, rpm, at_s)
        >>> seen.is_lost
        True
    """
    if not isinstance(value, int | float) or value != value:
        return seen
    is_right = kept.fits(value) if seen.base is None else kept.stays(value, seen.base)
    if is_right:
        return Seen(value if seen.base is None else seen.base)
    if seen.base is None and kept.sort is not ReadbackVerdict.SETPOINT:
        return seen
    since_s = at_s if seen.wrong_since_s is None else seen.wrong_since_s
    patience_s = TAKE_S if seen.base is None else SURE_S
    return replace(seen, wrong_since_s=since_s, is_lost=at_s - since_s >= patience_s)


def unread_since_s(
    all_kept: Iterable[KeptReading],
    read_s: Mapping[str, float],
    done_s: float,
    now_s: float,
    pace: float,
) -> float | None:
    """Return since when nothing was read of what stands on a device; None: it is read.

    Args:
        all_kept: What has to stay. Nothing: it cannot be read back at all, and is not waited for.
        read_s: When each status was read last, real time; without those that never were.
        done_s: When the last of it was set, real time.
        now_s: This moment, real time.
        pace: Seconds of lab time in a real one.

    Example:
        >>> heat = Kept(status="temperature_setpoint_c", sort=Sort.SETPOINT, asked=60.0)
        >>> unread_since_s([heat], {"temperature_setpoint_c": 100.0}, 90.0, 129.0, 1.0)
        >>> unread_since_s([heat], {"temperature_setpoint_c": 100.0}, 90.0, 130.0, 1.0)
        100.0
    """
    statuses = {one.status for one in all_kept}
    if not statuses:
        return None
    since_s = max([done_s, *(at_s for status, at_s in read_s.items() if status in statuses)])
    return since_s if now_s - since_s >= max(QUIET_S / pace, TRAVEL_S) else None
