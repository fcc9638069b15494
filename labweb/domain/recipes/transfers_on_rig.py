"""Transfers compiled against a rig alone: no lab, no record, no device that must answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import Finding, LabFileError, UnitError
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.route_breaks import find_breaks
from labweb.domain.graph.syringe_chain import SyringeChain, WantedChain, find_chain
from labweb.domain.units import parse, parse_volume_nl, steady
from labweb.domain.workflows.passes.liquids.stroke_pipeline import Group, make_groups
from labweb.domain.workflows.passes.liquids.stroke_splitting import count_strokes

MOVE_UL_S = 40_000 / 60
"""Plungers move at 40 mL/min unless a request or a small syringe says less.

Source:
    Default move speed of the published XDL compiler for Chemputers."""

FULL_STROKE_S = 20.0
"""A full syringe takes at least this long."""

_LEAST_UL_S = 1e-6
"""Rates are written to so much."""

MOST_COMMANDS = 100_000
"""Most commands that one transfer is planned with."""

_MOST_DEFECTS = 8
"""Most findings about the graph that one line is answered with."""

MOST_LINE_BYTES = 64 * 1024
"""Longest line of requests."""

_TEXTS = ("from", "to", "from_port", "to_port")
_RATES = ("rate", "draw_rate", "push_rate")
_FIELDS = frozenset((*_TEXTS, *_RATES, "volume", "through"))
_NEEDED = ("from", "to", "volume")


@dataclass(frozen=True, kw_only=True)
class TransferRequest:
    """One transfer that is asked for; elements by their ids in the graph."""

    source: str
    target: str
    amount_nl: int
    source_port: str | None = None
    target_port: str | None = None
    rate_ul_s: float | None = None
    draw_rate_ul_s: float | None = None
    """Of the first stroke, out of the source: slow for what is viscous."""

    push_rate_ul_s: float | None = None
    """Of the last stroke, into the target."""

    through: tuple[str, ...] = ()
    over: str | None = None
    """A syringe that the liquid has to go over, to rinse it; no line of requests asks for one."""


def parse_request(line: bytes) -> TransferRequest | list[Finding]:
    """Read one line of requests, or say everything that is wrong with it."""
    if len(line) > MOST_LINE_BYTES:
        message = f"the line has {len(line)} bytes; at most {MOST_LINE_BYTES} are read"
        return [Finding("request.malformed", message, "")]
    try:
        value = decode_json(line)
    except LabFileError as error:
        return [Finding("request.malformed", f"the line is no request: {error.message}", "")]
    if not isinstance(value, Mapping):
        return [Finding("request.malformed", "the line is no JSON object", "")]
    return _parse(value)


def _parse(given: Mapping[str, Any]) -> TransferRequest | list[Finding]:
    value = {name: part for name, part in given.items() if part is not None or name in _NEEDED}
    found = [
        Finding("request.malformed", f"{name}: is not a field of a transfer", name)
        for name in sorted(set(value) - _FIELDS)
    ]
    found += [
        Finding("request.malformed", f"{name}: is missing", name)
        for name in _NEEDED
        if name not in value
    ]
    for name in _TEXTS:
        if name in value and not _is_text(value[name]):
            found.append(Finding("request.malformed", f"{name}: is no text", name))
    through = value.get("through", [])
    if not isinstance(through, list) or not all(_is_text(entry) for entry in through):
        found.append(Finding("request.malformed", "through: is no list of ids", "through"))
    amount_nl = 0
    try:
        amount_nl = parse_volume_nl(value["volume"]) if "volume" in value else 0
    except UnitError as error:
        found.append(Finding(error.code, f"volume: {error.message}", "volume"))
    rates = [_rate(value, name, found) for name in _RATES]
    if found:
        return found
    return TransferRequest(
        source=value["from"],
        target=value["to"],
        amount_nl=amount_nl,
        source_port=value.get("from_port"),
        target_port=value.get("to_port"),
        rate_ul_s=rates[0],
        draw_rate_ul_s=rates[1],
        push_rate_ul_s=rates[2],
        through=tuple(through),
    )


def _rate(value: Mapping[str, Any], name: str, found: list[Finding]) -> float | None:
    if name not in value:
        return None
    try:
        rate_ul_s = parse(value[name], "flow_rate")
    except UnitError as error:
        found.append(Finding(error.code, f"{name}: {error.message}", name))
        return None
    if rate_ul_s <= 0:
        found.append(Finding("unit.not_positive", f"{name}: is not positive", name))
    elif rate_ul_s < _LEAST_UL_S:
        message = f"{name}: {value[name]!r} is slower than any pump: at least 0.000001 uL/s is read"
        found.append(Finding("unit.out_of_range", message, name))
    return rate_ul_s


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def plan_on_rig(rig: Rig, request: TransferRequest) -> tuple[list[Group], list[Finding]]:
    """Plan one transfer, or say why there is none.

    The source is taken to hold twice what is asked for, the target to be empty and without
    bound, every syringe to be empty, and every tube to hold nothing. Nothing is assumed
    about where a valve stands, and every solenoid is taken to be closed.

    Returns:
        Groups of commands, one after another, those of one group at the same time; or no
        group, and findings: the first says which element liquid reaches and what is missing
        after it.

    Effect:
        None.
    """
    wanted = _find_ends(rig, request)
    if isinstance(wanted, list):
        return [], [*wanted, *rig.defects[:_MOST_DEFECTS]]
    chain = find_chain(rig.network, wanted)
    if chain is None:
        return [], find_breaks(rig.network, wanted, rig.defects)
    return _strokes(rig, request, chain)


def _find_ends(rig: Rig, request: TransferRequest) -> WantedChain | list[Finding]:
    network = rig.network
    found: list[Finding] = []
    for key, given in ((request.source, ElementRole.GAS), (request.target, None)):
        place = network.index.get(key)
        if place is None:
            found.append(Finding("plan.unknown_vessel", f"{key!r} is not in the graph", key))
        elif network.elements[place].role not in (ElementRole.VESSEL, given):
            element = network.elements[place]
            message = f"{key} is no vessel but a {element.kind or element.role.value}"
            found.append(Finding("plan.not_a_vessel", message, key))
    for key in request.through:
        place = network.index.get(key)
        if place is None:
            found.append(Finding("plan.unknown_vessel", f"{key!r} is not in the graph", key))
        elif network.elements[place].role not in (ElementRole.CARTRIDGE, ElementRole.MANIFOLD):
            message = f"{key} is neither a cartridge nor a manifold: nothing leads through it"
            found.append(Finding("plan.no_conductor", message, key))
    if request.source == request.target:
        message = "source and target are the same vessel"
        found.append(Finding("plan.same_vessel", message, request.source))
    if found:
        return found
    return WantedChain(
        source=network.index[request.source],
        target=network.index[request.target],
        source_port=request.source_port,
        target_port=request.target_port,
        through=tuple(network.index[key] for key in request.through),
        over=None if request.over is None else network.index[request.over],
    )


def _strokes(
    rig: Rig, request: TransferRequest, chain: SyringeChain
) -> tuple[list[Group], list[Finding]]:
    network = rig.network
    syringes = [network.elements[index].capacity_nl or 0 for index in chain.pumps]
    syringe_nl = min(syringes)
    count = count_strokes(request.amount_nl, syringe_nl)
    commands = count * sum(2 + len(hop.settings) for hop in chain.hops)
    if commands > MOST_COMMANDS:
        message = (
            f"this takes {count} strokes of {syringe_nl / 1_000_000:g} mL and {commands} commands; "
            f"at most {MOST_COMMANDS} are planned"
        )
        return [], [Finding("plan.too_many_strokes", message, request.source)]
    is_slow = [
        any(network.elements[index].role is ElementRole.CARTRIDGE for index in hop.passed)
        for hop in chain.hops
    ]
    rates = _hop_rates(request, is_slow, min(MOVE_UL_S, syringe_nl / 1000 / FULL_STROKE_S))
    return list(make_groups(network, chain, request.amount_nl, syringe_nl, rates)), []


def _hop_rates(request: TransferRequest, is_slow: Sequence[bool], usual_ul_s: float) -> list[float]:
    """Return the rate of each hop. A cartridge is passed as slowly as the source is drawn."""
    between = request.rate_ul_s or usual_ul_s
    draw = request.draw_rate_ul_s or between
    push = request.push_rate_ul_s or between
    rates = [draw if slow else between for slow in is_slow]
    rates[0] = draw
    if not is_slow[-1]:
        rates[-1] = push
    return [steady(rate) for rate in rates]


def compile_line(rig: Rig | list[Finding], line: bytes) -> dict[str, Any]:
    """Compile one line of requests against a rig, or against what is wrong with its graph.

    Returns:
        `{"ok": true, "steps": […]}` or `{"ok": false, "findings": […]}`, JSON-ready.
    """
    request = parse_request(line)
    if isinstance(request, list):
        return _refused(request)
    if isinstance(rig, list):
        return _refused(_first(rig))
    groups, findings = plan_on_rig(rig, request)
    if findings:
        return _refused(findings)
    return {"ok": True, "steps": groups}


def _first(findings: list[Finding]) -> list[Finding]:
    """Return the first findings about a graph, and a last one that says how many more there are."""
    more = len(findings) - _MOST_DEFECTS
    if more <= 0:
        return findings
    message = f"{more} more findings refuse the graph; all stand on the standard error"
    return [*findings[:_MOST_DEFECTS], Finding("graph.more_findings", message, "")]


def _refused(findings: list[Finding]) -> dict[str, Any]:
    return {
        "ok": False,
        "findings": [
            {"code": each.code, "message": each.message, "subject": each.subject}
            for each in findings
        ],
    }
