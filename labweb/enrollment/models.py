"""Edge hosts, driver versions and devices."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base, enum_choices
from labweb.domain.runs.session import SessionState


class EdgeHost(Base):
    """A machine that owns devices and keeps a journal."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="hosts")
    key = models.CharField(max_length=100)
    name = models.CharField(max_length=200)
    public_key = models.CharField(max_length=64, blank=True)
    """Ed25519, base64; empty until the host has been admitted."""

    state = models.CharField(
        max_length=16, choices=enum_choices(SessionState), default=SessionState.ENROLLING.value
    )
    state_at = models.DateTimeField(null=True)
    journal_id = models.UUIDField(null=True)
    acked_seq = models.BigIntegerField(default=0)
    hash_at_acked = models.CharField(max_length=64, blank=True)
    epoch = models.BigIntegerField(default=0)
    floor = models.BigIntegerField(default=0)
    last_dseq = models.BigIntegerField(default=0)
    epoch_seen = models.BigIntegerField(default=0)
    """Latest session in which the host has spoken: it is on its disk."""

    boots = models.JSONField(default=list)
    """Starts of the machine that have had a session, the latest last."""

    instance_id = models.CharField(max_length=64, blank=True)
    """Process that speaks in the present session."""

    clock_skew_s = models.FloatField(null=True)
    """Host's wall clock less the server's at its last heartbeat; shown, never decided by."""

    away_since_at = models.DateTimeField(null=True)
    """When it was heard last before it was isolated: it works alone since."""

    last_seen_at = models.DateTimeField(null=True)
    session_id = models.UUIDField(null=True)
    """Live connection; a second one is refused."""

    stop_acknowledged = models.UUIDField(null=True)
    """Last software stop this host confirmed."""

    stop_acknowledged_at = models.DateTimeField(null=True)
    heartbeat = models.JSONField(default=dict)

    class Meta:
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="host_key_once")]

    def __str__(self) -> str:
        return self.name


class Fence(Base):
    """Two people declare a host lost: what it was given is in doubt, and people answer for it."""

    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="fences")
    reason = models.TextField()
    first_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    first_at = models.DateTimeField()
    second_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    second_at = models.DateTimeField(null=True)
    withdrawn_at = models.DateTimeField(null=True)
    """The host was heard of before anybody signed second."""

    class Meta:
        constraints = [
            models.UniqueConstraint(
                fields=["host"],
                condition=models.Q(second_at__isnull=True, withdrawn_at__isnull=True),
                name="one_open_fence",
            ),
            models.CheckConstraint(
                condition=~models.Q(first_by=models.F("second_by")), name="fence_two_people"
            ),
        ]

    def __str__(self) -> str:
        return f"fence of {self.host_id}"


class DriverVersion(Base):
    """Driver source that was read and approved, by digest."""

    digest = models.CharField(max_length=64, unique=True)
    module = models.CharField(max_length=200)
    class_name = models.CharField(max_length=100)
    role = models.CharField(max_length=64)
    spec = models.JSONField()
    read_at = models.DateTimeField(auto_now_add=True)

    def __str__(self) -> str:
        return f"{self.class_name} {self.digest[:8]}"


class Device(Base):
    """One instrument with one serial number."""

    class State(models.TextChoices):
        """Where its enrollment stands."""

        CANDIDATE = "candidate"
        ENROLLED = "enrolled"
        SUSPENDED = "suspended"
        RETIRED = "retired"

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="devices")
    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="devices")
    key = models.CharField(max_length=200)
    name = models.CharField(max_length=200)
    driver = models.ForeignKey(DriverVersion, on_delete=models.PROTECT, related_name="devices")
    transport = models.CharField(max_length=300)
    config = models.JSONField(default=dict)
    nodes = models.JSONField(default=dict)
    """Role in the driver → resource id."""

    state = models.CharField(max_length=16, choices=State.choices, default=State.CANDIDATE)
    admitted_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    admitted_at = models.DateTimeField(null=True)
    discovered_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["key"]
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="device_key_once")]

    def __str__(self) -> str:
        return self.name
