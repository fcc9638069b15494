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
    """Driver version that the question is about; else it is about a run."""

    plan_digest = models.CharField(max_length=64)
    """Digest of the plan, or of the driver's source."""

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
                condition=models.Q(run_id__isnull=True) ^ models.Q(driver_id__isnull=True),
                name="request_about_one_thing",
            )
        ]

    def __str__(self) -> str:
        return self.title


class Decision(Base):
    """A person's answer. One per request; the first writer wins."""

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

    def __str__(self) -> str:
        return f"{self.printed_name}: {self.meaning}"
