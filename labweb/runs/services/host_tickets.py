"""Tickets about what a host says and nobody here knows of, of which a broken host says much."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.enrollment.selectors import EdgeHost

logger = logging.getLogger(__name__)

MOST_ALIKE = 20
"""How many open tickets of one sort one host may have; its events stay on record without them."""


def doubt(host: EdgeHost, code: str, text: str, detail: Mapping[str, Any], same: str) -> None:
    """Ask a person to look at what a host says: once for each thing, and of so many things.

    Args:
        host: Which.
        code: Sort of the ticket.
        text: What is wrong.
        detail: What it is about, beside the host.
        same: Key in the detail that names the thing.
    """
    known = crutd_selectors.open_tickets(host.lab).filter(code=code, detail__host_id=str(host.id))
    if known.filter(**{f"detail__{same}": detail[same]}).exists():
        return
    if known.count() >= MOST_ALIKE:
        logger.error("%s; %d tickets of %s say such things", text, MOST_ALIKE, host.name)
        return
    crutd_services.open_ticket(host.lab, code, text, {"host_id": str(host.id), **detail})
