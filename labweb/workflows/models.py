"""Workflows and their versions."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base


class Workflow(Base):
    """A graph that a person draws; its draft is saved as they go."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="workflows")
    name = models.CharField(max_length=200)
    description = models.TextField(blank=True)
    is_template = models.BooleanField(default=False)
    draft = models.JSONField()
    draft_revision = models.PositiveIntegerField(default=1)
    created_by = models.ForeignKey("accounts.User", null=True, on_delete=models.PROTECT)
    created_at = models.DateTimeField()
    updated_at = models.DateTimeField()

    class Meta:
        ordering = ["-updated_at"]

    def __str__(self) -> str:
        return self.name


class WorkflowVersion(Base):
    """A saved version. Never edited: a database trigger refuses it."""

    workflow = models.ForeignKey(Workflow, on_delete=models.PROTECT, related_name="versions")
    number = models.PositiveIntegerField()
    document = models.JSONField()
    digest = models.CharField(max_length=64)
    note = models.CharField(max_length=300, blank=True)
    proved = models.JSONField(null=True)
    """Of a recipe: what its proof takes for granted, checked at each start. Null: drawn."""

    author = models.ForeignKey("accounts.User", null=True, on_delete=models.PROTECT)
    at = models.DateTimeField()

    class Meta:
        ordering = ["-number"]
        constraints = [models.UniqueConstraint(fields=["workflow", "number"], name="version_once")]

    def __str__(self) -> str:
        return f"{self.workflow.name} v{self.number}"
