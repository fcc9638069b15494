"""Policies, requests and decisions."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base


class Policy(Base):
    """A rule that sends a plan to a person."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="policies")
    name = models.CharField(max_length=200)
    """In words: "Heating to 60 °C or above needs a second person"."""

    rule = models.JSONField()
    """`{"kind": "temperature_at_least", "temperature_c": 60}`."""

    allow_self = models.BooleanField(default=False)
    is_active = models.BooleanField(default=True)

    class Meta:
        verbose_name_plural = "policies"

    def __str__(self) -> str:
        return self.name


class ApprovalRequest(Base):
    """A question to a person, bound to the exact plan by its digest."""

    class State(models.TextChoices):
        """Where the question stands."""

        OPEN = "open"
        APPROVED = "approved"
        REJECTED = "rejected"
        WITHDRAWN = "withdrawn"
        EXPIRED = "expired"

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="approvals")
    title = models.CharField(max_length=300)
    run_id = models.UUIDField(db_index=True, null=True)
    driver_id = models.UUIDField(db_index=True, null=True)
    """Driver version that the question is about."""

    calibration_id = models.UUIDField(db_index=True, null=True)
    """Result of a calibration that the question is about; else it is about a run."""

    plan_digest = models.CharField(max_length=64)
    """Digest of the plan, of the driver's source, or of the calibration's points and result."""

    policies = models.JSONField()
    """Name of each policy that asks."""

    allow_self = models.BooleanField(default=False)
    asked_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    asked_at = models.DateTimeField()
    expires_at = models.DateTimeField()
    state = models.CharField(max_length=10, choices=State.choices, default=State.OPEN)

    class Meta:
        ordering = ["-asked_at"]
        constraints = [
            models.CheckConstraint(
                condition=models.Q(run_id__isnull=False, driver_id=None, calibration_id=None)
                | models.Q(run_id=None, driver_id__isnull=False, calibration_id=None)
                | models.Q(run_id=None, driver_id=None, calibration_id__isnull=False),
                name="request_about_one_thing",
            )
        ]

    def __str__(self) -> str:
        return self.title


class Decision(Base):
    """A person's answer. One per request; the first writer wins.

    Appended, never edited; each row binds the one before.
    """

    seq = models.BigIntegerField(unique=True)
    """Gap-free, from 1."""

    request = models.OneToOneField(
        ApprovalRequest, on_delete=models.PROTECT, related_name="decision"
    )
    actor = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    printed_name = models.CharField(max_length=200)
    is_approved = models.BooleanField()
    meaning = models.CharField(max_length=200)
    comment = models.TextField(blank=True)
    plan_digest = models.CharField(max_length=64)
    at = models.DateTimeField()
    prev_hash = models.CharField(max_length=64, blank=True)
    hash = models.CharField(max_length=64, unique=True)

    def __str__(self) -> str:
        return f"{self.printed_name}: {self.meaning}"


class SimulatorOffer(Base):
    """What a host said in its present session that it can simulate."""

    host = models.OneToOneField(
        "enrollment.EdgeHost", on_delete=models.CASCADE, related_name="simulators"
    )
    epoch = models.BigIntegerField()
    """Session in which it was said; in another one it does not count."""

    models_offered = models.JSONField(default=list)
    problem = models.TextField(blank=True)
    told_at = models.DateTimeField()

    def __str__(self) -> str:
        return f"simulators of {self.host_id}"


class Tryout(Base):
    """One version of a driver on one simulated instrument, while its author drives it."""

    class State(models.TextChoices):
        """How far it has come."""

        STARTING = "starting"
        RUNNING = "running"
        ENDED = "ended"

    version = models.ForeignKey(
        "enrollment.DriverVersion", on_delete=models.PROTECT, related_name="tryouts"
    )
    host = models.ForeignKey("enrollment.EdgeHost", on_delete=models.PROTECT, related_name="+")
    epoch = models.BigIntegerField()
    """Session of the host in which it was ordered."""

    model = models.CharField(max_length=100)
    title = models.CharField(max_length=200)
    """Maker and model, as on the type plate."""

    faults_offered = models.JSONField(default=dict)
    """JSON Schema of the options, by name."""

    settings = models.JSONField(default=dict)
    config = models.JSONField(default=dict)
    """Settings of the driver."""

    speed = models.FloatField(default=1.0)
    state = models.CharField(max_length=10, choices=State.choices, default=State.STARTING)
    code = models.CharField(max_length=100, blank=True)
    """Why it ended, when that was a failure."""

    message = models.TextField(blank=True)
    begun_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    begun_at = models.DateTimeField()
    heard_at = models.DateTimeField()
    """Last word of its host."""

    ended_at = models.DateTimeField(null=True)
    faults = models.JSONField(default=list)
    """In force now."""

    statuses = models.JSONField(default=dict)
    """Last reading: values and problems by status."""

    wire = models.JSONField(default=list)
    """Last records of the tap."""

    wire_left_out_count = models.BigIntegerField(default=0)

    class Meta:
        ordering = ["-begun_at"]

    def __str__(self) -> str:
        return f"tryout on {self.model}"


class TryoutAct(Base):
    """One wish of the author, and what became of it."""

    tryout = models.ForeignKey(Tryout, on_delete=models.CASCADE, related_name="acts")
    number = models.IntegerField()
    sort = models.CharField(max_length=10)
    name = models.CharField(max_length=100, blank=True)
    args = models.JSONField(default=dict)
    asked_at = models.DateTimeField()
    answered_at = models.DateTimeField(null=True)
    code = models.CharField(max_length=100, blank=True)
    """Empty, once answered: it went well."""

    message = models.TextField(blank=True)
    effect = models.CharField(max_length=10, blank=True)
    data = models.JSONField(default=dict)
    has_faults = models.BooleanField(default=False)
    """A fault was in force at some time while it was carried out."""

    class Meta:
        ordering = ["number"]
        constraints = [
            models.UniqueConstraint(fields=["tryout", "number"], name="tryout_number_once")
        ]

    def __str__(self) -> str:
        return f"{self.sort} {self.name}"
