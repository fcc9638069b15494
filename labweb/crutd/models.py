"""Transactions, events, the double-entry ledger and locks."""

from __future__ import annotations

from django.db import models
from django.db.models import F, Q

from labweb.common.models import Base, enum_choices
from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.operations import OperationName
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.runs.exclusive_use.action_locks import LockMode
from labweb.domain.runs.exclusive_use.run_holds import UseMode

_ACCOUNT = rf"^({'|'.join(Account)}|[0-9a-f]{{8}}(-[0-9a-f]{{4}}){{3}}-[0-9a-f]{{12}})$"
"""A nominal account, or the id of a vessel."""

_ONE_UNIT = Q(amount_nl__gt=0, amount_ug=0) | Q(amount_nl=0, amount_ug__gt=0)


class Transaction(Base):
    """One operation from proposal to its end."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    state = models.CharField(max_length=20, choices=enum_choices(TransactionState))
    name = models.CharField(max_length=10, choices=enum_choices(OperationName))
    operation = models.JSONField()
    actor = models.ForeignKey("accounts.User", null=True, on_delete=models.PROTECT)
    job_id = models.UUIDField(null=True, db_index=True)
    batch_id = models.UUIDField(null=True, db_index=True)
    """Transactions that a host works off by itself: their locks go from one to the next."""

    claims = models.JSONField(default=list)
    """Resources that a member of a batch needs, those above included."""

    proposed_at = models.DateTimeField()
    settled_at = models.DateTimeField(null=True)
    conditions = models.JSONField(default=list)
    """Results of pre- and post-conditions, with evidence."""

    change = models.JSONField(null=True)
    verification = models.CharField(max_length=12, blank=True)
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
    """When it happened, by the server's clock."""

    received_at = models.DateTimeField(null=True)
    """When the server heard of it from a host; null: it is the server's own act."""

    uncertainty_s = models.FloatField(null=True)
    """At most so far is `at` wrong; null: the server timed it itself."""

    is_bounded = models.BooleanField(default=False)
    """No clock told it: it lies between its cause and its reception."""

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


class EventHead(models.Model):
    """Where the chain of a lab ends, so that the loss of its last rows is seen.

    The database moves it with each event, and refuses an event that does not follow it.
    """

    lab = models.OneToOneField(
        "resources.Lab", primary_key=True, on_delete=models.PROTECT, related_name="event_head"
    )
    seq = models.BigIntegerField(default=0)
    hash = models.CharField(max_length=64, blank=True)

    def __str__(self) -> str:
        return f"{self.lab_id} at {self.seq}"


class LabBase(models.Model):
    """A lab as it was imported: what its events are replayed on. Never edited."""

    lab = models.OneToOneField(
        "resources.Lab", primary_key=True, on_delete=models.PROTECT, related_name="base"
    )
    document = models.BinaryField()
    """The lab file, as labweb writes it, compressed with zlib."""

    sha256 = models.CharField(max_length=64)
    """Of the file before compression; the first event of the lab carries the same."""

    def __str__(self) -> str:
        return self.sha256


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

    Rows are never edited. A pending row reserves an amount on both sides before anything
    moves; the end of its transaction is a void row, which releases the reservation, beside
    the posted rows of what did move. The database keeps `Holding` and `Balance` in step.
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
    amount_nl = models.BigIntegerField(default=0)
    amount_ug = models.BigIntegerField(default=0)
    """Solids and gases are counted by mass; one of the two amounts is zero."""

    state = models.CharField(max_length=8, choices=State.choices)
    at = models.DateTimeField()

    class Meta:
        verbose_name_plural = "entries"
        constraints = [
            models.CheckConstraint(condition=_ONE_UNIT, name="entry_one_unit"),
            models.CheckConstraint(
                condition=Q(debit__regex=_ACCOUNT, credit__regex=_ACCOUNT), name="entry_accounts"
            ),
            models.CheckConstraint(condition=~Q(debit=F("credit")), name="entry_two_sides"),
            models.CheckConstraint(
                condition=Q(lot__isnull=False) | ~Q(state="posted"), name="posted_entry_has_lot"
            ),
        ]
        indexes = [models.Index(fields=["debit"]), models.Index(fields=["credit"])]

    def __str__(self) -> str:
        amount = f"{self.amount_ug} µg" if self.amount_ug else f"{self.amount_nl} nL"
        return f"{amount} {self.debit} → {self.credit}"


class Holding(models.Model):
    """Posted balance of a lot in a vessel. The database alone writes it, from the entries."""

    resource = models.ForeignKey(
        "resources.Resource", on_delete=models.PROTECT, related_name="holdings"
    )
    lot = models.ForeignKey("resources.Lot", on_delete=models.PROTECT, related_name="+")
    amount_nl = models.BigIntegerField(default=0)
    amount_ug = models.BigIntegerField(default=0)

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["resource", "lot"], name="holding_once"),
            models.CheckConstraint(
                condition=Q(amount_nl__gte=0, amount_ug__gte=0), name="holding_not_negative"
            ),
        ]

    def __str__(self) -> str:
        return f"{self.amount_ug} µg" if self.amount_ug else f"{self.amount_nl} nL"


class Balance(models.Model):
    """What a vessel holds and what is promised of it, all lots together.

    The database alone writes it, from the entries: what is promised is never more than
    what is there, and what is there with what is to come never more than the capacity.
    """

    resource = models.OneToOneField(
        "resources.Resource", primary_key=True, on_delete=models.PROTECT, related_name="balance"
    )
    posted_nl = models.BigIntegerField(default=0)
    posted_ug = models.BigIntegerField(default=0)
    pending_out_nl = models.BigIntegerField(default=0)
    pending_out_ug = models.BigIntegerField(default=0)
    pending_in_nl = models.BigIntegerField(default=0)
    pending_in_ug = models.BigIntegerField(default=0)

    class Meta:
        constraints = [
            models.CheckConstraint(
                condition=Q(
                    pending_out_nl__gte=0,
                    pending_out_ug__gte=0,
                    posted_nl__gte=F("pending_out_nl"),
                    posted_ug__gte=F("pending_out_ug"),
                ),
                name="balance_never_overdrawn",
            ),
            models.CheckConstraint(
                condition=Q(pending_in_nl__gte=0, pending_in_ug__gte=0),
                name="balance_pending_in",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.posted_nl} nL, {self.posted_ug} µg"


class ResourceLock(Base):
    """Exclusive use of a resource by a transaction. It never expires by time."""

    resource = models.ForeignKey(
        "resources.Resource", on_delete=models.PROTECT, related_name="+", db_index=False
    )
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
        indexes = [
            # Every transaction locks the root: what was released must cost nothing to look past.
            models.Index(
                fields=["resource"], condition=Q(released_at__isnull=True), name="lock_is_held"
            )
        ]

    def __str__(self) -> str:
        return f"{self.mode} {self.resource_id}"


class ResourceReservation(Base):
    """Exclusive use of a resource and all below it in the near future, by a person or an agent.

    It ends by itself, moves nothing, and stops nothing that is under way.
    """

    resource = models.ForeignKey("resources.Resource", on_delete=models.PROTECT, related_name="+")
    holder = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    reason = models.TextField()
    made_at = models.DateTimeField()
    expires_at = models.DateTimeField()
    ended_at = models.DateTimeField(null=True)
    """When somebody ended it before its time."""

    ended_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )

    class Meta:
        constraints = [
            models.CheckConstraint(
                condition=Q(expires_at__gt=F("made_at")), name="reservation_lasts"
            )
        ]
        indexes = [
            models.Index(
                fields=["expires_at"], condition=Q(ended_at__isnull=True), name="reservation_open"
            )
        ]

    def __str__(self) -> str:
        return f"{self.resource_id} until {self.expires_at}"


class RunHold(Base):
    """What a run keeps for itself between its actions. It ends with its need, never by time.

    A lock is for one action that is under way; a hold is for all that a run does with a thing.
    """

    resource = models.ForeignKey("resources.Resource", on_delete=models.PROTECT, related_name="+")
    run_id = models.UUIDField()
    run_number = models.PositiveIntegerField()
    holder = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    """Whose run it is."""

    mode = models.CharField(max_length=1, choices=enum_choices(UseMode))
    until_step = models.PositiveIntegerField()
    """Number of the step of the run after which it lets go, from 1."""

    taken_at = models.DateTimeField()
    released_at = models.DateTimeField(null=True)

    class Meta:
        constraints = [
            models.UniqueConstraint(
                fields=["resource"],
                condition=Q(mode__in=["X", "U"], released_at__isnull=True),
                name="one_run_holds_alone",
            ),
            models.UniqueConstraint(
                fields=["run_id", "resource"],
                condition=Q(released_at__isnull=True),
                name="one_hold_of_a_run",
            ),
        ]

    def __str__(self) -> str:
        return f"run #{self.run_number} {self.mode} {self.resource_id}"


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
