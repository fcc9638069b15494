"""Take and release what runs keep for themselves, and refuse to others what they keep."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from labweb.accounts import selectors as account_selectors
from labweb.common.clock import new_id, now
from labweb.common.database.prepared_queries import Question
from labweb.crutd.models import RunHold
from labweb.crutd.selectors.run_holds import HeldAt, holds_on
from labweb.domain.crutd import operations
from labweb.domain.errors import Finding, LockedError
from labweb.domain.runs.exclusive_use.run_holds import (
    Above,
    UseMode,
    excludes,
    may_use_by_hand,
    modes_of,
    with_above,
)
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource

_TAKE = """
INSERT INTO crutd_runhold
    (id, resource_id, run_id, run_number, holder_id, mode, until_step, taken_at)
SELECT id, resource_id, %(run)s, %(number)s, %(holder)s, mode, until_step, %(at)s
FROM unnest(%(ids)s::uuid[], %(resources)s::uuid[], %(modes)s::text[], %(steps)s::int[])
    AS taken(id, resource_id, mode, until_step)
ON CONFLICT (run_id, resource_id) WHERE released_at IS NULL
DO UPDATE SET mode = EXCLUDED.mode, until_step = EXCLUDED.until_step
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Keeper:
    """The run that takes something."""

    run_id: UUID
    number: int
    holder_id: UUID


def taking(keeper: Keeper, modes: Mapping[UUID, tuple[UseMode, int]]) -> Question[Any]:
    """Return what gives things to a run: how it holds each, and until which of its steps.

    The rows of the things are locked, and nobody stands in the way. What it holds already it
    holds so from here on.

    Raises:
        django.db.IntegrityError: Another run holds one alone: the last bar.
    """
    ids = sorted(modes)
    values: dict[str, Any] = {
        "run": keeper.run_id,
        "number": keeper.number,
        "holder": keeper.holder_id,
        "at": now(),
        "ids": [new_id() for _ in ids],
        "resources": ids,
        "modes": [modes[one][0].value for one in ids],
        "steps": [modes[one][1] for one in ids],
    }
    return Question(_TAKE, values, tuple)


def release_holds(run_id: UUID, ids: Collection[UUID]) -> int:
    """Let go what a run cannot need any more.

    Returns:
        How many holds ended.

    Effect:
        None on matter. Others may use the things from here on.
    """
    rows = RunHold.objects.filter(run_id=run_id, resource_id__in=ids, released_at=None)
    return rows.update(released_at=now())


@dataclass(frozen=True, slots=True, kw_only=True)
class Asker:
    """Who wants to use something."""

    actor_id: UUID | None
    run_id: UUID | None = None
    """The run for which it is done; None: a person does it by hand."""


def held_findings(
    operation: operations.Operation, ids: Collection[UUID], asker: Asker
) -> list[Finding]:
    """List what runs hold of the resources of an operation, of those above and of those below."""
    holds = holds_on(ids)
    if not holds:
        return []
    rows = {row.id: row for row in resource_selectors.rows(ids)}
    return findings_of_holds(operation, rows, resource_selectors.ancestors(ids), holds, asker)


def check_unheld(
    operation: operations.Operation,
    rows: Mapping[UUID, Resource],
    above: Above,
    holds: Iterable[HeldAt],
    asker: Asker,
) -> None:
    """Refuse what another run keeps for itself, by name.

    Raises:
        LockedError: `crutd.held_by_run`; findings say which run holds what, and until when.
    """
    findings = findings_of_holds(operation, rows, above, holds, asker)
    if findings:
        first = findings[0]
        raise LockedError(
            first.message, code=first.code, findings=findings, context=dict(first.context)
        )


def findings_of_holds(
    operation: operations.Operation,
    rows: Mapping[UUID, Resource],
    above: Above,
    holds: Iterable[HeldAt],
    asker: Asker,
) -> list[Finding]:
    """List the holds of others that an operation is not allowed to break into."""
    foreign = [one for one in holds if not _is_open_to(asker, operation, rows, one)]
    if not foreign:
        return []
    kinds = {row.id: row.kind for row in rows.values()}
    touched = set(operations.touched_ids(operation))
    wanted = with_above(modes_of(operation, set(rows) - touched, kinds), above)
    broken: dict[tuple[UUID, UUID], HeldAt] = {}
    for one in foreign:
        if any(excludes(mode, one.mode) for mode in wanted.get(one.node_id, ())):
            broken.setdefault((one.run_id, one.resource_id), one)
    names = account_selectors.printed_names(str(one.holder_id) for one in broken.values())
    return [_finding(one, rows, names) for one in broken.values()]


def _is_open_to(
    asker: Asker, operation: operations.Operation, rows: Mapping[UUID, Resource], one: HeldAt
) -> bool:
    if asker.run_id is not None:
        return asker.run_id == one.run_id
    targets = (operation.resource_id,) if isinstance(operation, operations.Correct) else ()
    is_quarantined = any(rows[node].quarantined_by is not None for node in targets if node in rows)
    return may_use_by_hand(
        operation, is_holder=asker.actor_id == one.holder_id, is_quarantined=is_quarantined
    )


def _finding(one: HeldAt, rows: Mapping[UUID, Resource], names: Mapping[str, str]) -> Finding:
    whose = names.get(str(one.holder_id), "")
    run = f"run #{one.run_number}{f' of {whose}' if whose else ''}"
    if one.resource_id in rows:
        text = f"{rows[one.resource_id].name} is held by {run}"
    elif one.node_id in rows:
        text = f"{run} holds something that stands in {rows[one.node_id].name}"
    else:
        asked = " and ".join(sorted(row.name for row in rows.values()))
        text = f"{run} holds the place of {asked}"
    return Finding(
        "crutd.held_by_run",
        f"{text} until its step {one.until_step} has ended: wait for that step, or ask "
        f"{whose or 'whoever started it'} to abort the run",
        str(one.resource_id),
        {
            "resource_id": str(one.resource_id),
            "run_id": str(one.run_id),
            "run": one.run_number,
            "until_step": one.until_step,
        },
    )
