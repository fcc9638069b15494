"""Calibrations of devices."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base, enum_choices
from labweb.domain.calibration.correction import CalibrationQuantity


class Calibration(Base):
    """One calibration of one quantity of a device: never edited, only decided on and withdrawn.

    The newest that was accepted is the one that counts; those before it are superseded.
    """

    class State(models.TextChoices):
        """How far it has come."""

        MEASURING = "measuring"
        """Its run is under way."""

        FAILED = "failed"
        """Its run ended early, or its points give no fit."""

        AWAITING = "awaiting"
        """A person has to look at the result."""

        ACCEPTED = "accepted"
        REJECTED = "rejected"
        WITHDRAWN = "withdrawn"
        """It was accepted, and a person took it back."""

    device = models.ForeignKey(
        "enrollment.Device", on_delete=models.PROTECT, related_name="calibrations"
    )
    quantity = models.CharField(max_length=16, choices=enum_choices(CalibrationQuantity))
    number = models.PositiveIntegerField()
    """Version, from 1, by device and quantity."""

    state = models.CharField(max_length=10, choices=State.choices, default=State.MEASURING)
    run = models.OneToOneField("runs.Run", on_delete=models.PROTECT, related_name="calibration")
    """Run whose readings are its points."""

    order = models.JSONField()
    """What was asked for: levels, repeats, surroundings, tolerance, reference standard."""

    fingerprint = models.JSONField()
    """What the device was: driver, settings, line. Another one is not what was calibrated."""

    points = models.JSONField(default=list)
    result = models.JSONField(null=True)
    findings = models.JSONField(default=list)
    valid_days = models.PositiveIntegerField()
    made_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    made_at = models.DateTimeField()
    measured_at = models.DateTimeField(null=True)
    """When its points were complete: it is due `valid_days` later."""

    decided_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    decided_at = models.DateTimeField(null=True)
    comment = models.TextField(blank=True)
    expires_at = models.DateTimeField(null=True)
    """Due date; null while it was not accepted."""

    withdrawn_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    withdrawn_at = models.DateTimeField(null=True)
    withdrawn_because = models.TextField(blank=True)

    class Meta:
        db_table = "runs_calibration"
        """The table has the name that it was made with, so that a move of the code moves no row."""

        ordering = ["-number"]
        constraints = [
            models.UniqueConstraint(
                fields=["device", "quantity", "number"], name="calibration_number_once"
            ),
            models.UniqueConstraint(
                fields=["device", "quantity"],
                condition=models.Q(state="measuring"),
                name="one_calibration_at_a_time",
            ),
            models.CheckConstraint(
                condition=~models.Q(made_by=models.F("decided_by")), name="calibration_two_people"
            ),
        ]
        indexes = [models.Index(fields=["state"])]

    def __str__(self) -> str:
        return f"{self.quantity} calibration {self.number} of {self.device_id}"
