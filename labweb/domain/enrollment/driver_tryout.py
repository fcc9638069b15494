"""Trying a driver on a simulated instrument: what fits, and what was tried."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import UNITS, DriverSpec, unit_suffix
from labweb.domain.messages.driver_tryouts import SimulatedModel

IDLE_S = 600.0
"""A tryout that nobody asks anything of for so long ends by itself."""

LONGEST_S = 3600.0
"""So does one that has gone on for so long."""

SILENT_S = 30.0
"""A tryout of which its host says nothing for so long is over."""

STARTS_S = 120.0
"""A tryout that has not begun by then is over."""

BEAT_S = 5.0
"""How often a host says that a tryout goes on."""

MOST_AT_ONCE = 2
"""Tryouts that one host runs side by side."""

MOST_ACTS = 500
"""Wishes that one tryout takes."""

FASTEST = 100.0
"""Simulated seconds per second, at most."""

READ_WITHIN_S = 60.0
"""How long a driver may take to tell all statuses, or to halt."""

GRACE_S = 5.0
"""How much longer than it says an action may take until the driver's process is ended."""


class AnsweredWish(msgspec.Struct, frozen=True, kw_only=True):
    """One answered wish of a tryout."""

    sort: str
    name: str
    is_ok: bool
    has_faults: bool = False
    """A fault was in force when it was answered."""


class Tried(msgspec.Struct, frozen=True, kw_only=True):
    """What all tryouts of one version have shown."""

    actions: tuple[str, ...]
    """Those that ended well while no fault was in force, in the order of the source."""

    left_out: tuple[str, ...]
    """Those that never did."""

    failed: tuple[str, ...]
    """Those that failed at least once while no fault was in force."""

    statuses_were_read: bool
    faults: tuple[str, ...]
    """Those that were in force at some time."""


def fitting(spec: DriverSpec, models: Iterable[SimulatedModel]) -> list[SimulatedModel]:
    """Return the models of the driver's class that speak through its carrier.

    That a model is in the list says no more than that the driver can be connected to it: which
    one it is written for, its author knows. One of the same name comes first.
    """
    _, _, rest = spec.module.partition(".")
    folder, _, name = rest.partition(".")
    found = [one for one in models if one.folder == folder and one.speaks == spec.transport]
    return sorted(found, key=lambda one: (one.model != name, one.model))


def labelled(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Give the entries of a schema the label and the unit that their names carry.

    Example:
        >>> labelled({"properties": {"bath_tau_s": {}}})["properties"]
        {'bath_tau_s': {'x-label': 'Bath tau', 'x-quantity': 'time', 'x-unit': 's'}}
    """
    entries = schema.get("properties", {})
    return {**schema, "properties": {name: _labelled(name, one) for name, one in entries.items()}}


def _labelled(name: str, schema: Mapping[str, Any]) -> dict[str, Any]:
    suffix = unit_suffix(name)
    quantity, symbol = UNITS.get(suffix, ("", ""))
    bare = name.removesuffix(f"_{suffix}") if suffix else name
    shown = {"x-label": bare.replace("_", " ").capitalize()}
    shown |= {"x-quantity": quantity, "x-unit": symbol} if symbol else {}
    return {**schema, **shown}


def tried(spec: DriverSpec, acts: Iterable[AnsweredWish]) -> Tried:
    """Sum up what was tried of a version."""
    done: set[str] = set()
    failed: set[str] = set()
    faults: set[str] = set()
    was_read = False
    for act in acts:
        if act.sort == "fault" and act.is_ok:
            faults.add(act.name)
        elif act.sort == "read":
            was_read = was_read or (act.is_ok and not act.has_faults)
        elif act.sort == "act" and not act.has_faults:
            (done if act.is_ok else failed).add(act.name)
    names = [action.name for action in spec.actions]
    return Tried(
        actions=tuple(name for name in names if name in done),
        left_out=tuple(name for name in names if name not in done),
        failed=tuple(name for name in names if name in failed),
        statuses_were_read=was_read,
        faults=tuple(sorted(faults)),
    )
