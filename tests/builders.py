"""Valid things by one-word names: a lab, its people, a run, and the host that works it off."""

from __future__ import annotations

import base64
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from django.db.models import Q

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.domain.crutd import operations, settlement
from labweb.domain.crutd.settlement import Outcome, OutcomeKind, ResourceState
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.messages.commands import Do, Resolve
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.messages.session import Hello, hello_bytes
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.runs.host_journal import action_states as edge
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import Device, EdgeHost
from labweb.enrollment.services import CatalogDriver
from labweb.fleet.services import host_events
from labweb.resources.models import Connection, Lab, Resource
from labweb.runs import services as run_services
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.runs.services import seed
from labweb.workflows.models import WorkflowVersion
from tests.again import again

STARTER = Path(__file__).parents[1] / "fixtures" / "labs" / "starter"
PASSWORD = "a-long-enough-passphrase"
MOVE_WATER = "Move 5 mL of water"
HEAT = "Heat and stir"
ROLES = ("observer", "chemist", "approver", "admin")


@cache
def catalog() -> dict[str, CatalogDriver]:
    """Return the package's drivers; they are read once per session."""
    return enrollment_services.read_catalog()


@cache
def starter() -> LabFile:
    """Return the starter lab as its file says."""
    return read_lab((STARTER / "lab.json").read_bytes())


@cache
def host_key() -> Ed25519PrivateKey:
    """Return the key of every host in these tests."""
    return Ed25519PrivateKey.generate()


def public_half(key: Ed25519PrivateKey) -> str:
    """Return a public key as a host's row keeps it."""
    return base64.b64encode(key.public_key().public_bytes_raw()).decode()


def off(tube: Connection) -> operations.Disconnect:
    """Return what takes a connection off that somebody has seen to be empty."""
    return operations.Disconnect(
        connection_id=tube.pk,
        key=tube.key,
        source_id=tube.source_id,
        source_port=tube.source_port,
        target_id=tube.target_id,
        target_port=tube.target_port,
        medium=tube.medium,
        is_seen_empty=True,
    )


@dataclass
class Bench:
    """A lab with shorthand for what tests ask for."""

    lab: Lab
    file: LabFile
    people: dict[str, User] = field(default_factory=dict)

    def node(self, key: str) -> Resource:
        """Return a resource by its key, as it is now."""
        return Resource.objects.get(lab=self.lab, key=key)

    def unplug(self, key: str) -> Resource:
        """Take every tube and wire off a resource, so that it may be carried; return it."""
        row = self.node(key)
        for tube in Connection.objects.filter(Q(source=row) | Q(target=row)):
            crutd_services.carry_out(
                off(tube), lab=self.lab, actor_id=self.people["admin"].pk, note="taken off"
            )
        return row

    def device(self, key: str) -> Device:
        """Return a device by its key, as it is now."""
        return Device.objects.get(lab=self.lab, key=key)

    @property
    def host(self) -> EdgeHost:
        """Return the lab's own host, as it is now."""
        return EdgeHost.objects.get(lab=self.lab, key=self.file.hosts[0].key)

    def version(self, workflow: str) -> WorkflowVersion:
        """Return version 1 of a template."""
        return WorkflowVersion.objects.get(workflow__name=workflow, number=1)


def a_lab(*, discovered: Sequence[str] = ()) -> Bench:
    """Give the starter lab, with everybody in it, templates, policy and devices.

    It is built once per process (see `tests.again`).
    """
    again(("lab", *discovered), lambda: _build_lab(discovered))
    lab_file = starter()
    people = {row.username: row for row in User.objects.filter(username__in=ROLES)}
    return Bench(Lab.objects.get(pk=lab_file.id), lab_file, {role: people[role] for role in ROLES})


def _build_lab(discovered: Sequence[str]) -> None:
    lab_file = starter()
    lab = crutd_services.import_lab(lab_file, actor=None, source={"file": "lab.json"})
    root = Resource.objects.get(lab=lab, parent__isnull=True)
    for role in ROLES:
        a_user(role, on=root)
    for host in lab_file.hosts:
        enrollment_services.add_host(
            lab, key=host.key, name=host.name, host_id=host.id, public_key=public_half(host_key())
        )
    for entry in lab_file.devices:
        enrollment_services.found_device(
            lab,
            entry.id,
            key=entry.key,
            name=entry.name,
            host_id=entry.host_id,
            driver=enrollment_services.keep_driver(catalog()[entry.driver]),
            transport=f"virtual:{entry.key}",
            config=dict(entry.config),
            nodes={role: str(node) for role, node in entry.nodes.items()},
            state="candidate" if entry.key in discovered else "enrolled",
        )
    seed.seed_policy(lab.id)
    seed.seed_templates(lab.id, lab_file, STARTER / "workflows")


def a_user(role: str, *, on: Resource, name: str = "") -> User:
    """Make a person with a role on a subtree."""
    user, _ = account_services.ensure_user(
        name or role,
        full_name=f"{(name or role).title()} Person",
        password=PASSWORD,
        role=role,
        root_id=on.id,
    )
    return user


def a_started_run(bench: Bench, workflow: str = MOVE_WATER, *, actor: str = "chemist") -> Run:
    """Start a template; where a policy asks, the run waits for an answer."""
    return run_services.start_run(bench.version(workflow), actor=bench.people[actor])


def an_edge(bench: Bench) -> Edge:
    """Return the lab's host with an open session that has caught up."""
    host = Edge(bench)
    host.connect()
    return host


def next_job(run: Run) -> Job:
    """Return the first job that is not final, as it is now."""
    finals = ("complete", "aborted", "stopped", "rejected")
    return run.jobs.exclude(state__in=finals).order_by("index")[0]


def dispatched(run: Run) -> Attempt:
    """Dispatch what may go, and return the newest attempt of the run."""
    run_services.dispatch_ready()
    return Attempt.objects.filter(job__run=run).order_by("-at", "-dseq")[0]


def to_transfer(run: Run, edge: Edge) -> Attempt:
    """Work a run off up to its first liquid transfer, which is dispatched and not begun."""
    attempt = dispatched(run)
    while attempt.job.operation["op"] != "transfer_liquid":
        edge.complete(attempt)
        attempt = dispatched(run)
    return attempt


class Edge:
    """A host by its messages: a journal chained by hash, played into the server's intake."""

    def __init__(self, bench: Bench, key: Ed25519PrivateKey | None = None) -> None:
        """Begin an empty journal."""
        self.bench = bench
        self.key = key or host_key()
        self.host_id = bench.host.id
        self.journal_id = uuid4()
        self.epoch = 0
        self.events: list[EdgeEvent] = []

    @property
    def head(self) -> str:
        """Return the hash that the next event binds."""
        return self.events[-1].hash if self.events else ""

    def hello(self, nonce: str, **changes: Any) -> Hello:  # noqa: ANN401 - fields of Hello
        """Introduce the host, signed over the nonce."""
        plain = Hello(
            host_id=self.host_id,
            journal_id=self.journal_id,
            boot_id="boot",
            armed_boot_id="boot",
            epoch_last=self.epoch,
            seq_head=len(self.events),
            hash_head=self.head,
            acked_seq=0,
            seal_seq=len(self.events),
        )
        plain = msgspec.structs.replace(plain, **changes)
        signature = base64.b64encode(self.key.sign(hello_bytes(plain, nonce))).decode()
        return msgspec.structs.replace(plain, signature=signature)

    def connect(self) -> None:
        """Open a session, and have the server see the host as online."""
        self.epoch = enrollment_services.open_session(self.hello("nonce"), "nonce").epoch
        enrollment_services.resume_host(self.host_id, self.epoch)

    def event(self, kind: str, action_id: UUID | None, **body: Any) -> EdgeEvent:  # noqa: ANN401
        """Append one fact to the journal."""
        bare = EdgeEvent(
            seq=len(self.events) + 1,
            prev_hash=self.head,
            hash="",
            kind=kind,
            action_id=action_id,
            at_s=1.0,
            body=body,
            happened_s=time.time(),
            uncertainty_s=0.001,
        )
        digest = event_hash(self.journal_id, self.head, bare)
        made = msgspec.structs.replace(bare, hash=digest)
        self.events.append(made)
        return made

    def send(self, *events: EdgeEvent) -> int | None:
        """Play events into the server."""
        return host_events.ingest_events(self.host_id, self.epoch, events)

    def report(self, kind: str, action_id: UUID | None, **body: Any) -> int | None:  # noqa: ANN401
        """Append one fact and send it."""
        return self.send(self.event(kind, action_id, **body))

    def begin(self, attempt: Attempt) -> None:
        """Accept and start an action."""
        self.report("accepted", attempt.id)
        self.report("started", attempt.id, pid=4242)

    def act(self, attempt: Attempt) -> None:
        """Accept, start and actuate an action."""
        self.begin(attempt)
        self.report("actuated", attempt.id, report={"ok": True})

    def settled(self, attempt: Attempt, outcome: Outcome) -> dict[str, Any]:
        """Decide the end of an action from what its command says, as a host does."""
        row = Outbox.objects.get(action_id=attempt.id, kind="do")
        do = msgspec.convert(row.body, Do)
        states = {
            view.id: ResourceState(
                id=view.id,
                name=view.name,
                kind=view.kind,
                parent_id=view.parent_id,
                contents={LotId(lot): amount for lot, amount in view.contents.items()},
                capacity_nl=view.capacity_nl,
                dead_volume_nl=view.dead_volume_nl,
                data=view.data,
                knows_masses=False,
            )
            for view in do.resources
        }
        change = settlement.settle(operations.from_json(do.operation), states, outcome)
        changed = {str(i) for i in crutd_services.transactions.changed_ids(change)}
        return {
            "change": change.to_json(),
            "revs": {str(v.id): v.rev + 1 for v in do.resources if str(v.id) in changed},
            "verification": "device",
            "outcome": {
                "kind": outcome.kind.value,
                "moved_nl": outcome.moved_nl,
                "data": dict(outcome.data),
            },
        }

    def complete(self, attempt: Attempt) -> None:
        """Carry an action out as asked."""
        self.act(attempt)
        self.finish(attempt)

    def finish(self, attempt: Attempt) -> None:
        """Report an action that acted as done."""
        self.report("complete", attempt.id, **self.settled(attempt, Outcome(kind=OutcomeKind.DONE)))

    def lose(self, attempt: Attempt) -> None:
        """Begin an action, and not know what became of it."""
        self.begin(attempt)
        body = self.settled(attempt, Outcome(kind=OutcomeKind.UNKNOWN))
        self.report("in_doubt", attempt.id, **body, code="device.timeout", message="no answer")

    def resolve(self, attempt: Attempt) -> None:
        """Settle an action in doubt by the answer that a person has sent."""
        row = Outbox.objects.filter(action_id=attempt.id, kind="resolve").latest("id")
        answer = msgspec.convert(row.body, Resolve)
        found = edge.resolve(answer.answer, moved_nl=answer.moved_nl)
        assert found is not None
        state, outcome = found
        self.report(
            "resolved",
            attempt.id,
            **self.settled(attempt, outcome),
            state=state.value,
            answer=answer.answer,
            note=answer.note,
            issued_by=answer.issued_by,
            **({"despite_reading": answer.despite_reading} if answer.despite_reading else {}),
        )

    def work_off(self, run: Run) -> None:
        """Dispatch and carry out one job after the other until nothing more may go."""
        while run_services.dispatch_ready():
            sent = Attempt.objects.filter(job__run=run, job__state="dispatched")
            for attempt in sent.order_by("dseq"):
                self.complete(attempt)
