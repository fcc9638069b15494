"""Which changes would cure a finding, by its code and facts and never by its message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.recipes.advise.rig_changes import DrawableChange
from labweb.domain.recipes.on_rig.equipment import VesselSort

Facts = Mapping[str, Any]
_DRAWN = frozenset(sort.value for sort in VesselSort) - {VesselSort.PLAIN.value}
_UL_PER_ML = 1000


def cures(finding: Finding) -> list[DrawableChange]:
    """List the changes of which each would cure a finding; none: no plumbing does."""
    facts = finding.context
    if "from" in facts:
        return _ways(finding, facts)
    found = _CURES.get(finding.code)
    return [] if found is None else found(facts)


def _ways(finding: Finding, facts: Facts) -> list[DrawableChange]:
    source, target = str(facts["from"]), str(facts["to"])
    if facts["through"] and not (finding.code == "plan.no_tube" and facts["at"]):
        return [DrawableChange("move_cartridge", str(key)) for key in facts["through"]]
    if finding.code == "plan.no_tube":
        end = str(facts["at"] or source)
        return [DrawableChange("join", end, "in" if end == target else "out")]
    return [DrawableChange("join", source, "out"), DrawableChange("join", target, "in")]


def _reagent(facts: Facts) -> list[DrawableChange]:
    if facts.get("differs_in_case_alone"):
        return []  # It is there: somebody has to say so.
    return [DrawableChange("add_flask", str(facts["reagent"]))]


def _vessel(facts: Facts) -> list[DrawableChange]:
    sort = str(facts.get("sort"))
    return [DrawableChange("add_vessel", str(facts["role"]), sort)] if sort in _DRAWN else []


def _gas(facts: Facts) -> list[DrawableChange]:
    if "vessel" in facts:
        gas = "" if facts.get("is_any_inert") else str(facts["gas"])
        return [DrawableChange("join_gas", str(facts["vessel"]), gas)]
    return [DrawableChange("add_flask", "nitrogen")]


def _overflow(facts: Facts) -> list[DrawableChange]:
    return [DrawableChange("enlarge", str(facts["vessel"]), float(facts["needed_ul"]) / _UL_PER_ML)]


def _thermostat(facts: Facts) -> list[DrawableChange]:
    if "vessel" not in facts:
        return []
    return [
        DrawableChange("attach_thermostat", str(facts["vessel"]), (float(facts["temperature_c"]),))
    ]


def _vacuum(facts: Facts) -> list[DrawableChange]:
    vessel = str(facts["vessel"])
    return [
        DrawableChange("join_vacuum", vessel, "shared"),
        DrawableChange("join_vacuum", vessel, "own"),
    ]


def _shared(facts: Facts) -> list[DrawableChange]:
    if "other" not in facts:
        return []
    return [DrawableChange("own_vacuum", str(facts["other"]), str(facts["pump"]))]


def _condenser(facts: Facts) -> list[DrawableChange]:
    if "target" not in facts:
        return [DrawableChange("add_receiver", str(facts["vessel"]))]
    return [DrawableChange("attach_condenser", str(facts["vessel"]), str(facts["target"]))]


def _waste(facts: Facts) -> list[DrawableChange]:
    """Return one more waste: for the streams that none takes, or for what one must not get."""
    if not facts.get("is_waste", True):
        return []
    liquid = str(facts.get("coming", ""))
    return [DrawableChange("add_waste", liquid, ",".join(facts["streams"]))]


_CURES: Mapping[str, Callable[[Facts], list[DrawableChange]]] = {
    "plan.no_reagent": _reagent,
    "plan.no_vessel": _vessel,
    "plan.no_waste": lambda facts: [
        DrawableChange("add_vessel", "waste", VesselSort.WASTE.value),
        DrawableChange("join", str(facts["vessel"]), "out"),
    ],
    "plan.no_stream": _waste,
    "plan.incompatible": _waste,
    "plan.no_buffer": lambda facts: [
        DrawableChange("add_flask", ""),
        DrawableChange("join", str(facts["vessel"]), "out"),
        DrawableChange("join", str(facts["vessel"]), "in"),
    ],
    "plan.no_cartridge": lambda facts: [DrawableChange("add_cartridge", str(facts["filling"]))],
    "plan.overflow": _overflow,
    "plan.no_stirrer": lambda facts: [DrawableChange("attach", str(facts["vessel"]), "stirrer")],
    "plan.no_thermostat": _thermostat,
    "plan.out_of_range": _thermostat,
    "plan.no_vacuum": _vacuum,
    "plan.vacuum_shared": _shared,
    "plan.no_gas": _gas,
    "plan.no_lamp": lambda facts: [DrawableChange("attach", str(facts["vessel"]), "lamp")],
    "plan.no_ultrasound": lambda facts: [
        DrawableChange("attach", str(facts["vessel"]), "ultrasonic bath")
    ],
    "plan.no_microwave": lambda facts: [
        DrawableChange("attach", str(facts["vessel"]), "microwave")
    ],
    "plan.no_condenser": _condenser,
    "plan.no_sensor": lambda facts: [
        DrawableChange("attach_sensor", str(facts["vessel"]), str(facts["quantity"]))
    ],
}
