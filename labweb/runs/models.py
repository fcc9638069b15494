"""Runs, jobs, attempts, the outbox and the events of hosts."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base, enum_choices
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.domain.runs.halts.halt_progress import HaltState
from labweb.domain.runs.states.job_states import JobState, RunState


class Run(Base):
    """One execution of a workflow version."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="runs")
    number = models.PositiveIntegerField()
    version = models.ForeignKey(
        "workflows.WorkflowVersion", on_delete=models.PROTECT, related_name="runs"
    )
    plan = models.JSONField()
    plan_digest = models.CharField(max_length=64)
    state = models.CharField(max_length=20, choices=enum_choices(RunState))
    created_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    created_at = models.DateTimeField()
    ask_id = models.UUIDField(null=True, unique=True)
    """The wish of a node beside a host that it came from; None: a person started it."""

    ask_host = models.ForeignKey(
        "enrollment.EdgeHost", null=True, on_delete=models.PROTECT, related_name="+"
    )
    started_at = models.DateTimeField(null=True)
    ended_at = models.DateTimeField(null=True)
    is_given_up = models.BooleanField(default=False)
    """A person gave it up: it ends as soon as nothing of it is under way."""

    given_up = models.JSONField(null=True)
    """Who gave it up, when and why: `{"by", "by_id", "at", "reason"}`; None: nobody has."""

    recoveries = models.JSONField(default=list)
    """What people did about jobs that ended undone: `{"choice", "job_id", "by", "by_id", "at",
    "note"}`, what else the choice says, and of a recipe `departs`: how it leaves what was
    proved, empty when it does not."""

    unproved = models.JSONField(null=True)
    """Who let it go on though it does something else than was proved: `{"by", "by_id", "at",
    "departures": [{"place", "text"}]}`; None: nobody."""

    claims = models.JSONField(null=True)
    """All that any of its paths may use, as `domain.runs.claims.Claims`; None: read from its jobs
    when it first asks."""

    waits = models.JSONField(null=True)
    """For whom and for what it waits: `{"since", "why", "run_id", "number", "resource_id",
    "resource", "until_step", "wanted", "text"}`; None: for nobody."""

    pause_reasons = models.JSONField(default=list)
    """Stacked: `{"kind", "by", "at"}`; it goes on when the list is empty."""

    class Meta:
        ordering = ["-number"]
        constraints = [models.UniqueConstraint(fields=["lab", "number"], name="run_number_once")]

    def __str__(self) -> str:
        return f"Run #{self.number}"


class Job(Base):
    """One dispatched action of a run; intent, while an Attempt is one try."""

    run = models.ForeignKey(Run, on_delete=models.PROTECT, related_name="jobs")
    index = models.PositiveIntegerField()
    step_id = models.CharField(max_length=64)
    sentence = models.CharField(max_length=300)
    device = models.ForeignKey("enrollment.Device", on_delete=models.PROTECT, related_name="jobs")
    action = models.CharField(max_length=64)
    args = models.JSONField()
    operation = models.JSONField()
    pre = models.JSONField(default=list)
    post = models.JSONField(default=list)
    corrections = models.JSONField(default=list)
    """Arguments that a calibration has changed, as asked and as sent; `args` are as sent."""

    choices = models.JSONField(default=list)
    """The job on each device that may do it, as `Choice` of the plan; none: its device alone."""

    chosen = models.TextField(blank=True)
    """Why it is this device's, or why it waits for any; of a step that asks for a role."""

    after = models.JSONField(default=list)
    meets = models.PositiveIntegerField(null=True)
    """Index of the job that begins at the same moment on another device; null: none does."""

    asks = models.TextField(blank=True, default="")
    """What a person has to confirm before it is sent to a host; empty: nothing."""

    states = models.JSONField(null=True)
    """What a person states in its place, as `Statement` of the plan; null: nothing."""

    confirmed_at = models.DateTimeField(null=True)
    confirmed_by = models.ForeignKey("accounts.User", models.PROTECT, null=True, related_name="+")
    locks = models.JSONField(default=list)
    recovery = models.CharField(max_length=2, default="R3")
    estimate_s = models.FloatField(default=0)
    state = models.CharField(max_length=20, choices=enum_choices(JobState))
    state_at = models.DateTimeField()
    """When the server moved it there: of what a host tells, when it was received."""

    started_at = models.DateTimeField(null=True)
    ended_at = models.DateTimeField(null=True)
    """Both when it happened, by the server's clock."""

    uncertainty_s = models.FloatField(null=True)
    """They are wrong by no more; null: timed by the server, or older than this column."""

    is_bounded = models.BooleanField(default=False)
    """No clock told one of them: it lies between its cause and its reception."""

    verification = models.CharField(max_length=12, blank=True)
    code = models.CharField(max_length=100, blank=True)
    message = models.TextField(blank=True)
    evidence = models.JSONField(default=dict)
    passed_by = models.CharField(max_length=10, blank=True)
    """`skip`, `hand`: it ended undone, and a person goes on; `change`: others took its place."""

    halted_by = models.CharField(max_length=20, blank=True, default="")
    """Why a halt took away what it had set; `let_go`: a person goes on. Empty: it stands."""

    class Meta:
        ordering = ["index"]
        constraints = [models.UniqueConstraint(fields=["run", "index"], name="job_index_once")]
        indexes = [models.Index(fields=["state"])]

    def __str__(self) -> str:
        return self.sentence


class Attempt(Base):
    """One physical try of a job; its id is the action id the edge sees."""

    job = models.ForeignKey(Job, on_delete=models.PROTECT, related_name="attempts")
    number = models.PositiveIntegerField()
    host = models.ForeignKey("enrollment.EdgeHost", on_delete=models.PROTECT, related_name="+")
    transaction = models.OneToOneField(
        "crutd.Transaction", on_delete=models.PROTECT, related_name="attempt"
    )
    dseq = models.BigIntegerField()
    epoch = models.BigIntegerField()
    batch_id = models.UUIDField(null=True, db_index=True)
    """Batch that it went with; None: it went alone."""

    worker_pid = models.PositiveIntegerField(null=True)
    """Process that carried it out, from the STARTED event."""

    at = models.DateTimeField()

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["job", "number"], name="attempt_once"),
            models.UniqueConstraint(fields=["host", "dseq"], name="dseq_once"),
        ]

    def __str__(self) -> str:
        return f"attempt {self.number}"


class Outbox(models.Model):
    """A signed command on its way: written with the fact, published after the commit."""

    id = models.BigAutoField(primary_key=True)
    host = models.ForeignKey("enrollment.EdgeHost", on_delete=models.PROTECT, related_name="+")
    action_id = models.UUIDField(db_index=True)
    kind = models.CharField(max_length=10)
    body = models.JSONField()
    """The command before signing; epoch and signature are put on at publication."""

    at = models.DateTimeField()
    published_at = models.DateTimeField(null=True)
    publish_count = models.PositiveIntegerField(default=0)
    settled_at = models.DateTimeField(null=True)
    """The host has answered; nothing is left to repeat."""

    class Meta:
        verbose_name_plural = "outbox"
        indexes = [models.Index(fields=["settled_at", "host"])]

    def __str__(self) -> str:
        return f"{self.kind} {self.action_id}"


class DeviceHalt(Base):
    """One wish to halt one device, and what came of it; its id is the one that its host sees."""

    device = models.ForeignKey("enrollment.Device", on_delete=models.PROTECT, related_name="halts")
    host = models.ForeignKey("enrollment.EdgeHost", on_delete=models.PROTECT, related_name="+")
    run = models.ForeignKey(Run, null=True, on_delete=models.PROTECT, related_name="halts")
    """Run that is aborted; None: a person stopped the device."""

    code = models.CharField(max_length=30)
    state = models.CharField(max_length=10, choices=enum_choices(HaltState))
    message = models.TextField(blank=True)
    """How the device was found, or why it is not halted yet."""

    asked_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    at = models.DateTimeField()
    taken_at = models.DateTimeField(null=True)
    ended_at = models.DateTimeField(null=True)

    class Meta:
        ordering = ["at"]
        indexes = [models.Index(fields=["ended_at", "host"])]

    def __str__(self) -> str:
        return f"halt of {self.device_id}: {self.state}"


class HostEvent(models.Model):
    """One event of a host, exactly as it came."""

    id = models.BigAutoField(primary_key=True)
    host = models.ForeignKey("enrollment.EdgeHost", on_delete=models.PROTECT, related_name="+")
    journal_id = models.UUIDField()
    seq = models.BigIntegerField()
    hash = models.CharField(max_length=64)
    kind = models.CharField(max_length=20)
    action_id = models.UUIDField(null=True, db_index=True)
    at_s = models.FloatField()
    """What the host's clock showed that people and programs set."""

    mono_s = models.FloatField(null=True)
    """What its clock showed that only runs, since the start of the machine `boot_id`."""

    boot_id = models.CharField(max_length=64, blank=True)
    happened_at = models.DateTimeField(null=True)
    """By the server's clock; null: from before that was measured."""

    uncertainty_s = models.FloatField(null=True)
    """At most so far is `happened_at` wrong."""

    is_bounded = models.BooleanField(default=False)
    """No clock told it: it lies between its cause and its reception."""

    received_at = models.DateTimeField()
    body = models.JSONField()

    class Meta:
        ordering = ["-id"]
        constraints = [
            models.UniqueConstraint(fields=["host", "journal_id", "seq"], name="host_event_once")
        ]

    def __str__(self) -> str:
        return f"{self.seq} {self.kind}"


class Custody(Base):
    """A vessel that is carried from one host's hands into another's."""

    resource = models.ForeignKey("resources.Resource", on_delete=models.PROTECT, related_name="+")
    state = models.CharField(max_length=12, choices=enum_choices(CustodyState))
    owner = models.ForeignKey(
        "enrollment.EdgeHost", null=True, on_delete=models.PROTECT, related_name="+"
    )
    """Host that writes its facts; null while it is in transit."""

    origin = models.ForeignKey(
        "enrollment.EdgeHost", null=True, on_delete=models.PROTECT, related_name="+"
    )
    """Host that it comes from."""

    target = models.ForeignKey(
        "enrollment.EdgeHost", null=True, on_delete=models.PROTECT, related_name="+"
    )
    place = models.ForeignKey(
        "resources.Resource", null=True, on_delete=models.PROTECT, related_name="+"
    )
    """Where it is put at the target."""

    transfer_id = models.UUIDField(null=True, unique=True)
    transaction = models.ForeignKey(
        "crutd.Transaction", null=True, on_delete=models.PROTECT, related_name="+"
    )
    view = models.JSONField(null=True)
    """What the last owner knew of it."""

    parts = models.JSONField(default=list)
    """The same of all that stands in it."""

    job = models.ForeignKey(Job, null=True, on_delete=models.PROTECT, related_name="moves")
    """Job that carries it; null: a person does. For a job it is handed over where it stands."""

    asked_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    at = models.DateTimeField()
    released_at = models.DateTimeField(null=True)
    """When its host said that it has let it go."""

    ended_at = models.DateTimeField(null=True)
    """One move of one vessel is one row; its end stays."""

    class Meta:
        ordering = ["-at"]
        constraints = [
            models.UniqueConstraint(
                fields=["resource"],
                condition=models.Q(ended_at__isnull=True),
                name="one_move_of_a_vessel",
            )
        ]

    def __str__(self) -> str:
        return f"{self.resource_id} {self.state}"
