"""How the record came to know each field of a resource's `data`: set by an act, or read back."""

from __future__ import annotations

from typing import Any

from labweb.common.render import iso
from labweb.crutd.models import Event
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.resources.selectors import Resource

_ROLLED_BACK = TransactionState.ROLLED_BACK.value

_MOST_BACK = 200
"""Events of a resource that are looked through; what is older is told without its origin."""


def told_of(row: Resource) -> dict[str, dict[str, Any]]:
    """Return by field how it is known and since when; one query, none where nothing is known.

    `set`: an act was to bring it about, and succeeded. `measured`: it was reported with an act.
    `unknown`: it was known until then. `job_id` is null for what people did or a halt took away.
    """
    found: dict[str, dict[str, Any]] = {}
    if not row.data:
        return found
    key = str(row.pk)
    events = Event.objects.filter(subjects__resource=row, body__change__data__has_key=key)
    for event in events.order_by("-seq")[:_MOST_BACK]:
        asked = event.body["operation"].get("data") or {}
        for name, value in event.body["change"]["data"][key].items():
            is_lost = value is None and (event.body.get("code") or event.state == _ROLLED_BACK)
            how = "unknown" if is_lost else "set" if name in asked else "measured"
            job_id = event.body.get("job_id")
            found.setdefault(name, {"how": how, "at": iso(event.at), "job_id": job_id})
    return {name: one for name, one in found.items() if name in row.data}
