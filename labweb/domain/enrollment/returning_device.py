"""What has changed of a device since a person admitted it last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import msgspec

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec, StatusSpec

_Named = TypeVar("_Named", ActionSpec, StatusSpec, ParameterSpec)


class KnownDevice(msgspec.Struct, frozen=True, kw_only=True):
    """What a device was when it was admitted, or is."""

    driver_digest: str
    transport: str
    host: str
    config: dict[str, Any]
    nodes: dict[str, str]
    """Role → where it stands, in words."""

    public_key: str = ""
    serial: str = ""
    model: str = ""
    label: str = ""
    """What a person read on the thing; no part of what is compared."""


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that is not as it was."""

    what: str
    before: str
    after: str
    action: str = ""
    """Action that it is about; "" for none."""

    is_new: bool = False
    """The action was not there when the device was admitted."""


def compare_identity(before: KnownDevice, after: KnownDevice) -> list[Difference]:
    """List what is another thing, or stands elsewhere, or is set otherwise."""
    pairs = [
        ("key", before.public_key, after.public_key),
        ("serial number", before.serial, after.serial),
        ("model", before.model, after.model),
        ("driver version", before.driver_digest, after.driver_digest),
        ("host", before.host, after.host),
        ("carrier", before.transport, after.transport),
        *_each("setting", before.config, after.config),
        *_each("place as", before.nodes, after.nodes),
    ]
    return [
        Difference(what=what, before=old or "none", after=new or "none")
        for what, old, new in pairs
        if old != new
    ]


def compare_capabilities(before: DriverSpec, after: DriverSpec) -> list[Difference]:
    """List what the driver declares otherwise: actions, statuses, and what a halt leaves."""
    found = [*_actions(before, after), *_statuses(before, after)]
    if before.safe_state != after.safe_state:
        old, new = before.safe_state or "not stated", after.safe_state or "not stated"
        found.append(Difference(what="safe state", before=old, after=new))
    return found


def _actions(before: DriverSpec, after: DriverSpec) -> list[Difference]:
    old, new = _by_name(before.actions), _by_name(after.actions)
    found = []
    for name in [*new, *(name for name in old if name not in new)]:
        if name not in old:
            found.append(
                Difference(
                    what=f"action {name}",
                    before="not there",
                    after=_action_text(new[name]),
                    action=name,
                    is_new=True,
                )
            )
        elif name not in new:
            text = _action_text(old[name])
            found.append(Difference(what=f"action {name}", before=text, after="gone", action=name))
        else:
            found += _of_action(old[name], new[name])
    return found


def _of_action(before: ActionSpec, after: ActionSpec) -> list[Difference]:
    old, new = _by_name(before.parameters), _by_name(after.parameters)
    pairs = [
        *(
            (f"{after.name}, {name}", _told(old.get(name)), _told(new.get(name)))
            for name in dict.fromkeys([*old, *new])
        ),
        (f"{after.name}, hazards", _hazards(before), _hazards(after)),
        (f"{after.name}, longest", _seconds(before.timeout_s), _seconds(after.timeout_s)),
        (f"{after.name}, if the outcome is unknown", before.recovery, after.recovery),
        (f"{after.name}, what it does to the record", before.operation, after.operation),
    ]
    return [
        Difference(what=what, before=a, after=b, action=after.name)
        for what, a, b in pairs
        if a != b
    ]


def _statuses(before: DriverSpec, after: DriverSpec) -> list[Difference]:
    old, new = _by_name(before.statuses), _by_name(after.statuses)
    pairs = [
        (f"status {name}", _status_text(old.get(name)), _status_text(new.get(name)))
        for name in dict.fromkeys([*old, *new])
    ]
    return [Difference(what=what, before=a, after=b) for what, a, b in pairs if a != b]


def _by_name(rows: Sequence[_Named]) -> dict[str, _Named]:
    return {row.name: row for row in rows}


def _action_text(action: ActionSpec) -> str:
    takes = ", ".join(f"{one.name} {_told(one)}".strip() for one in action.parameters)
    text = f"takes {takes}" if takes else "takes nothing"
    return f"{text}; {_hazards(action)}" if action.hazards else text


def _told(parameter: ParameterSpec | None) -> str:
    """Write what a parameter may be."""
    if parameter is None:
        return "not there"
    if parameter.choices:
        return "one of " + ", ".join(map(str, parameter.choices))
    low, high = parameter.minimum, parameter.maximum
    bounds = [f"≥ {low:g}" if low is not None else "", f"≤ {high:g}" if high is not None else ""]
    text = ", ".join(one for one in bounds if one) or (parameter.type or "anything")
    return f"{text} {parameter.symbol}".strip()


def _status_text(status: StatusSpec | None) -> str:
    if status is None:
        return "not there"
    every = "" if status.every_s is None else f", every {status.every_s:g} s"
    return f"{status.value.type or 'anything'} {status.value.symbol}".strip() + every


def _hazards(action: ActionSpec) -> str:
    return ", ".join(action.hazards) or "none"


def _seconds(value: float | None) -> str:
    return "not stated" if value is None else f"{value:g} s"


def _each(
    word: str, before: Mapping[str, object], after: Mapping[str, object]
) -> list[tuple[str, str, str]]:
    names = dict.fromkeys([*before, *after])
    return [(f"{word} {name}", _text(before, name), _text(after, name)) for name in names]


def _text(values: Mapping[str, object], name: str) -> str:
    return str(values[name]) if name in values else ""
