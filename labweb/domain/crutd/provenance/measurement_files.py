"""Kept files and what was read from them, as entities that a measurement generated.

```text
resource ◀──used── measurement ◀──generated── file ◀──derived── reading, series
```
"""

from __future__ import annotations

from collections.abc import Iterator

from labweb.domain.crutd.provenance.provenance_graph import Bond, Fact, ProvKind, ProvNode, Relation
from labweb.domain.crutd.provenance.recorded_facts import (
    Clue,
    FileFact,
    MeasurementFact,
    ReadingFact,
)


def measurement(fact: MeasurementFact) -> tuple[list[ProvNode], list[Relation]]:
    """Return the measurement, its file, its readings and series, and what binds them.

    A measurement ends when its clue says. When nobody tells, it has no times at all, and the fact
    `counts_as_of` names the moment at which it was kept: it was measured before that.
    """
    name, file = f"measurement/{fact.id}", f"file/{fact.id}"
    is_told = fact.clue is not Clue.KEPT
    facts: dict[str, Fact] = {"moment_by": fact.clue.value}
    if not is_told:
        facts["counts_as_of"] = fact.at
    nodes = [
        ProvNode(
            id=name,
            kind=ProvKind.ACTIVITY,
            type="measurement",
            name=f"Measurement of {fact.name}",
            ended_at=fact.at if is_told else "",
            facts=facts,
        ),
        ProvNode(id=file, kind=ProvKind.ENTITY, type="file", name=fact.name, facts=_file(fact)),
    ]
    relations = [
        Relation(bond=Bond.GENERATED, later=file, earlier=name, at=fact.at if is_told else "")
    ]
    for node in [*_made(fact), *map(_reading, fact.readings)]:
        nodes.append(node)
        relations.append(Relation(bond=Bond.DERIVED, later=node.id, earlier=file))
    return nodes, relations


def _file(fact: MeasurementFact | FileFact) -> dict[str, Fact]:
    form = {"format": fact.format} if isinstance(fact, MeasurementFact) else {}
    return {
        **form,
        "media_type": fact.media_type,
        "size_bytes": fact.size_bytes,
        "sha256": fact.sha256,
    }


def _made(fact: MeasurementFact) -> Iterator[ProvNode]:
    for made in fact.made:
        name = f"file/{made.id}"
        yield ProvNode(
            id=name, kind=ProvKind.ENTITY, type="series", name=made.name, facts=_file(made)
        )


def _reading(fact: ReadingFact) -> ProvNode:
    told: dict[str, Fact] = {"quantity": fact.quantity, "unit": fact.unit}
    if fact.value is not None:
        told["value"] = fact.value
    if fact.series is not None:
        told["points_count"] = int(fact.series["points_count"])
    if fact.measured_at:
        told["measured_at"] = fact.measured_at
    kept = {key: value for key, value in told.items() if value != ""}
    name = f"reading/{fact.id}"
    return ProvNode(id=name, kind=ProvKind.ENTITY, type="reading", name=fact.name, facts=kept)
