"""Recipes in a few words, compiled on small rigs, and their plans played by their claims."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import check_plan
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish, compile_recipe
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document, refusal
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.domain.recipes.rigs import chemputer
from tests.judge.play import play
from tests.judge.reading import read_json
from tests.judge.request import Request

BENCH = (
    "flask_water:0 > valve_1:0",
    "flask_ether:0 > valve_1:1",
    "pump_1:0 = valve_1:-1",
    "valve_1:2 = reactor:0",
    "valve_1:3 > waste_1:0",
    "valve_1:5 = valve_2:5",
    "pump_2:0 = valve_2:-1",
    "valve_2:0 > filter:top",
    "filter:bottom > valve_2:1",
    "valve_2:2 = separator:bottom",
    "valve_2:3 > waste_2:0",
    "valve_2:4 = flask_spare:0",
    "filter:bottom = valve_gas:-1",
    "valve_gas:0 > vacuum:0",
    "flask_argon:0 > valve_gas:1",
)
ATTACHED = (
    ("stirrer_r", "HeiTORQUE_100", "reactor"),
    ("stirrer_f", "HeiTORQUE_100", "filter"),
    ("stirrer_s", "HeiTORQUE_100", "separator"),
    ("heater", "IKARCTDigital", "reactor"),
    ("sensor", "ConductivitySensor", "separator"),
    ("pump_vacuum", "CVC3000", "vacuum"),
)
CHEMICALS = {"flask_water": "water", "flask_ether": "ether", "flask_argon": "argon"}


def bench(**capacity_ml: float) -> dict[str, Any]:
    """Draw a rig with reactor, filter, separator, two pumps of 25 mL, vacuum and argon."""
    graph = chemputer(*BENCH)
    for key, class_, vessel in ATTACHED:
        graph["nodes"].append({"id": key, "class": class_})
        link = {"id": key, "source": key, "target": vessel, "port": "(,)"}
        graph["links"].append(link)
    for node in graph["nodes"]:
        node["chemical"] = CHEMICALS.get(node["id"], "")
        if not node["id"].startswith("pump"):
            node["max_volume"] = capacity_ml.get(node["id"], 500)
    return graph


def recipe(*steps: str, hardware: str = "", reagents: tuple[str, ...] = ("water", "ether")) -> str:
    components = hardware or (
        '<Component id="reactor" type="reactor"/><Component id="filter" type="filter"/>'
        '<Component id="separator" type="separator"/>'
    )
    declared = "".join(f'<Reagent id="{name}"/>' for name in reagents)
    return (
        f"<Synthesis><Hardware>{components}</Hardware><Reagents>{declared}</Reagents>"
        f"<Procedure>{''.join(f'<{step}/>' for step in steps)}</Procedure></Synthesis>"
    )


def compiled(
    text: str | bytes, graph: dict[str, Any], wish: CompileWish | None = None
) -> dict[str, Any]:
    rig = read_rig(json.dumps(graph).encode())
    raw = text if isinstance(text, bytes) else text.encode()
    vessels = frozenset(Equipment(rig).vessels)
    read, findings = check_document(parse_markup(raw), rig_vessels=vessels)
    if findings:
        raise refusal(findings)
    plan = compile_recipe(read, rig, wish)
    found = unproved(plan, rig)
    assert not found, [(one.code, one.message) for one in found]
    return plan


def unproved(plan: dict[str, Any], rig: Rig) -> list[Finding]:
    """Let the verifier carry a plan out on paper, and list what it does not prove."""
    head = {"recipe": {"id": "recipe", "sha256": "0" * 64}, "graph_sha256": "0" * 64}
    return check_plan(rig, parse_plan(json.dumps(plan | head).encode()), "0" * 64)


def reasons(text: str | bytes, graph: dict[str, Any], wish: CompileWish | None = None) -> list[str]:
    with pytest.raises(LabError) as caught:
        compiled(text, graph, wish)
    return [finding.code for finding in caught.value.findings]


def claims(plan: dict[str, Any], *kinds: str) -> list[dict[str, Any]]:
    return [s["does"] for s in plan["steps"] if not kinds or s["does"]["kind"] in kinds]


def check_strokes(plan: dict[str, Any], graph: dict[str, Any]) -> int:
    """Let the judge of transfers play every move of liquid, each phase for itself; count them."""
    rig, count = read_json(graph), 0
    for step in plan["steps"]:
        for source, target, volume_ul, actions in _moves(step):
            owner, _, part = source.partition("#")
            port = "collect" if part else None
            request = Request(owner, target, round(volume_ul * 1000), port)
            played = play(rig, request, actions)
            assert played.is_right, (step["id"], step["does"], played.message)
            count += 1
    return count


Part = tuple[str, str, float, list[list[dict[str, Any]]]]


def _moves(step: dict[str, Any]) -> Iterator[Part]:
    """Yield source, target, volume and actions. The judge leads nothing through a cartridge."""
    does = step["does"]
    groups = [[_plain(c) for c in group] for group in step["actions"]]
    groups = [group for group in groups if group[0]["action"] not in ("check", "flush")]
    if does["kind"] in ("transfer", "filter", "clean") and "through" not in does:
        source = does.get("from", does.get("vessel"))
        yield source, does["to"], does.get("volume_ul", does.get("most_ul")), groups
    elif does["kind"] == "separate":
        end = next(i for i, group in enumerate(groups) if group[0]["action"] == "stop_watching")
        lower, upper = groups[1:end], groups[end + 1 :]
        vessel, most = does["vessel"], does["most_ul"]
        if does["lower_to"] != vessel and "lower_through" not in does:
            yield vessel, does["lower_to"], most, lower
        if vessel not in (does["lower_to"], does["upper_to"]) and "upper_through" not in does:
            yield vessel, does["upper_to"], most, upper


def _plain(command: dict[str, Any]) -> dict[str, Any]:
    given = {name: value for name, value in command["parameters"].items() if name != "until"}
    return {**command, "parameters": given}


def check_claims(plan: dict[str, Any]) -> None:
    """Follow every certain volume by the claims alone: nothing runs dry or over."""
    held: dict[str, dict[str, float]] = {
        key: {e["lot"]: e["volume_ul"] for e in lots if e["phase"] == "liquid"}
        for key, lots in plan["contents"].items()
    }
    loose: set[str] = set()
    for step in plan["steps"]:
        does = step["does"]
        assert all(place < step["id"] for place in step["after"])
        if does["kind"] == "fill":
            there = held.setdefault(does["to"], {})
            there[does["lot"]] = there.get(does["lot"], 0) + does["volume_ul"]
        elif does["kind"] == "empty":
            held[does["vessel"]] = {}
        elif does["kind"] == "separate":
            loose |= {does["vessel"], does["lower_to"], does["upper_to"]}
        elif does["kind"] in ("vacuum", "evaporate"):
            loose |= {does["vessel"], f"{does['vessel']}#collect"}
        elif does["kind"] in ("transfer", "filter", "clean"):
            _follow(does, held, loose)
        for key, there in held.items():
            capacity = plan["capacities_ul"].get(key)
            if capacity is not None and key not in loose:
                assert sum(there.values()) <= capacity + 1e-3, (step["id"], key)


def _follow(does: dict[str, Any], held: dict[str, dict[str, float]], loose: set[str]) -> None:
    source, target = str(does.get("from", does.get("vessel"))), does["to"]
    if source in loose:
        loose.add(target)
        return
    there = held.setdefault(source, {})
    total = sum(there.values())
    volume = does.get("volume_ul", total)
    assert volume <= total + 1e-3, does
    if "most_ul" in does:
        assert abs(does["most_ul"] - total) < 0.002, does
    if "lot" in does:
        assert set(there) == {does["lot"]}, does
    into = held.setdefault(target, {})
    for lot, amount in list(there.items()):
        part = amount * volume / total if total else 0.0
        into[lot] = into.get(lot, 0) + part
        there[lot] = amount - part
