"""A right plan with one action left out or changed is refused, but for what is listed here."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import pytest

from labweb.domain.errors import ProtocolError
from tests.domain.proof.bench import CLASSES, codes
from tests.domain.proof.plans import RIGHT

OTHER_DEVICE = {
    "valve_1": "valve_vac",
    "valve_2": "valve_1",
    "valve_vac": "valve_2",
    "pump_1": "pump_2",
    "pump_2": "pump_1",
    "cvc": "cvc_rotavap",
    "cvc_rotavap": "cvc",
    "valve_d": "valve_vac",
    "valve_g": "valve_d",
    "cvc_d": "cvc",
    "hotplate": "chiller",
    "rotavap": "reactor",
    "lamp": "hotplate",
    "thermometer": "sensor",
    "sensor": "thermometer",
}
OTHER_VALUE: dict[str, Any] = {
    "volume_ul": lambda value: (value * 2, value / 2),
    "least_ul": lambda value: (value * 2, value / 2),
    "port": lambda value: tuple(str(p) for p in range(6) if str(p) != value),
    "speed_rpm": lambda value: (value + 1,),
    "temperature_c": lambda value: (value + 100,),
    "low_c": lambda value: (value + 1,),
    "high_c": lambda value: (value + 1,),
    "pressure_mbar": lambda value: (value + 1, None),
    "duration_s": lambda value: (value + 1, value / 2),
    "mass_ug": lambda value: (value + 1,),
    "lot": lambda _: ("other",),
    "vessel": lambda _: ("filter", "nowhere"),
    "quantity": lambda _: ("colour",),
    "until": lambda value: (None, "boundary" if value == "empty" else "empty"),
}
"""`text` and what is known of a light are for people; a rate changes nothing but time."""


def mutants(plan: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a name and a plan for each action left out, moved to another device or changed."""
    for s, step in enumerate(plan["steps"]):
        for g, group in enumerate(step["actions"]):
            for a, action in enumerate(group):
                where = f"{s}.{g}.{a} {action['device']} {action['action']}"
                yield f"{where} left out", changed(plan, s, g, a, None)
                other = OTHER_DEVICE.get(action["device"])
                if other:
                    yield f"{where} by {other}", changed(plan, s, g, a, {"device": other})
                for name, value in action["parameters"].items():
                    for new in OTHER_VALUE.get(name, lambda _: ())(value):
                        more = {"parameters": {**action["parameters"], name: new}}
                        yield f"{where} {name}={new}", changed(plan, s, g, a, more)


def changed(
    plan: dict[str, Any], s: int, g: int, a: int, more: dict[str, Any] | None
) -> dict[str, Any]:
    copied = copy.deepcopy(plan)
    group = copied["steps"][s]["actions"][g]
    if more is None:
        del group[a]
    else:
        group[a] |= more
    return copied


EQUIVALENT = {
    # What is in the source is known, and the strokes draw just that.
    "all": {
        "1.1.0 pump_2 aspirate until=None",
        "1.5.0 pump_2 aspirate until=None",
    },
    "filter": {"0.1.0 pump_2 aspirate until=None"},
    # These ports have no tube either.
    "vacuum": {f"2.2.0 valve_vac set_port port={free}" for free in (2, 3, 4)},
    "off a vacuum that is always on": {
        f"0.0.0 valve_g set_port port={free}" for free in (1, 2, 3, 4)
    },
    "shared vacuum": {f"0.0.0 valve_d set_port port={free}" for free in (1, 2, 3, 4)},
    "gas": {f"1.0.0 valve_vac set_port port={free}" for free in (2, 3, 4)},
}
"""Name of a right plan → mutants that do the same."""


@pytest.mark.parametrize("name", RIGHT)
def test_every_mutant_is_refused_but_for_true_equivalents(name: str) -> None:
    found = {what for what, plan in mutants(RIGHT[name]) if not safely(plan)}
    assert found == EQUIVALENT.get(name, set())


def safely(plan: dict[str, Any]) -> set[str]:
    try:
        return codes(plan)
    except ProtocolError as error:
        return {finding.code for finding in error.findings}


def test_every_other_device_is_on_the_rig() -> None:
    assert set(OTHER_DEVICE) | set(OTHER_DEVICE.values()) <= set(CLASSES)
