"""What led to a thing, what it touched, and under which conditions."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from labweb.common.answers import ApiAnswer, KeyedRef, NamedRef
from labweb.domain.crutd.provenance.provenance_graph import Bond, ProvKind
from labweb.domain.runs.states.job_states import JobState


class ProvenanceNode(ApiAnswer):
    """One entity, activity or agent."""

    id: str
    """`sort/identity`; unique in a lab."""

    kind: ProvKind
    type: str
    """`lot`, `state`, `transaction` and the like."""

    name: str
    started_at: str | None
    ended_at: str | None
    place: str | None
    """Node at which it was."""

    facts: dict[str, str | int | float | bool]


class ProvenanceRelation(ApiAnswer):
    """One bond between two nodes."""

    bond: Bond
    later: str
    """What came of it, or who acted."""

    earlier: str
    """What it came of, or for whom."""

    role: str
    at: str | None
    third: str | None
    """Plan of an association; activity of a delegation."""

    is_revision: bool
    facts: dict[str, str | int | float | bool]


class ProvenanceTruncation(ApiAnswer):
    """What was left out of a graph."""

    is_truncated: bool
    beyond: int
    unread: list[str]
    has_more_acts: bool


class ProvenanceGraph(ApiAnswer):
    """What led to a thing and what it touched; `form=prov` gives a PROV-JSON document instead."""

    root: str
    nodes: list[ProvenanceNode]
    relations: list[ProvenanceRelation]
    truncation: ProvenanceTruncation


class StayAct(ApiAnswer):
    """What a device did while a resource was in it."""

    job_id: UUID
    run_id: UUID
    sentence: str
    state: JobState
    started_at: str
    ended_at: str | None
    uncertainty_s: float | None
    driver_digest: str
    reported: dict[str, Any]
    contexts: dict[str, Any]
    """Surroundings by moment, as they are kept."""


class StayFile(ApiAnswer):
    """A file that came from a device while a resource was in it."""

    file_id: UUID
    name: str
    sha256: str
    job_id: UUID | None
    resource_id: UUID | None
    at: datetime
    moment_by: str
    """How it is known when it was measured."""


class DeviceStay(ApiAnswer):
    """The time that a resource was in a device, and what that told and did."""

    since: datetime
    until: datetime
    series: dict[str, list[tuple[float, Any]]]
    """By status: pairs of seconds since the Unix epoch and a value."""

    acts: list[StayAct]
    files: list[StayFile]
    has_more_acts: bool


class ResourceConditions(ApiAnswer):
    """What a device told while a resource was in it."""

    resource: NamedRef
    device: KeyedRef
    stays: list[DeviceStay]
    is_truncated: bool
