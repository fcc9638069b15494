"""What is on record, as the graph is built from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow


@dataclass(frozen=True, slots=True, kw_only=True)
class TransactionFact:
    """One transaction with the event that settled it."""

    id: str
    seq: int
    """Place of its event in the lab's chain; 0 when it has none yet."""

    name: str
    state: str
    started_at: str
    ended_at: str = ""
    operation: Mapping[str, Any]
    change: Mapping[str, Any] = field(default_factory=dict)
    verification: str = ""
    code: str = ""
    event_hash: str = ""
    actor_id: str = ""
    job_id: str = ""
    doubt_at: str = ""
    """When its outcome was not known, where a person has said since what it was."""

    resolved: str = ""
    """How that ended, by whom and when."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFact:
    """One action of a run, with what the host reported of it."""

    id: str
    run_id: str
    index: int
    sentence: str
    action: str
    state: str
    device_id: str
    host_id: str
    driver_digest: str
    verification: str = ""
    started_at: str = ""
    ended_at: str = ""
    worker_pid: int | None = None
    report: Mapping[str, Any] = field(default_factory=dict)
    contexts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By `started` and `actuated`: versions and readings of that moment."""

    resolved_by: str = ""
    """Person who said what had happened."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionFact:
    """A person's answer to the question whether a run may go."""

    id: str
    run_id: str
    actor_id: str
    meaning: str
    is_approved: bool
    at: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFact:
    """One run with its plan and the version it was compiled from."""

    id: str
    number: int
    state: str
    workflow: str
    version_id: str
    version_number: int
    version_digest: str
    version_author_id: str = ""
    version_at: str
    plan_digest: str
    created_by_id: str
    started_at: str = ""
    ended_at: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceFact:
    """One instrument and the host that owns it."""

    id: str
    name: str
    host_id: str
    nodes: Sequence[str] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceFact:
    """One node of the tree."""

    id: str
    name: str
    kind: str
    collection_id: str = ""
    """Plate or rack it stands in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LotFact:
    """One delivery."""

    id: str
    name: str
    material: str
    number: str = ""
    supplier: str = ""
    expires_on: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFact:
    """One file that belongs to a run."""

    name: str
    run_id: str
    media_type: str
    size_bytes: int
    sha256: str
    id: str = ""
    """Of a kept file: the row that keeps it. Else the file goes by its checksum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingFact:
    """One thing that a kept file tells."""

    id: str
    name: str
    quantity: str
    unit: str = ""
    value: float | str | None = None
    """None: it is a series."""

    series: Mapping[str, Any] | None = None
    measured_at: str = ""


class Clue(StrEnum):
    """Who tells when something was measured."""

    JOB = "job"
    """The job that it belongs to."""

    FILE = "file"
    """The file, with its offset."""

    KEPT = "kept"
    """Nobody: it was measured before it was kept, and counts as of then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasurementFact:
    """A file as it came from an instrument or a person, and what was read from it."""

    id: str
    """Of the file."""

    seq: int
    """Place in the lab's chain of the last event before the measurement ended."""

    at: str
    clue: Clue
    name: str
    format: str
    media_type: str
    size_bytes: int
    sha256: str
    resource_id: str = ""
    device_id: str = ""
    job_id: str = ""
    kept_by_id: str = ""
    readings: Sequence[ReadingFact] = ()
    made: Sequence[FileFact] = ()
    """Series that were made from it; their `run_id` is empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFacts:
    """All that a graph is built from. What is named and not here is left out of the graph."""

    root: str
    flows: Sequence[LedgerFlow] = ()
    transactions: Sequence[TransactionFact] = ()
    jobs: Sequence[JobFact] = ()
    runs: Sequence[RunFact] = ()
    decisions: Sequence[DecisionFact] = ()
    devices: Sequence[DeviceFact] = ()
    resources: Sequence[ResourceFact] = ()
    lots: Sequence[LotFact] = ()
    files: Sequence[FileFact] = ()
    measurements: Sequence[MeasurementFact] = ()
    hosts: Mapping[str, str] = field(default_factory=dict)
    """Name by id."""

    people: Mapping[str, str] = field(default_factory=dict)
    """Printed name by id."""

    drivers: Mapping[str, str] = field(default_factory=dict)
    """Class by digest of its source."""
