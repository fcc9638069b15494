"""Samples of device statuses."""

from __future__ import annotations

from django.db import models


class Sample(models.Model):
    """One value of one status. Kept for a day at most; gaps stay gaps."""

    id = models.BigAutoField(primary_key=True)
    device = models.ForeignKey("enrollment.Device", on_delete=models.CASCADE, related_name="+")
    status = models.CharField(max_length=64)
    at = models.FloatField()
    """Seconds since the Unix epoch on the host's clock."""

    value = models.JSONField()

    class Meta:
        indexes = [models.Index(fields=["device", "status", "at"])]

    def __str__(self) -> str:
        return f"{self.status} {self.value}"
