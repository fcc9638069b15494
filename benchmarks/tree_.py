"""The tree at a million resources: below a plate, above a well, one by its id, and a move."""

from __future__ import annotations

import os
import random
import statistics
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any
from uuid import UUID, uuid4

import psycopg
from django.db import connection

from benchmarks.figures import Figure, Options, p95_ms, timed
from benchmarks.history import analyze
from benchmarks.labs import a_lab, grow
from benchmarks.transfer_ import rows_of
from labweb.accounts.selectors import User
from labweb.crutd import services
from labweb.domain.crutd.operations import TransferResource
from labweb.resources import selectors
from labweb.resources.models import Resource
from labweb.resources.selectors import Lab

RESOURCES = 1_000_000
LIMIT_MS = 10.0
SAMPLES = 400
PEERS = 3
MOST_NODES = 500
PLATES = {"a 96-well plate": 96, "a 384-well plate": 384}

_WHOLE_TREE = """
WITH RECURSIVE tree AS (
    SELECT id, ARRAY[id] AS path FROM resources_resource WHERE parent_id IS NULL
    UNION ALL
    SELECT r.id, tree.path || r.id FROM resources_resource r JOIN tree ON r.parent_id = tree.id
)
SELECT id FROM tree WHERE %s = ANY(path)
"""
"""The tree from its root with the path to each node, as generic libraries write it."""


def figures(options: Options) -> Iterator[Figure]:
    """Make `size` resources, then ask for some of them at random."""
    lab = a_lab(wells=2)
    grow(lab, options.size or RESOURCES)
    plates = {name: _a_plate(lab, wells) for name, wells in PLATES.items()}
    analyze()
    yield Figure(name="resources in the tree", value=Resource.objects.count(), unit="")
    choice = random.Random(0)
    wells = _some(lab, "well", choice)
    below = [*_some(lab, "plate", choice), *plates.values()]
    largest = max(len(selectors.descendants([plate])) for plate in plates.values())
    yield Figure(name="largest subtree asked for", value=largest, unit="", limit=MOST_NODES)
    questions: tuple[tuple[str, Callable[[UUID], object], list[UUID]], ...] = (
        ("subtree, its ids", lambda node: selectors.descendants([node]), below),
        ("subtree, its rows", _subtree, below),
        ("ancestor path", lambda node: selectors.ancestors([node]), wells),
        ("find by id", selectors.find_resource, wells),
    )
    for name, ask, ids in questions:
        taken = p95_ms(_each(ask, ids))
        yield Figure(name=f"{name}: p95", value=taken, unit="ms", limit=LIMIT_MS)
    yield from _peers(below, wells)
    yield from _moves(lab, plates)


def _each(ask: Callable[[UUID], object], ids: Sequence[UUID]) -> list[float]:
    """Return how long each answer takes, s; the first one, which plans, is not counted."""
    ask(ids[0])
    return [timed(partial(ask, node)) for node in ids]


def _subtree(node: UUID) -> list[Resource]:
    return list(selectors.rows(selectors.descendants([node])))


def _some(lab: Lab, kind: str, choice: random.Random) -> list[UUID]:
    ids = list(Resource.objects.filter(lab=lab, kind=kind).values_list("id", flat=True))
    return [choice.choice(ids) for _ in range(SAMPLES)]


def _a_plate(lab: Lab, wells: int) -> UUID:
    table = Resource.objects.get(lab=lab, key="table")
    made = uuid4()
    with connection.cursor() as cursor:
        cursor.execute(_PLATE, {"lab": lab.id, "plate": made, "table": table.id, "wells": wells})
    return made


_PLATE = """
INSERT INTO resources_resource (id, lab_id, parent_id, key, name, kind, nature, config, data,
    extra, rev, is_archived, position)
SELECT CASE n WHEN 0 THEN %(plate)s ELSE gen_random_uuid() END, %(lab)s,
    CASE n WHEN 0 THEN %(table)s ELSE %(plate)s END, %(plate)s::text || '/' || n, 'plate',
    CASE n WHEN 0 THEN 'plate' ELSE 'well' END, 'resource', '{}', '{}', '{}', 1, false, n
FROM generate_series(0, %(wells)s) AS n
"""


def _peers(below: Sequence[UUID], wells: Sequence[UUID]) -> Iterator[Figure]:
    """Ask the same of the same table without our statements."""
    with psycopg.connect(os.environ["DATABASE_URL"], autocommit=True) as bare:
        whole = _each(lambda node: bare.execute(_WHOLE_TREE, [node]).fetchall(), below[:PEERS])
        told = "peer: subtree by a CTE over the whole tree, median"
        yield Figure(name=told, value=statistics.median(whole) * 1e3, unit="ms")
        climbed = p95_ms(_each(partial(_climb, bare), wells))
        yield Figure(name="peer: a query for each ancestor, p95", value=climbed, unit="ms")
        found = p95_ms(_each(partial(_find, bare), wells))
        yield Figure(name="peer: bare select by key, p95", value=found, unit="ms")


def _find(bare: psycopg.Connection[tuple[Any, ...]], node: UUID) -> tuple[Any, ...]:
    [found] = bare.execute("SELECT * FROM resources_resource WHERE id = %s", [node]).fetchall()
    return found


def _climb(bare: psycopg.Connection[tuple[Any, ...]], start: UUID) -> None:
    node: UUID | None = start
    while node is not None:
        query = "SELECT parent_id FROM resources_resource WHERE id = %s"
        [(node,)] = bare.execute(query, [node]).fetchall()


def _moves(lab: Lab, plates: dict[str, UUID]) -> Iterator[Figure]:
    """Move each plate, and count the rows written; the number must not follow the wells."""
    counts = {name: sum(map(sum, _moved(lab, plate).values())) for name, plate in plates.items()}
    least = min(counts.values())
    for name, count in counts.items():
        yield Figure(name=f"rows written to move {name}", value=count, unit="", limit=least)
    large = plates["a 384-well plate"]
    taken = [timed(_mover(lab, large)) for _ in range(SAMPLES // 10)]
    yield Figure(name="move of a 384-well plate by hand: p95", value=p95_ms(taken), unit="ms")


def _moved(lab: Lab, plate: UUID) -> dict[str, tuple[int, int]]:
    [rows] = rows_of(_mover(lab, plate))
    return dict(rows)


def _mover(lab: Lab, plate: UUID) -> Callable[[], object]:
    """Return what carries a plate from the table to the shelf, or back."""
    ends = {key: Resource.objects.get(lab=lab, key=key).id for key in ("shelf", "table")}
    person = User.objects.get_or_create(username="hand")[0].pk

    def act() -> None:
        here = Resource.objects.values_list("parent_id", flat=True).get(pk=plate)
        there = ends["table"] if here == ends["shelf"] else ends["shelf"]
        operation = TransferResource(resource_id=plate, from_id=here, to_id=there)
        services.carry_out(operation, lab=lab, actor_id=person)

    return act
