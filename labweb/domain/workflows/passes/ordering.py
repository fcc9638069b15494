"""Steps that share something must say which comes first; the order is never guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from uuid import UUID

from labweb.domain.crutd.operations import touched_ids
from labweb.domain.errors import Finding
from labweb.domain.workflows.passes.draft import DraftStep
from labweb.domain.workflows.passes.view import LabView


def check_order(
    drafts: Sequence[DraftStep], earlier: Mapping[str, frozenset[str]], view: LabView
) -> list[Finding]:
    """List every pair of steps that touch the same thing with no edge between them."""
    touched = [(draft.step.id, _touched(draft)) for draft in drafts]
    findings = []
    for place, (later_id, later_ids) in enumerate(touched):
        for earlier_id, earlier_ids in touched[:place]:
            shared = later_ids & earlier_ids
            if not shared or earlier_id in earlier[later_id] or later_id in earlier[earlier_id]:
                continue
            names = sorted({view.names.get(str(i), str(i)) for i in shared})
            message = (
                f"steps {earlier_id} and {later_id} both use {', '.join(names)}: "
                "draw an edge to say which comes first"
            )
            context = {"field": "edges", "other": earlier_id, "shared": names}
            findings.append(Finding("protocol.unordered", message, later_id, context))
    return findings


def _touched(draft: DraftStep) -> frozenset[UUID]:
    ids: set[UUID] = set()
    for job in draft.jobs:
        # What only one of several devices would touch is free for another step.
        ways = [one.locks.union(touched_ids(one.operation)) for one in job.choices or (job,)]
        ids |= frozenset.intersection(*ways)
    if draft.whole is not None:
        ids |= {draft.whole.source_id, draft.whole.target_id}
    return frozenset(ids)
