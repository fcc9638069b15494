"""What of a workflow the proof of its recipe speaks of, and what takes that proof away.

A proof compares deeds (`check`). Where a step stands on the canvas, what it is called in a note,
and how the workflow is named are no deeds; neither is what a host does when it cannot hear the
server, which is no part of any plan of a recipe.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from labweb.domain.errors import Finding, LabError
from labweb.domain.recipes.agreement.deeds import Deed
from labweb.domain.recipes.agreement.meant import SAID, deeds_of_workflow
from labweb.domain.workflows.unit_operations.step_palette import called

_PORTS = ("source", "source_port", "target", "target_port")

Document = Mapping[str, Any]


def changes_since(proved: Document, document: Document, names: Mapping[str, str]) -> list[Finding]:
    """List what takes the proof of one document away from another; empty: it keeps it.

    In which order steps are listed counts for nothing: edges order all that have a vessel in
    common, or there would be no proof.

    Args:
        proved: The document that was proved.
        document: The one that a person made of it; it may be unfinished or malformed.
        names: Name by resource reference.
    """
    before, after = _steps(proved), _steps(document)
    said = {one: called(step, names) for one, step in {**after, **before}.items()}
    found = [_lost(f"{said[one]} was taken out", one) for one in before if one not in after]
    found += [_lost(f"{said[one]} was put in", one) for one in after if one not in before]
    for one in before.keys() & after.keys():
        found += _changed(before[one], after[one], names)
    found += _rewired(_edges(proved), _edges(document), said)
    return sorted(found, key=lambda finding: (finding.subject, finding.message))


def departs(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Tell whether a step with other values does anything else that a proof speaks of.

    `5 mL` and `5000 uL` are one amount, and a balance that looks on changes no deed.
    """
    if before["kind"] != after.get("kind"):
        return True
    if before["kind"] not in SAID:
        return bool(before["params"] != after.get("params"))
    try:
        return _meant(before) != _meant(after)
    except (LabError, LookupError, TypeError, ValueError):
        return True


def _meant(step: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    deeds: list[Deed] = list(deeds_of_workflow({"steps": [step]}))
    return [(deed.what, deed.rates_ul_s, deed.pumps) for deed in deeds]


def _steps(document: Document) -> dict[str, Mapping[str, Any]]:
    steps = document.get("steps")
    rows = steps if isinstance(steps, list) else []
    return {str(row.get("id")): row for row in rows if isinstance(row, dict)}


def _edges(document: Document) -> Counter[tuple[str, ...]]:
    edges = document.get("edges")
    rows = edges if isinstance(edges, list) else []
    return Counter(_edge(row) for row in rows if isinstance(row, dict))


def _edge(row: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(str(row.get(name)) for name in _PORTS)


def _changed(
    before: Mapping[str, Any], after: Mapping[str, Any], names: Mapping[str, str]
) -> Iterator[Finding]:
    step, said = str(before["id"]), called(before, names)
    if before.get("kind") != after.get("kind"):
        yield _lost(f"{said} became {called(after, names)}", step)
        return
    if not departs(before, after):
        return
    was = before["params"]
    given = after.get("params")
    now = given if isinstance(given, dict) else {}
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            values = f"{_told(was.get(name), names)} and is {_told(now.get(name), names)}"
            yield _lost(f"{name} of {said} was {values}", step, f"params.{name}")


def _told(value: object, names: Mapping[str, str]) -> str:
    return "left open" if value is None else names.get(str(value), str(value))


def _rewired(
    before: Counter[tuple[str, ...]], after: Counter[tuple[str, ...]], said: Mapping[str, str]
) -> list[Finding]:
    gone = [(edge, "was taken out") for edge in (before - after)]
    new = [(edge, "was put in") for edge in (after - before)]
    return [
        _lost(
            f"the edge from {said.get(source, source)} to {said.get(target, target)} {what}",
            target,
        )
        for (source, _, target, _), what in gone + new
    ]


def _lost(message: str, step: str, field: str = "") -> Finding:
    return Finding("recipe.proof_lost", message, step, {"field": field} if field else {})
