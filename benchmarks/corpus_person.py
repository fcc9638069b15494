"""What the person of the benchmark states of the lots in a vessel, for nobody else is there.

Layers are told by names alone: water and what is dissolved in it lie below what is organic, but
for dichloromethane and chloroform, which are heavier (1.33 and 1.49 g/mL at 20 °C). Vapour takes
99 % of each liquid along, all solids are dissolved, and on a filter all of them stay.

Source:
    CRC Handbook of Chemistry and Physics, "Physical Constants of Organic Compounds", densities.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

_BOILS_OFF = 0.99
_SMALLEST_UL, _SMALLEST_MG = 1.0, 1.0
"""Less is not stated."""

_AQUEOUS = re.compile(
    r"water|brine|\baq|hcl|hydrochloric|naoh|hydroxide|carbonate|nh4|ammoni|\d ?m\b|nacl|sulfate",
    re.IGNORECASE,
)
_HEAVY = re.compile(r"dcm|dichloromethane|ch2cl2|chloroform|chcl3", re.IGNORECASE)


def stated(label: str, lots: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return what is said of each lot, by its key, as it would be typed.

    Args:
        label: What is asked for.
        lots: Each with `key`, `name`, and `held_ul` or `held_mg`.

    Raises:
        KeyError: Nobody has told the person what to say there.
    """
    if label == "Lower layer":
        return _lower(lots)
    share = {"Boils off": _BOILS_OFF, "Solids that go along": 1.0, "Stays": 1.0}[label]
    told = {lot["key"]: _amount(lot, share) for lot in lots}
    return {key: text for key, text in told.items() if text}


def _lower(lots: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the layer of water, or the organic one where that is heavier, with the solids.

    Where names tell no two layers apart, half of each lot lies below.
    """
    liquids = [lot for lot in lots if lot["held_ul"] is not None]
    is_water = {lot["key"]: _is(_AQUEOUS, lot) and not _is(_HEAVY, lot) for lot in liquids}
    heavy_ul = sum(lot["held_ul"] for lot in liquids if _is(_HEAVY, lot))
    organic_ul = sum(lot["held_ul"] for lot in liquids if not is_water[lot["key"]])
    is_water_below = not heavy_ul or heavy_ul * 2 < organic_ul
    below = [key for key, aqueous in is_water.items() if aqueous is is_water_below]
    if not 0 < len(below) < len(liquids):  # the names tell no two layers apart
        halves = {lot["key"]: _amount(lot, 0.5) for lot in lots}
        return {key: text for key, text in halves.items() if text}
    solids = [] if is_water_below else [lot["key"] for lot in lots if lot["held_ul"] is None]
    return dict.fromkeys([*below, *solids], "all")


def _is(pattern: re.Pattern[str], lot: Mapping[str, Any]) -> bool:
    return pattern.search(lot["key"]) is not None


def _amount(lot: Mapping[str, Any], share: float) -> str:
    if share == 1.0:
        return "all"
    if lot["held_ul"] is None:
        return f"{lot['held_mg'] * share:.0f} mg" if lot["held_mg"] * share >= _SMALLEST_MG else ""
    return f"{lot['held_ul'] * share:.0f} uL" if lot["held_ul"] * share >= _SMALLEST_UL else ""
