"""Which changes would cure a finding, by its code and facts and never by its message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.recipes.advise.rig_changes import Change
from labweb.domain.recipes.on_rig.equipment import Sort

Facts = Mapping[str, Any]
_DRAWN = frozenset(sort.value for sort in Sort) - {Sort.PLAIN.value}
_UL_PER_ML = 1000


def cures(finding: Finding) -> list[Change]:
    """List the changes of which each would cure a finding; none: no plumbing does."""
    facts = finding.context
    if "from" in facts:
        return _ways(finding, facts)
    found = _CURES.get(finding.code)
    return [] if found is None else found(facts)


def _ways(finding: Finding, facts: Facts) -> list[Change]:
    source, target = str(facts["from"]), str(facts["to"])
    if facts["through"] and not (finding.code == "plan.no_tube" and facts["at"]):
        return [Change("move_cartridge", str(key)) for key in facts["through"]]
    if finding.code == "plan.no_tube":
        end = str(facts["at"] or source)
        return [Change("join", end, "in" if end == target else "out")]
    return [Change("join", source, "out"), Change("join", target, "in")]


def _reagent(facts: Facts) -> list[Change]:
    if facts.get("differs_in_case_alone"):
        return []  # It is there: somebody has to say so.
    return [Change("add_flask", str(facts["reagent"]))]


def _vessel(facts: Facts) -> list[Change]:
    sort = str(facts.get("sort"))
    return [Change("add_vessel", str(facts["role"]), sort)] if sort in _DRAWN else []


def _gas(facts: Facts) -> list[Change]:
    if "vessel" in facts:
        gas = "" if facts.get("is_any_inert") else str(facts["gas"])
        return [Change("join_gas", str(facts["vessel"]), gas)]
    return [Change("add_flask", "nitrogen")]


def _overflow(facts: Facts) -> list[Change]:
    return [Change("enlarge", str(facts["vessel"]), float(facts["needed_ul"]) / _UL_PER_ML)]


def _thermostat(facts: Facts) -> list[Change]:
    if "vessel" not in facts:
        return []
    return [Change("attach_thermostat", str(facts["vessel"]), (float(facts["temperature_c"]),))]


def _vacuum(facts: Facts) -> list[Change]:
    vessel = str(facts["vessel"])
    return [Change("join_vacuum", vessel, "shared"), Change("join_vacuum", vessel, "own")]


def _shared(facts: Facts) -> list[Change]:
    if "other" not in facts:
        return []
    return [Change("own_vacuum", str(facts["other"]), str(facts["pump"]))]


def _condenser(facts: Facts) -> list[Change]:
    if "target" not in facts:
        return [Change("add_receiver", str(facts["vessel"]))]
    return [Change("attach_condenser", str(facts["vessel"]), str(facts["target"]))]


def _waste(facts: Facts) -> list[Change]:
    """Return one more waste: for the streams that none takes, or for what one must not get."""
    if not facts.get("is_waste", True):
        return []
    liquid = str(facts.get("coming", ""))
    return [Change("add_waste", liquid, ",".join(facts["streams"]))]


_CURES: Mapping[str, Callable[[Facts], list[Change]]] = {
    "plan.no_reagent": _reagent,
    "plan.no_vessel": _vessel,
    "plan.no_waste": lambda facts: [
        Change("add_vessel", "waste", Sort.WASTE.value),
        Change("join", str(facts["vessel"]), "out"),
    ],
    "plan.no_stream": _waste,
    "plan.incompatible": _waste,
    "plan.no_buffer": lambda facts: [
        Change("add_flask", ""),
        Change("join", str(facts["vessel"]), "out"),
        Change("join", str(facts["vessel"]), "in"),
    ],
    "plan.no_cartridge": lambda facts: [Change("add_cartridge", str(facts["filling"]))],
    "plan.overflow": _overflow,
    "plan.no_stirrer": lambda facts: [Change("attach", str(facts["vessel"]), "stirrer")],
    "plan.no_thermostat": _thermostat,
    "plan.out_of_range": _thermostat,
    "plan.no_vacuum": _vacuum,
    "plan.vacuum_shared": _shared,
    "plan.no_gas": _gas,
    "plan.no_lamp": lambda facts: [Change("attach", str(facts["vessel"]), "lamp")],
    "plan.no_ultrasound": lambda facts: [Change("attach", str(facts["vessel"]), "ultrasonic bath")],
    "plan.no_microwave": lambda facts: [Change("attach", str(facts["vessel"]), "microwave")],
    "plan.no_condenser": _condenser,
    "plan.no_sensor": lambda facts: [
        Change("attach_sensor", str(facts["vessel"]), str(facts["quantity"]))
    ],
}
