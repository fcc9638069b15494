"""What a node says about liquid: how much it can hold, and what it holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeGuard

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import NL_PER_ML, NL_PER_UL
from labweb.domain.graph.lab_file.uni_lab_os.format_words import ENDLESS, is_pylabrobot
from labweb.domain.graph.lab_file.untrusted_json import MAX_FOREIGN_TEXT
from labweb.domain.resources.exact_volumes import to_nl

UNKNOWN = "unknown"
"""Material of a liquid that the file gives an amount of, but no name."""


@dataclass
class NodeLiquid:
    """What a vessel can hold and holds, as far as the file says it."""

    capacity_ul: float | None = None
    amounts_nl: dict[str, int] = field(default_factory=dict)
    """Liquid type → nanolitres."""

    notes: list[Finding] = field(default_factory=list)


def nl_per_unit(config: object) -> int:
    """Return what one unit of volume of a node is: PyLabRobot counts µL, the format mL."""
    return NL_PER_UL if is_pylabrobot(config) else NL_PER_ML


def read_holding(key: str, raw: Mapping[str, Any]) -> NodeLiquid:
    """Read capacity and liquids of one node; what cannot be read is noted, never guessed."""
    config = _mapping(raw.get("config"))
    scale = nl_per_unit(config)
    holding = NodeLiquid()
    said = [one for one in (config.get("max_volume"), raw.get("max_volume")) if one is not None]
    capacity_nl = next((nl for one in said if _is_number(one) and (nl := to_nl(one, scale))), None)
    if capacity_nl:
        holding.capacity_ul = capacity_nl / 1000 if capacity_nl % 1000 else capacity_nl // 1000
    elif said and not (scale == NL_PER_UL and said == [ENDLESS]):
        text = f"{key}: the size {said[0]!r} is none in whole nanolitres; kept as written"
        holding.notes.append(Finding("uni_lab_os.amount_unread", text, key))
    liquids = _liquids(key, raw, holding.notes)
    for name, amount in liquids:
        _add(key, name, amount, scale, holding)
    _check_capacity(key, holding)
    return holding


def _add(key: str, name: object, amount: object, scale: int, holding: NodeLiquid) -> None:
    if not _is_number(amount):
        text = f"{key}: the amount {amount!r} of {name!r} is no number; kept as written"
        holding.notes.append(Finding("uni_lab_os.amount_unread", text, key))
        return
    if amount == 0:
        return
    amount_nl = to_nl(amount, scale)
    if amount_nl is None:
        text = (
            f"{key}: the amount {amount!r} of {name!r} is off the nanolitre grid; kept as written"
        )
        holding.notes.append(Finding("uni_lab_os.off_grid", text, key))
        return
    if isinstance(name, str) and len(name) > MAX_FOREIGN_TEXT:
        text = f"{key}: a liquid's name is too long; kept as written"
        holding.notes.append(Finding("uni_lab_os.amount_unread", text, key))
        return
    liquid = name if isinstance(name, str) and name else UNKNOWN
    holding.amounts_nl[liquid] = holding.amounts_nl.get(liquid, 0) + amount_nl


def _check_capacity(key: str, holding: NodeLiquid) -> None:
    held_nl = sum(holding.amounts_nl.values())
    if holding.capacity_ul is None or held_nl <= holding.capacity_ul * 1000:
        return
    text = (
        f"{key}: {held_nl / 1000} µL in a vessel of {holding.capacity_ul} µL cannot be; "
        "the liquids are kept as written and not imported"
    )
    holding.notes.append(Finding("uni_lab_os.overfull", text, key))
    holding.amounts_nl = {}


def _liquids(key: str, raw: Mapping[str, Any], notes: list[Finding]) -> list[tuple[object, object]]:
    data = _mapping(raw.get("data"))
    if _is_number(data.get("current_mass")):
        text = f"{key}: a mass of {data['current_mass']!r} is kept as written; it is no volume"
        notes.append(Finding("uni_lab_os.mass", text, key))
    told = {
        "data.liquid": _listed(data.get("liquid")),
        "data.liquids": _listed(data.get("liquids")),
        "data.liquid_volume": [(data.get("liquid_type"), data["liquid_volume"])]
        if "liquid_volume" in data
        else [],
        "current_volume": [(raw.get("chemical"), raw["current_volume"])]
        if raw.get("current_volume")
        else [],
    }
    filled = {place: liquids for place, liquids in told.items() if liquids}
    if len(filled) > 1 and any(
        liquids != next(iter(filled.values())) for liquids in filled.values()
    ):
        text = f"{key}: {' and '.join(filled)} say different things; kept as written, not imported"
        notes.append(Finding("uni_lab_os.liquids_differ", text, key))
        return []
    return next(iter(filled.values()), [])


def _listed(value: object) -> list[tuple[object, object]]:
    """Read `[{"liquid_type", "liquid_volume"}]`, `[{"name", "volume"}]` or `[["DMF", 500.0]]`."""
    found: list[tuple[object, object]] = []
    for part in value if isinstance(value, list) else []:
        if isinstance(part, Mapping):
            name = part.get("liquid_type", part.get("name"))
            found.append((name, part.get("liquid_volume", part.get("volume"))))
        elif isinstance(part, list) and len(part) == 2:
            found.append((part[0], part[1]))
        else:
            found.append((None, part))
    return found


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
