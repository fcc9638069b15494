"""Admin pages of transactions, events, the ledger, locks and tickets: to read."""

from __future__ import annotations

from django.contrib import admin

from labweb.common.admin import ReadOnly
from labweb.crutd.models import (
    Balance,
    Entry,
    Event,
    Holding,
    ResourceLock,
    Ticket,
    Transaction,
)


@admin.register(Transaction)
class Transactions(ReadOnly):
    """Operations from proposal to end."""

    list_display = ("id", "name", "state", "verification", "actor", "proposed_at", "settled_at")
    list_filter = ("state", "name", "verification")
    list_select_related = ("actor",)
    search_fields = ("id", "job_id")


@admin.register(Event)
class Events(ReadOnly):
    """What transactions did, in one chain."""

    list_display = ("seq", "at", "name", "state", "transaction", "hash")
    list_filter = ("name", "state")
    list_select_related = ("transaction",)
    search_fields = ("transaction__id", "hash")


@admin.register(Entry)
class Entries(ReadOnly):
    """Double entries of the ledger."""

    list_display = ("id", "at", "state", "lot", "debit", "credit", "amount_nl", "amount_ug")
    list_filter = ("state",)
    list_select_related = ("lot__material",)
    search_fields = ("debit", "credit", "transaction__id")


@admin.register(Holding)
class Holdings(ReadOnly):
    """Posted balances."""

    list_display = ("resource", "lot", "amount_nl", "amount_ug")
    list_select_related = ("resource", "lot__material")
    search_fields = ("resource__name", "lot__key")


@admin.register(Balance)
class Balances(ReadOnly):
    """What vessels hold and have promised."""

    list_display = ("resource", "posted_nl", "pending_out_nl", "pending_in_nl", "posted_ug")
    list_select_related = ("resource",)
    search_fields = ("resource__name",)


@admin.register(ResourceLock)
class ResourceLocks(ReadOnly):
    """Exclusive use, live and past."""

    list_display = ("resource", "mode", "transaction", "taken_at", "released_at")
    list_filter = ("mode", ("released_at", admin.EmptyFieldListFilter))
    list_select_related = ("resource", "transaction")
    search_fields = ("resource__name", "transaction__id")


@admin.register(Ticket)
class Tickets(ReadOnly):
    """Contradictions that a person has to look at."""

    list_display = ("opened_at", "code", "message", "closed_at", "closed_by")
    list_filter = ("code", ("closed_at", admin.EmptyFieldListFilter))
    list_select_related = ("closed_by",)
