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
