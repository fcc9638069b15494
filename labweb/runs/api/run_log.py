"""Render the lines of the log of a run as the browser reads them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import UUID

from labweb.crutd.answers import DoubtEnd
from labweb.crutd.selectors.doubt_resolutions import Resolved
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.runs import selectors
from labweb.runs.answers.runs import LogLine
from labweb.runs.models import HostEvent, Job, Run


def render_reported(
    event: HostEvent, jobs: Mapping[UUID, Job], ends: Mapping[UUID, Resolved | None]
) -> LogLine:
    """Render what a host reported of an action; by action its job, and how its doubt ended."""
    if event.action_id is None:
        raise ValueError(event)  # they were found by the actions
    job, end = jobs[event.action_id], ends[event.action_id]
    return LogLine(
        at=event.happened_at or event.received_at,
        received_at=event.received_at,
        uncertainty_s=event.uncertainty_s,
        is_bounded=event.is_bounded,
        job_id=job.id,
        job_index=job.index,
        kind=event.kind,
        text=_line(event.kind, event.body, job.sentence, end),
        resolved=_end_of(event.kind, end),
        body=event.body,
    )


def place_of(line: HostEvent | LogLine) -> list[Any]:
    """Order lines by time; what a host reported stands before how things went on from it."""
    if isinstance(line, HostEvent):
        return [(line.happened_at or line.received_at).timestamp(), line.pk, ""]
    return [line.at.timestamp(), 2**62, f"{line.kind} {line.text}"]


def _line(kind: str, report: dict[str, Any], sentence_text: str, end: Resolved | None) -> str:
    """Say what a host reported; of a doubt that is over, how it ended."""
    message = report.get("message")
    about = f", {message}" if message else ""
    if end is None or kind not in {"in_doubt", "resolved"}:
        return f"{sentence_text}: {kind.replace('_', ' ')}{about}"
    told = end.told()
    if kind == "resolved":
        return f"{sentence_text}: {told.text}" + (f". {told.note}" if told.note else "")
    return f"{sentence_text}: outcome not known then{about}. {told.text}"


def _end_of(kind: str, end: Resolved | None) -> DoubtEnd | None:
    if end is None or kind != "in_doubt":
        return None
    return end.told()


def render_hand_overs(run: Run) -> list[LogLine]:
    """Render, as lines of a log, how what a run carries went from host to host."""
    lines: list[LogLine] = []
    for move in selectors.moves_of_run(run):
        if move.job is None or move.origin is None or move.target is None:
            continue
        thing, first, second = move.resource.name, move.origin.name, move.target.name
        told = [("asked", move.at, f"{first} is asked to hand {thing} to {second}")]
        if move.released_at is not None:
            text = f"{thing} is released by {first}, in transit to {second}"
            told.append(("released", move.released_at, text))
        if move.ended_at is not None:
            ends = {
                move.target_id: ("received", f"{thing} is received by {second}"),
                move.origin_id: ("kept", f"{thing} is kept by {first}"),
            }
            text = f"nobody knows in whose hands {thing} is: a person takes stock of it"
            is_known = move.state == CustodyState.OWNED.value
            kind, text = ends.get(move.owner_id if is_known else None, ("lost", text))
            told.append((kind, move.ended_at, text))
        job_id, index = move.job.id, move.job.index
        lines += [
            LogLine(at=at, job_id=job_id, job_index=index, kind=kind, text=text, body={})
            for kind, at, text in told
        ]
    return lines
