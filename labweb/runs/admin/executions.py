"""Admin pages of runs and what hosts reported: to read."""

from __future__ import annotations

from django.contrib import admin

from labweb.common.admin import ReadOnly
from labweb.runs.models import Attempt, HostEvent, Job, Outbox, Run


@admin.register(Run)
class RunsAdmin(ReadOnly):
    """Executions."""

    list_display = ("number", "version", "state", "created_by", "created_at", "ended_at")
    list_filter = ("state",)
    list_select_related = ("version__workflow", "created_by")
    search_fields = ("number", "id", "version__workflow__name")


@admin.register(Job)
class Jobs(ReadOnly):
    """Dispatched actions."""

    list_display = ("sentence", "run", "index", "device", "state", "state_at", "code")
    list_filter = ("state", "device")
    list_select_related = ("run", "device")
    search_fields = ("id", "sentence", "code")


@admin.register(Attempt)
class Attempts(ReadOnly):
    """Physical tries."""

    list_display = ("id", "job", "number", "host", "dseq", "epoch", "at", "worker_pid")
    list_select_related = ("job", "host")
    search_fields = ("id", "job__id")


@admin.register(Outbox)
class Commands(ReadOnly):
    """Commands on their way."""

    list_display = ("id", "kind", "host", "action_id", "at", "publish_count", "settled_at")
    list_filter = ("kind", "host", ("settled_at", admin.EmptyFieldListFilter))
    list_select_related = ("host",)
    search_fields = ("action_id",)


@admin.register(HostEvent)
class HostEvents(ReadOnly):
    """Journals, as they came."""

    list_display = ("seq", "host", "kind", "action_id", "received_at")
    list_filter = ("kind", "host")
    list_select_related = ("host",)
    search_fields = ("action_id",)
