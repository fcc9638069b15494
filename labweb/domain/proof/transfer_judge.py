"""Judge the lines of `compile_transfers` as plans of one step."""

from __future__ import annotations

import math
from typing import Any

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.messages.plan_fields import TIMER
from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof.execute_plan import execute_alone
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.plan_read import Action, ProofStep, parse_groups
from labweb.domain.proof.plumbing import Plumbing
from labweb.domain.units import parse, parse_volume_nl

_LOT = "asked"
_DIGITS = 1e-8
"""A rate is written with nine significant digits."""


def check_answer(plumbing: Plumbing, request: bytes, answer: bytes) -> list[Finding]:
    """List what is not proved of one answer to one request on a rig with this plumbing.

    The source is taken to hold twice what is asked for and the target to be empty and without
    bound, as `docs/routing.md` says. A refusal claims nothing: there is nothing to find.

    Raises:
        LabFileError: A line is no JSON.
    """
    answered = decode_json(answer)
    if not isinstance(answered, dict) or not isinstance(answered.get("ok"), bool):
        return [Finding("interpret.shape", "the answer has no ok")]
    if not answered["ok"]:
        return []
    asked = decode_json(request)
    if not isinstance(asked, dict):
        return [Finding("interpret.shape", "the request is no object")]
    findings: list[Finding] = []
    groups = _without_waits(parse_groups(_timed(plumbing, answered.get("steps")), findings))
    try:
        volume_nl = parse_volume_nl(asked.get("volume"))
    except LabError as error:
        findings.append(Finding(error.code, error.message, "volume"))
        return findings
    ends = [asked.get("from"), asked.get("to")]
    through = asked.get("through") or []
    words = [*ends, *through] if isinstance(through, list) else [None]
    if not all(isinstance(word, str) for word in words):
        findings.append(Finding("interpret.shape", "from, to and through are ids"))
    rates = {name: _rate(asked, name, findings) for name in ("rate", "draw_rate", "push_rate")}
    if findings:
        return findings
    return _execute(plumbing, asked, groups, volume_nl, rates)


def _rate(asked: dict[str, Any], name: str, findings: list[Finding]) -> float | None:
    """Return a rate of a request in µL/s; None: it states none."""
    if asked.get(name) is None:
        return None
    try:
        return parse(asked[name], "flow_rate")
    except LabError as error:
        findings.append(Finding(error.code, f"{name}: {error.message}", name))
        return None


def _timed(plumbing: Plumbing, steps: object) -> object:
    """Return steps in which the timer waits for each device that does nothing else meanwhile."""

    def timed(group: object) -> object:
        if not isinstance(group, list) or not all(isinstance(part, dict) for part in group):
            return group
        devices = [part.get("device") for part in group]
        alone = {
            key
            for key in devices
            if isinstance(key, str) and key in plumbing.elements and devices.count(key) == 1
        }
        return [
            part | {"device": TIMER}
            if part.get("action") == "wait" and str(part.get("device")) in alone
            else part
            for part in group
        ]

    return [timed(group) for group in steps] if isinstance(steps, list) else steps


def _without_waits(groups: tuple[tuple[Action, ...], ...]) -> tuple[tuple[Action, ...], ...]:
    """Leave out what only waits: a transfer says nothing of time."""
    return tuple(tuple(one for one in group if one.name != "wait") for group in groups)


def _execute(
    plumbing: Plumbing,
    asked: dict[str, Any],
    groups: tuple[tuple[Action, ...], ...],
    volume_nl: int,
    rates: dict[str, float | None],
) -> list[Finding]:
    source = str(asked["from"])
    is_gas = plumbing.is_gas(source)
    twice = AmountRange.exactly(2 * volume_nl * UNITS_PER_NL)
    claim = Claim(
        kind="push" if is_gas else "transfer",
        from_=source,
        to=str(asked["to"]),
        volume_ul=volume_nl / 1000,
        through=list(asked.get("through") or ()),
    )
    contents = {} if is_gas else {source: Contents({_LOT: twice}, {}, twice)}
    state = execute_alone(plumbing, ProofStep(1, claim, groups, (), 0), contents)
    wanted = (asked.get("from_port"), asked.get("to_port"))
    for flow in state.record.flows:
        for port, other in zip((flow.source.port, flow.target.port), wanted, strict=True):
            if other not in (None, port):
                message = f"it takes port {port!r}, not {other!r}"
                state.complain("interpret.claim", message)
    usual = rates["rate"]
    stated = {"draw": rates["draw_rate"], "push": rates["push_rate"], "between": None}
    for pump, leads, rate_ul_s in dict.fromkeys(state.record.rates):
        asked_ul_s = stated[leads] or usual
        if asked_ul_s is not None and not math.isclose(rate_ul_s, asked_ul_s, rel_tol=_DIGITS):
            message = f"{pump} moves at {rate_ul_s:.9g} µL/s where {asked_ul_s:.9g} is asked for"
            state.complain("interpret.rate", message, device=pump)
    return state.findings
