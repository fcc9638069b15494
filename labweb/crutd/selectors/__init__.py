"""Reads of the ledger, transactions and events."""

from __future__ import annotations

from labweb.crutd.models import Event, Holding, Ticket, Transaction
from labweb.crutd.selectors.abandoned_resources import GivenUp, given_up
from labweb.crutd.selectors.amounts import (
    amounts,
    asking_amounts,
    balance_by_lot,
    contents,
    standing,
    visible_lots,
)
from labweb.crutd.selectors.events import events_of, subjects_of
from labweb.crutd.selectors.locks import held_locks
from labweb.crutd.selectors.resource_states import (
    HELD,
    capacity_nl_of,
    lab_snapshot,
    snapshot,
    snapshot_and_lots,
    snapshot_in_place,
    state_of,
    states_and_lots,
)
from labweb.crutd.selectors.tickets import (
    concerns,
    find_ticket,
    open_tickets,
    ticket_for_update,
    visible_tickets,
)
from labweb.crutd.selectors.transactions import (
    find_transaction,
    posted_by,
    reactions_of,
    transaction_for_update,
)

__all__ = [
    "HELD",
    "Event",
    "GivenUp",
    "Holding",
    "Ticket",
    "Transaction",
    "amounts",
    "asking_amounts",
    "balance_by_lot",
    "capacity_nl_of",
    "concerns",
    "contents",
    "events_of",
    "find_ticket",
    "find_transaction",
    "given_up",
    "held_locks",
    "lab_snapshot",
    "open_tickets",
    "posted_by",
    "reactions_of",
    "snapshot",
    "snapshot_and_lots",
    "snapshot_in_place",
    "standing",
    "state_of",
    "states_and_lots",
    "subjects_of",
    "ticket_for_update",
    "transaction_for_update",
    "visible_lots",
    "visible_tickets",
]
