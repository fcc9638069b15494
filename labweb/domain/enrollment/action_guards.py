"""What guards the actions of a device once it is admitted, and what is missing.

A *permissive* is looked at once, before an action starts; an *interlock* has to hold while it
acts, else its host halts the device. labweb is a control system and no safety system: what
protects people belongs into the device and its wiring.
"""

from __future__ import annotations

from collections.abc import Collection

import msgspec

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec

WATCHDOG_RATIO = 1.5
WATCHDOG_GRACE_S = 5.0


class ActionGuard(msgspec.Struct, frozen=True):
    """One thing that guards an action, or that nothing does."""

    text: str
    is_missing: bool = False


class Guards(msgspec.Struct, frozen=True, kw_only=True):
    """All that guards one action."""

    permissives: tuple[ActionGuard, ...]
    interlocks: tuple[ActionGuard, ...]


def watchdog_s(timeout_s: float, pace: float = 1.0) -> float:
    """Return after how long, in real time, a host halts a device whose action has not ended.

    Args:
        timeout_s: Longest time of the action, lab time.
        pace: Seconds of lab time in a real one; the grace is for links, and real.

    Example:
        >>> watchdog_s(60.0), watchdog_s(7200.0, pace=20.0)
        (95.0, 545.0)
    """
    return timeout_s / pace * WATCHDOG_RATIO + WATCHDOG_GRACE_S


def guards_of(
    action: ActionSpec, spec: DriverSpec, *, before: Collection[str], after: Collection[str]
) -> Guards:
    """List what guards an action, each with whether it is there.

    Args:
        action: One of the driver's, with the limits up to which it is admitted.
        spec: The driver.
        before: Statuses that its host reads before such an action starts.
        after: Statuses that its host reads when it has ended.
    """
    return Guards(
        permissives=(*_limits(action), *_readings(action, before)),
        interlocks=(*_watchdog(action, spec), *_outcome(action, after)),
    )


def _limits(action: ActionSpec) -> list[ActionGuard]:
    open_ended = [one.name for one in action.parameters if _is_unbounded(one)]
    bounded = [one.name for one in action.parameters if _is_number(one) and not _is_unbounded(one)]
    found = [ActionGuard(f"{_listed(bounded)} within the limits")] if bounded else []
    if open_ended and action.operation != "read":
        found.append(ActionGuard(f"no highest {_listed(open_ended)}", is_missing=True))
    return found


def _readings(action: ActionSpec, before: Collection[str]) -> list[ActionGuard]:
    if before:
        return [ActionGuard(f"its host reads {_listed(before)} and finds what the plan expects")]
    if action.operation == "read":
        return []
    return [ActionGuard("no reading is looked at first", is_missing=True)]


def _watchdog(action: ActionSpec, spec: DriverSpec) -> list[ActionGuard]:
    if action.operation == "read" and not action.hazards:
        return []
    if action.timeout_s is None:
        return [ActionGuard("no longest time is stated", is_missing=True)]
    text = f"halted after {watchdog_s(action.timeout_s):g} s"
    if not spec.safe_state:
        return [
            ActionGuard(text),
            ActionGuard("what a halt leaves behind is not stated", is_missing=True),
        ]
    return [ActionGuard(text)]


def _outcome(action: ActionSpec, after: Collection[str]) -> list[ActionGuard]:
    if after:
        return [ActionGuard(f"then its host reads {_listed(after)}: else it has not done it")]
    if action.operation == "read":
        return []
    return [ActionGuard("no reading says that it has done it", is_missing=True)]


def _is_number(parameter: ParameterSpec) -> bool:
    return parameter.type in {"number", "integer"} and not parameter.choices


def _is_unbounded(parameter: ParameterSpec) -> bool:
    return _is_number(parameter) and parameter.maximum is None


def _listed(names: Collection[str]) -> str:
    """Write names as a person does.

    Example:
        >>> _listed(["a", "b", "c"])
        'a, b and c'
    """
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last
