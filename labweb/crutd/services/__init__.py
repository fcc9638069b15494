"""The one write path: lock, settle, resolve, import. Nothing else changes a resource."""

from __future__ import annotations

from labweb.crutd.services.importing import check_time_zone, import_lab
from labweb.crutd.services.labware import import_labware
from labweb.crutd.services.transactions import (
    Settlement,
    advance,
    carry_out,
    discard,
    event_hash,
    lock_operation,
    open_ticket,
    settle,
)

__all__ = [
    "Settlement",
    "advance",
    "carry_out",
    "check_time_zone",
    "discard",
    "event_hash",
    "import_lab",
    "import_labware",
    "lock_operation",
    "open_ticket",
    "settle",
]
