"""The one write path: lock, settle, resolve, import. Nothing else changes a resource."""

from __future__ import annotations

from labweb.crutd.services.delivery_import import receive_deliveries
from labweb.crutd.services.device_adoption import adopt_candidate
from labweb.crutd.services.device_refit import check_parts, refit_device
from labweb.crutd.services.device_removal import check_leaving, hold_leaving, take_out
from labweb.crutd.services.events import close_ticket, event_hash, open_ticket
from labweb.crutd.services.halt_effects import note_halt
from labweb.crutd.services.host_batches import Member, lock_batch
from labweb.crutd.services.lab_import import check_time_zone, import_lab
from labweb.crutd.services.labware_import import import_labware
from labweb.crutd.services.ledger_rebuild import rebuild, restore
from labweb.crutd.services.lock_succession import lock_next
from labweb.crutd.services.locks import is_free, refuse_reserved_by_others
from labweb.crutd.services.reservations import end_reservation, reserve
from labweb.crutd.services.run_holds import Asker, Keeper, release_holds, taking
from labweb.crutd.services.transaction_opening import hold_to_open, lock_operation
from labweb.crutd.services.transactions import (
    Settlement,
    advance,
    carry_out,
    check_operation,
    discard,
    settle,
)

__all__ = [
    "Asker",
    "Keeper",
    "Member",
    "Settlement",
    "adopt_candidate",
    "advance",
    "carry_out",
    "check_leaving",
    "check_operation",
    "check_parts",
    "check_time_zone",
    "close_ticket",
    "discard",
    "end_reservation",
    "event_hash",
    "hold_leaving",
    "hold_to_open",
    "import_lab",
    "import_labware",
    "is_free",
    "lock_batch",
    "lock_next",
    "lock_operation",
    "note_halt",
    "open_ticket",
    "rebuild",
    "receive_deliveries",
    "refit_device",
    "refuse_reserved_by_others",
    "release_holds",
    "reserve",
    "restore",
    "settle",
    "take_out",
    "taking",
]
