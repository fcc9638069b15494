"""Transactions, events, the double-entry ledger and locks."""

from __future__ import annotations

from django.db import models
from django.db.models import Q

from labweb.common.models import Base, enum_choices
from labweb.domain.crutd.lifecycle import TransactionState
from labweb.domain.crutd.operations import OperationName
from labweb.domain.runs.locks import LockMode


class Transaction(Base):
    """One operation from proposal to its end."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    state = models.CharField(max_length=20, choices=enum_choices(TransactionState))
    name = models.CharField(max_length=10, choices=enum_choices(OperationName))
    operation = models.JSONField()
    actor = models.ForeignKey("accounts.User", null=True, on_delete=models.PROTECT)
    job_id = models.UUIDField(null=True, db_index=True)
    proposed_at = models.DateTimeField()
    settled_at = models.DateTimeField(null=True)
    conditions = models.JSONField(default=list)
    """Results of pre- and post-conditions, with evidence."""

    change = models.JSONField(null=True)
    verification = models.CharField(max_length=10, blank=True)
    code = models.CharField(max_length=100, blank=True)
    message = models.TextField(blank=True)

    def __str__(self) -> str:
        return f"{self.name} {self.state}"


class Event(models.Model):
    """What a transaction did. Appended, never edited; each row binds the one before."""

    id = models.BigAutoField(primary_key=True)
    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="events")
    seq = models.BigIntegerField()
    """Gap-free per lab."""

    at = models.DateTimeField()
    transaction = models.ForeignKey(Transaction, on_delete=models.PROTECT, related_name="events")
    name = models.CharField(max_length=10, choices=enum_choices(OperationName))
    state = models.CharField(max_length=20, choices=enum_choices(TransactionState))
    body = models.JSONField()
    prev_hash = models.CharField(max_length=64)
    hash = models.CharField(max_length=64)

    class Meta:
        ordering = ["-seq"]
        constraints = [models.UniqueConstraint(fields=["lab", "seq"], name="event_seq_once")]

    def __str__(self) -> str:
        return f"{self.seq} {self.name} {self.state}"


class EventSubject(models.Model):
    """Which resources an event concerns."""

    event = models.ForeignKey(Event, on_delete=models.PROTECT, related_name="subjects")
    resource = models.ForeignKey("resources.Resource", on_delete=models.PROTECT, related_name="+")
    role = models.CharField(max_length=10)
    """`source`, `target` or `subject`."""

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["event", "resource", "role"], name="subject_once")
        ]

    def __str__(self) -> str:
        return f"{self.resource_id} in {self.event_id}"


class Entry(models.Model):
    """One double entry: an amount of a lot leaves one account and enters another.

    Rows are never edited: posting or voiding a pending amount is a new row.
    """

    class State(models.TextChoices):
        """Whether the amount counts."""

        PENDING = "pending"
        POSTED = "posted"
        VOID = "void"

    id = models.BigAutoField(primary_key=True)
    transaction = models.ForeignKey(Transaction, on_delete=models.PROTECT, related_name="entries")
    lot = models.ForeignKey("resources.Lot", null=True, on_delete=models.PROTECT, related_name="+")
    """Null on pending rows, whose lots are known only when the draw is settled."""

    debit = models.CharField(max_length=64)
    credit = models.CharField(max_length=64)
    amount_nl = models.BigIntegerField()
    state = models.CharField(max_length=8, choices=State.choices)
    at = models.DateTimeField()

    class Meta:
        verbose_name_plural = "entries"
        constraints = [
            models.CheckConstraint(condition=Q(amount_nl__gt=0), name="entry_positive"),
            models.CheckConstraint(condition=~Q(debit=models.F("credit")), name="entry_two_sides"),
            models.CheckConstraint(
                condition=Q(lot__isnull=False) | ~Q(state="posted"), name="posted_entry_has_lot"
            ),
        ]
        indexes = [models.Index(fields=["debit"]), models.Index(fields=["credit"])]

    def __str__(self) -> str:
        return f"{self.amount_nl} nL {self.debit} → {self.credit}"


class Holding(models.Model):
    """Posted balance of a lot in a vessel: the sum of its entries, kept in step."""

    resource = models.ForeignKey(
        "resources.Resource", on_delete=models.PROTECT, related_name="holdings"
    )
    lot = models.ForeignKey("resources.Lot", on_delete=models.PROTECT, related_name="+")
    amount_nl = models.BigIntegerField()

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["resource", "lot"], name="holding_once"),
            models.CheckConstraint(condition=Q(amount_nl__gte=0), name="holding_not_negative"),
        ]

    def __str__(self) -> str:
        return f"{self.amount_nl} nL"


class ResourceLock(Base):
    """Exclusive use of a resource by a transaction. It never expires by time."""

    resource = models.ForeignKey("resources.Resource", on_delete=models.PROTECT, related_name="+")
    mode = models.CharField(max_length=2, choices=enum_choices(LockMode))
    transaction = models.ForeignKey(Transaction, on_delete=models.PROTECT, related_name="locks")
    taken_at = models.DateTimeField()
    released_at = models.DateTimeField(null=True)

    class Meta:
        constraints = [
            models.UniqueConstraint(
                fields=["resource"],
                condition=Q(mode="X", released_at__isnull=True),
                name="one_exclusive_lock",
            )
        ]
        indexes = [models.Index(fields=["transaction"])]

    def __str__(self) -> str:
        return f"{self.mode} {self.resource_id}"


class Ticket(Base):
    """Edge and server tell different stories; a person has to look."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    code = models.CharField(max_length=100)
    message = models.TextField()
    detail = models.JSONField(default=dict)
    opened_at = models.DateTimeField()
    closed_at = models.DateTimeField(null=True)
    closed_by = models.ForeignKey("accounts.User", null=True, on_delete=models.PROTECT)

    def __str__(self) -> str:
        return self.code
