"""Random rigs and random recipes: many fit each other, and many do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from labweb.domain.resources.compatibility_table import STREAMS
from tests.domain.recipes.rigs import CLASSES

REAGENTS = ("water", "ether", "acid", "base")
VESSELS = ("reactor", "filter", "separator", "rotavap", "flask_spare")
CAPACITIES_ML = (500, 200, 60, 20)
PLUMBED = (
    "flask_water:0 >", "flask_ether:0 >", "flask_acid:0 >", "< waste_1:0", "< waste_2:0",
    "flask_base:0 >",
    "reactor:0 =", "< filter:top", "filter:bottom >", "separator:bottom =", "rotavap:evaporate =",
    "rotavap:collect >", "flask_spare:0 =", "< cartridge_c:in", "cartridge_c:out >", "rotor:0 =",
)  # fmt: skip
"""Each takes one port of some valve: `>` conducts to the valve, `<` from it, `=` both ways."""

DEVICES = (
    ("stirrer_r", "HeiTORQUE_100", "reactor"),
    ("stirrer_f", "RZR_2052", "filter"),
    ("stirrer_s", "IKAmicrostar75", "separator"),
    ("heater", "IKARCTDigital", "reactor"),
    ("chiller", "JULABOCF41", "reactor"),
    ("sensor", "ConductivitySensor", "separator"),
    ("probe", "pHSensor", "reactor"),
    ("bath", "UltrasonicBath", "reactor"),
    ("oven", "Microwave", "reactor"),
    ("condenser", "Condenser", "reactor flask_spare"),
    ("pump_rotavap", "CVC3000", "rotavap"),
    ("pump_line", "CVC3000", "vacuum"),
)
SORTS = {"rotavap": "IKARV10", "rotor": "Centrifuge", "vacuum": "ChemputerVacuum"}
CHEMICALS = {
    "flask_water": "water",
    "flask_ether": "ether",
    "flask_acid": "acid",
    "flask_base": "base",
    "flask_argon": "argon",
    "cartridge_c": "celite",
}

USUAL: Mapping[str, tuple[str, ...]] = {
    "water": ("water",),
    "ether": ("ether",),
    "acid": ("acid", "water"),
    "base": ("base", "water"),
}
OTHERS = (
    ("halogenated",), ("haloform",), ("oxidizer", "water"), ("cyanide", "water"), ("azide",),
    ("water_reactive", "ether"), ("alcohol",), ("salt", "water"), ("metal", "water"), (),
)  # fmt: skip
"""What a flask may say beside the usual: much of it must not meet the rest."""

TAKEN = (
    ("aqueous", "acid"), ("aqueous", "base"), ("organic",), ("organic", "halogenated"),
    tuple(sorted(set(STREAMS.values()) - {""})), (),
)  # fmt: skip
LEFT = (("acid",), ("base",), ("water",), ("oxidizer",), ("organic",))
"""What a waste may say that is in it from before."""

STEPS = (
    'Add vessel="{v}" reagent="{r}" volume="{ml} mL"',
    'Add vessel="reactor" reagent="{r}" volume="{ml} mL" stir="true"',
    'Add vessel="{v}" reagent="{r}" volume="{ml} mL"',
    'Add vessel="reactor" reagent="{r}" volume="{ml} mL"',
    'Transfer from_vessel="reactor" to_vessel="{w}" volume="all" rinsing_solvent="{r}" '
    'rinsing_volume="{ml} mL"',
    'AddSolid vessel="{v}" reagent="salt" mass="1 g"',
    'Transfer from_vessel="{v}" to_vessel="{w}" volume="all"',
    'Transfer from_vessel="{v}" to_vessel="{w}" volume="{ml} mL"',
    'Stir vessel="reactor" time="1 min"',
    'HeatChill vessel="reactor" temp="{c} °C" time="5 min"',
    'HeatChillToTemp vessel="reactor" temp="{c} °C"',
    'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="{w}" purpose="{p}" '
    'product_phase="{s}" solvent="{r}" solvent_volume="{ml} mL" repeats="{n}"',
    'Filter vessel="filter"',
    'WashSolid vessel="filter" solvent="{r}" volume="{ml} mL" repeats="{n}"',
    'Dry vessel="{v}" time="10 min"',
    'Evaporate vessel="rotavap" time="10 min"',
    'EvacuateAndRefill vessel="{v}"',
    'Purge vessel="{v}"',
    'FilterThrough from_vessel="{v}" to_vessel="{w}" through="celite"',
    'CleanVessel vessel="{v}" solvent="{r}" volume="{ml} mL"',
    'Dissolve vessel="reactor" solvent="{r}" volume="{ml} mL" temp="{c} °C"',
    'Sonicate vessel="reactor" time="1 min"',
    'Microwave vessel="reactor" temp="120 °C" time="1 min"',
    'Distill vessel="reactor" to_vessel="flask_spare" temp="{c} °C" time="1 h"',
    'Centrifuge vessel="rotor" time="1 min" speed="3000 RPM"',
    'AdjustPH vessel="reactor" reagent="acid" pH="4" step_volume="1 mL" max_volume="{n} mL"',
    'Transfer from_vessel="rotavap" to_vessel="{w}" volume="all" from_port="collect"',
    "PurgeBackbone",
)
CLEANS = ' use_for_cleaning="true"'
LOOPS = (
    ("{}", 8),
    ('<Repeat repeats="2">{}</Repeat>', 1),
    ('<Repeat>{}<Monitor target="reactor" quantity="pH" max="5"/></Repeat>', 1),
)
"""What steps stand in, and how often."""


@dataclass(frozen=True)
class Invented:
    """A graph and a recipe for it, or not for it."""

    graph: dict[str, Any]
    recipe: str


@st.composite
def rigs(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a row of valves with pumps and, at random ports, most of what a laboratory has."""
    count = draw(st.integers(3, 4))
    links = [(f"valve_{n}", "-1", f"pump_{n}", "0", True) for n in range(count)]
    free = [(n, port) for n in range(count) for port in range(6)]
    for n in range(1, count):
        links.append((f"valve_{n - 1}", "5", f"valve_{n}", "4", True))
        free = [end for end in free if end not in ((n - 1, 5), (n, 4))]
    free = draw(st.permutations(free))
    missing = draw(st.sets(st.sampled_from(PLUMBED), max_size=2))
    for text, (n, place) in zip([t for t in PLUMBED if t not in missing], free, strict=False):
        key, _, own = text.strip("<>= ").partition(":")
        valve, port = f"valve_{n}", str(place)
        if "<" in text:
            links.append((valve, port, key, own, False))
        else:
            links.append((key, own, valve, port, "=" in text))
    if draw(st.booleans()):
        vessel, own = draw(st.sampled_from((("filter", "bottom"), ("reactor", "1"))))
        links.append((vessel, own, "valve_gas", "-1", True))
        links.append(("valve_gas", "0", "vacuum", "0", False))
        links.append(("flask_argon", "0", "valve_gas", "1", False))
    nodes = {key: _node(key, draw) for link in links for key in (link[0], link[2])}
    joined = [
        {"source": one, "target": two, "port": f"({a},{b})"}
        for one, a, two, b, both in links
        for one, a, two, b in [(one, a, two, b), *([(two, b, one, a)] if both else [])]
    ]
    if draw(st.integers(0, 3)):
        _declare(nodes, draw)
    gone = draw(st.sets(st.sampled_from(DEVICES), max_size=2))
    for key, class_, vessels in DEVICES:
        near = [vessel for vessel in vessels.split() if vessel in nodes]
        if (key, class_, vessels) not in gone and near:
            nodes[key] = {"id": key, "class": class_}
            joined += [{"source": key, "target": vessel, "port": "(,)"} for vessel in near]
    return {
        "nodes": list(nodes.values()),
        "links": [{"id": n, **link} for n, link in enumerate(joined)],
    }


def _declare(nodes: dict[str, dict[str, Any]], draw: st.DrawFn) -> None:
    """Let flasks say groups, and wastes what they take and what is left in them."""
    for name, usual in USUAL.items():
        if f"flask_{name}" in nodes:
            odd = not draw(st.integers(0, 3))
            nodes[f"flask_{name}"]["groups"] = [*(draw(st.sampled_from(OTHERS)) if odd else usual)]
    for key in ("waste_1", "waste_2"):
        if key not in nodes:
            continue
        if draw(st.booleans()):
            nodes[key]["takes"] = [*draw(st.sampled_from(TAKEN))]
        if not draw(st.integers(0, 3)):
            left = {"chemical": f"rest of {key}", "current_volume": draw(st.sampled_from((1, 15)))}
            nodes[key] |= left | {"groups": [*draw(st.sampled_from(LEFT))]}


def _node(key: str, draw: st.DrawFn) -> dict[str, Any]:
    word = key.partition("_")[0]
    node: dict[str, Any] = {"id": key, "class": SORTS.get(key) or CLASSES[word]}
    if word == "pump":
        node["max_volume"] = draw(st.sampled_from((5, 10, 25)))
    elif word != "valve":
        node |= {"max_volume": draw(st.sampled_from(CAPACITIES_ML))}
        node["chemical"] = CHEMICALS.get(key, "")
        if key == "rotavap":
            node["collection_flask_volume"] = draw(st.sampled_from(CAPACITIES_ML))
    return node


@st.composite
def recipes(draw: st.DrawFn) -> str:
    """Draw a recipe of a few steps; most begin with something in the reactor."""
    steps = [_step(draw, text) for text in draw(st.lists(st.sampled_from(STEPS), max_size=4))]
    loops = [wrap for wrap, times in LOOPS for _ in range(times)]
    body = "".join(draw(st.sampled_from(loops)).format(step) for step in steps)
    begin = _step(draw, STEPS[0].replace("{v}", "reactor")) if draw(st.integers(0, 11)) else ""
    begin += _step(draw, STEPS[0]) if draw(st.integers(0, 2)) else ""
    hardware = "".join(
        f'<Component id="{vessel}" type="{vessel.partition("_")[0]}"/>' for vessel in VESSELS
    )
    hardware += '<Component id="rotor" type="centrifuge"/>'
    cleaning = {name for name in ("water", "ether") if draw(st.booleans())}
    reagents = "".join(
        f'<Reagent id="{name}"{CLEANS if name in cleaning else ""}/>'
        for name in (*REAGENTS, "salt")
    )
    return (
        f"<Synthesis><Hardware>{hardware}</Hardware><Reagents>{reagents}</Reagents>"
        f"<Procedure>{begin}{body}</Procedure></Synthesis>"
    )


def _step(draw: st.DrawFn, text: str) -> str:
    source, target = draw(st.permutations((*VESSELS, "rotor")))[:2]
    filled = text.format(
        v=source,
        w=target,
        r=draw(st.sampled_from(REAGENTS)),
        ml=draw(st.sampled_from((1, 5, 15, 40))),
        c=draw(st.sampled_from((-20, 5, 40, 90, 150))),
        n=draw(st.integers(1, 3)),
        p=draw(st.sampled_from(("wash", "extract"))),
        s=draw(st.sampled_from(("top", "bottom"))),
    )
    return f"<{filled}/>"


@st.composite
def pairs(draw: st.DrawFn) -> Invented:
    """Draw a rig and a recipe."""
    return Invented(draw(rigs()), draw(recipes()))
