"""Admin pages of workflows: to read. They are drawn in the editor."""

from __future__ import annotations

from django.contrib import admin

from labweb.common.admin import ReadOnly
from labweb.workflows.models import Workflow, WorkflowVersion


@admin.register(Workflow)
class WorkflowsAdmin(ReadOnly):
    """Drafts."""

    list_display = ("name", "is_template", "draft_revision", "created_by", "updated_at")
    list_filter = ("is_template",)
    list_select_related = ("created_by",)
    search_fields = ("name",)


@admin.register(WorkflowVersion)
class WorkflowVersions(ReadOnly):
    """Frozen versions."""

    list_display = ("workflow", "number", "note", "author", "at", "digest")
    list_select_related = ("workflow", "author")
    search_fields = ("workflow__name", "digest")
