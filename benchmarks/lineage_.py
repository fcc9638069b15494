"""Where a sample came from, 50 transfers deep, among a million events."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from functools import partial
from uuid import UUID

import psycopg

from benchmarks.figures import Figure, Options, p95_ms, timed
from benchmarks.history import DEPTH, PER_ROUND, analyze, make_history, verified
from benchmarks.labs import a_lab, grow
from labweb.crutd.selectors.lineage import DEEPEST, lineage
from labweb.records.selectors import provenance
from labweb.resources.models import Resource
from labweb.resources.selectors import Lab

EVENTS = 1_000_000
LIMIT_MS = 100.0
ROUNDS = 50
"""How often each vessel was used, and emptied, before."""

SAMPLES = 200
MOST_VERIFIED = 20_000
"""Events up to which every row of the history is checked before it is measured in."""

_CTE = """
WITH RECURSIVE up AS (
    SELECT e.* FROM crutd_entry e
    JOIN crutd_holding h ON h.lot_id = e.lot_id AND h.resource_id = %s AND h.amount_nl > 0
    WHERE e.credit = %s AND e.state = 'posted'
    UNION ALL
    SELECT e.* FROM crutd_entry e JOIN up
    ON e.credit = up.debit AND e.lot_id = up.lot_id AND e.id < up.id AND e.state = 'posted'
)
SELECT * FROM up
"""
"""The bare chain of entries of the lots that are there now."""


def figures(options: Options) -> Iterator[Figure]:
    """Make a history of `size` events, then ask for samples at random."""
    events = options.size or EVENTS
    rounds = min(ROUNDS, max(2, events // PER_ROUND // 2))
    count = -(-events // (PER_ROUND * rounds - 1))
    lab = a_lab(wells=2)
    lines = _lines(lab, count)
    made = make_history(lab, lines, rounds)
    analyze()
    yield Figure(name="events", value=made, unit="")
    if made <= MOST_VERIFIED:
        yield Figure(
            name="ledger and chain hold as the services leave them (1: yes)",
            value=verified(lab),
            unit="",
            limit=1,
            is_floor=True,
        )
    yield from _asked([line[-1] for line in lines])


def _lines(lab: Lab, count: int) -> list[list[UUID]]:
    """Return so many lines of vessels, each through plates of its own."""
    grow(lab, count * (DEPTH + 1) * 97 // 96 + 200)
    wells = Resource.objects.filter(lab=lab, kind="well", key__startswith="well").order_by(
        "position"
    )
    ids = list(wells.values_list("id", flat=True)[: count * (DEPTH + 1)])
    return [ids[start : start + DEPTH + 1] for start in range(0, len(ids), DEPTH + 1)]


def _asked(samples: list[UUID]) -> Iterator[Figure]:
    choice = random.Random(0)
    rows = [Resource.objects.get(pk=choice.choice(samples)) for _ in range(SAMPLES)]
    deep = lineage(rows[0], direction="up", depth=DEEPEST)
    acts = sum(node["kind"] == "activity" for node in deep["nodes"])
    told = "transfers in the lineage of a sample"
    yield Figure(name=told, value=acts, unit="", limit=DEPTH, is_floor=True)
    taken = [timed(partial(lineage, row, direction="up", depth=DEEPEST)) for row in rows]
    yield Figure(name="lineage of a sample: p95", value=p95_ms(taken), unit="ms", limit=LIMIT_MS)
    ask = partial(provenance.of_resource, direction="up", depth=DEEPEST)
    taken = [timed(partial(ask, row)) for row in rows[: SAMPLES // 4]]
    told = "with jobs, people, drivers and all other acts on it: p95"
    yield Figure(name=told, value=p95_ms(taken), unit="ms")
    with psycopg.connect(os.environ["DATABASE_URL"]) as bare:
        taken = [timed(partial(_chain, bare, row.id)) for row in rows]
    yield Figure(name="peer: a bare CTE over the entries: p95", value=p95_ms(taken), unit="ms")


def _chain(bare: psycopg.Connection[tuple[object, ...]], vessel: UUID) -> None:
    bare.execute(_CTE, [vessel, str(vessel)]).fetchall()
