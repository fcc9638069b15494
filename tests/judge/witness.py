"""Write down a plan for a chain that the oracle found, as plainly as can be.

Not a compiler: it turns every valve before every stroke. It shows that what the oracle calls
feasible can be played, and gives the mutants something right to start from.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tests.judge.oracle import Leg, Oracle
from tests.judge.request import NoRequestError, Request, parse_request
from tests.judge.rig import Rig
from tests.judge.ways import Setting

Plan = list[list[dict[str, Any]]]
RATE_UL_S = 100.0


def write_plan(rig: Rig, request: Request, legs: tuple[Leg, ...]) -> Plan:
    """Return steps that do the request along the legs, in equal turns of the smallest syringe."""
    pumps = [legs[0].pump, *(leg.other for leg in legs[1:-1])]
    stroke = min(rig.devices[pump].capacity_nl or 0 for pump in pumps)
    plan: Plan = []
    opened: set[str] = set()
    left = request.volume_nl
    while left > 0:
        volume_nl = min(stroke, left)
        left -= volume_nl
        for leg in legs:
            plan += _turns(rig, leg.setting, opened)
            plan.append(_stroke(leg, legs, volume_nl / 1000))
    return plan + [[action(name, "close")] for name in sorted(opened)]


def _stroke(leg: Leg, legs: tuple[Leg, ...], volume_ul: float) -> list[dict[str, Any]]:
    if leg is legs[0]:
        return [move(leg.pump, "aspirate", volume_ul)]
    if leg is legs[-1]:
        return [move(leg.pump, "dispense", volume_ul)]
    return [move(leg.pump, "dispense", volume_ul), move(leg.other, "aspirate", volume_ul)]


def _turns(rig: Rig, setting: Setting, opened: set[str]) -> Plan:
    plan: Plan = [[action(name, "close")] for name in sorted(opened - setting.opened)]
    plan += [[action(name, "open")] for name in sorted(setting.opened - opened)]
    opened.clear()
    opened.update(setting.opened)
    positions = dict(setting.positions)
    for valve, port in setting.avoids:
        if valve not in positions:
            barred = {other for name, other in setting.avoids if name == valve}
            ports = [*rig.outer_ports(valve), *sorted(rig.devices[valve].declared)]
            positions[valve] = next(one for one in ports if one not in barred)
        assert positions[valve] != port
    return plan + [[set_port(valve, port)] for valve, port in positions.items()]


def answer_plainly(oracle: Oracle, line: Mapping[str, object]) -> dict[str, Any]:
    """Answer a line of requests as a compiler would, from what the oracle found."""
    try:
        request = parse_request(line)
    except NoRequestError as error:
        return _refusal("request", str(error), "volume")
    finding = oracle.ask(request)
    if finding.legs:
        return {"ok": True, "steps": write_plan(oracle.rig, request, finding.legs)}
    where = min(finding.break_ids)
    return _refusal("no-way", f"{finding.why}: the path breaks at {where}", where)


def _refusal(code: str, message: str, subject: str) -> dict[str, Any]:
    return {"ok": False, "findings": [{"code": code, "message": message, "subject": subject}]}


def action(device: str, name: str, **parameters: object) -> dict[str, Any]:
    """Return one action."""
    return {"device": device, "action": name, "parameters": parameters}


def set_port(valve: str, port: str) -> dict[str, Any]:
    """Turn a valve."""
    return action(valve, "set_port", port=port)


def move(pump: str, name: str, volume_ul: float, rate_ul_s: float = RATE_UL_S) -> dict[str, Any]:
    """Move a plunger."""
    return action(pump, name, volume_ul=volume_ul, rate_ul_s=rate_ul_s)
