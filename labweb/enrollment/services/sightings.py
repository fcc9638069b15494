"""Writes about what hosts see: it is kept for a person, and changes next to nothing by itself."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from datetime import datetime, timedelta
from functools import partial
from typing import Any
from uuid import UUID

from django.db.models import F, QuerySet
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.enrollment.announcement_trust import (
    heard_alone_since,
    host_of,
    is_its_place,
    is_key_changed,
)
from labweb.domain.enrollment.device_announcements import (
    MAKES_ROOM_AFTER_S,
    MOST_OF_ONE_PLACE,
    MOST_OPEN,
    is_sane,
    mark_of,
)
from labweb.domain.messages.certificates_and_sightings import MOST_SIGHTINGS_PER_FRAME, Sighting
from labweb.enrollment import selectors
from labweb.enrollment.models import Candidate, Device, EdgeHost
from labweb.enrollment.services.host_messages import tell_host

logger = logging.getLogger(__name__)

OPEN = (Candidate.State.NEW, Candidate.State.QUARANTINED)


@atomic
def take_sightings(host_id: UUID, epoch: int, found: Sequence[Sighting]) -> int:
    """Keep what a host sees; nothing is added to the lab before a person has said so.

    Returns:
        How many are new in the inbox.

    Effect:
        None on matter. A device that was admitted with a key is suspended once another key
        alone has been heard from where it is, for as long as `claims` says: what it does runs
        to its end, nothing new is planned. A stranger who says its serial number beside it
        stands in the inbox, and changes nothing.
    """
    host = EdgeHost.objects.filter(pk=host_id, epoch=epoch).select_related("lab").first()
    if host is None:
        return 0
    sane = [one for one in found[:MOST_SIGHTINGS_PER_FRAME] if is_sane(one)]
    _hold(host, sane)
    taken = [_take(host, one) for one in sane]
    left_out = taken.count(None)
    if left_out:
        logger.warning("the inbox of %s is full: %d were left out", host.name, left_out)
    return taken.count(True)


def _hold(host: EdgeHost, found: Sequence[Sighting]) -> None:
    """Lock what is known of them, in the order of all who answer: nobody waits in a ring."""
    rows = Candidate.objects.filter(host=host, mark__in={mark_of(one) for one in found})
    locked = rows.order_by("pk").select_for_update(of=("self",), no_key=True)
    list(locked.values_list("pk"))


def _take(host: EdgeHost, one: Sighting) -> bool | None:
    """Keep one; return whether it is new, and None where it finds no room."""
    rows = Candidate.objects.filter(host=host, mark=mark_of(one))
    row = rows.select_related("key_changed_from__device").first()
    if row is not None:
        _see_again(host, row, one)
        return False
    if not _makes_room(host, one):
        return None
    _keep(host, one)
    return True


def _keep(host: EdgeHost, one: Sighting) -> None:
    row = Candidate(
        lab=host.lab,
        host=host,
        mark=mark_of(one),
        source=one.source,
        address=one.address,
        name=one.name,
        model=one.model,
        serial=one.serial,
        public_key=one.public_key,
        driver_hint=one.driver,
        first_seen_at=now(),
        last_seen_at=now(),
    )
    said = selectors.rejection_of(host.lab_id, selectors.shared_mark(row))
    if said is not None:
        row.state, row.reason = said.state, said.reason
        row.decided_by, row.decided_at = said.decided_by, said.decided_at
    else:
        row.key_changed_from = _with_another_key(host, one)
        row.alone_since_at = _alone_since(row, host, row.last_seen_at)
    row.save(force_insert=True)
    detail = {"address": one.address, "name": one.name, "serial": one.serial}
    if row.key_changed_from is not None:
        detail["says_it_is"] = str(row.key_changed_from.device_id)
    account_services.write_audit("device.seen", str(row.id), actor=None, detail=detail)
    on_commit(partial(feed.publish, "devices", {"candidate_id": str(row.id)}))


def _see_again(host: EdgeHost, row: Candidate, one: Sighting) -> None:
    heard_at, row.last_seen_at = row.last_seen_at, now()
    row.name, row.model, row.serial = one.name, one.model, one.serial
    is_elsewhere = one.source == "beacon" and one.address != row.address
    if is_elsewhere:
        # Anybody may repeat what a device has signed, from his own address.
        row.also_at = one.address
    else:
        row.address = one.address
    if row.key_changed_from is None and row.state in OPEN:
        row.key_changed_from = _with_another_key(host, one)
    if not is_elsewhere:
        row.alone_since_at = _alone_since(row, host, heard_at)
    Candidate.objects.filter(pk=row.pk).update(
        address=row.address,
        also_at=row.also_at,
        name=row.name,
        model=row.model,
        serial=row.serial,
        last_seen_at=row.last_seen_at,
        seen_count=F("seen_count") + 1,
        key_changed_from=row.key_changed_from,
        alone_since_at=row.alone_since_at,
    )
    since, known = row.alone_since_at, row.key_changed_from
    if since is not None and known is not None and is_key_changed(since, row.last_seen_at):
        _suspend(known.device, row)


def _with_another_key(host: EdgeHost, one: Sighting) -> Candidate | None:
    """Return the admitted candidate that this one says it is, and whose key it has not."""
    if not one.serial:
        return None
    rows = Candidate.objects.filter(
        lab=host.lab, model=one.model, serial=one.serial, device__isnull=False
    )
    rows = rows.exclude(device__state=Device.State.RETIRED)
    others = rows.exclude(public_key="").exclude(public_key=one.public_key)
    return others.select_related("device").first()


def _alone_since(row: Candidate, host: EdgeHost, heard_at: datetime) -> datetime | None:
    """Return since when it alone is heard where the device is that it says it is; None: not."""
    known = row.key_changed_from
    device = None if known is None else known.device
    if known is None or device is None or row.state not in OPEN or device.host_id != host.id:
        return None
    if not is_its_place(row.address, transport=device.transport, announced_at=known.address):
        return None
    return heard_alone_since(
        now=row.last_seen_at,
        since=row.alone_since_at,
        heard_at=heard_at,
        known_at=selectors.known_heard_at(known, host),
    )


def _suspend(device: Device | None, row: Candidate) -> None:
    if device is None:
        return
    reason = f"at {row.address}, where it is, another key alone is heard, which says that it is it"
    changed = Device.objects.filter(pk=device.pk, state=Device.State.ENROLLED).update(
        state=Device.State.SUSPENDED, suspended_for=reason
    )
    if changed:
        detail = {"candidate_id": str(row.id)}
        account_services.write_audit(
            "device.key_changed", str(device.id), actor=None, reason=reason, detail=detail
        )
        on_commit(partial(tell_host, device.host_id, {"type": "edge.renew"}))
        on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))


# --- room in the inbox ---


def _makes_room(host: EdgeHost, one: Sighting) -> bool:
    """Say whether one more may stand in the inbox, and take out what makes room for it."""
    rows = Candidate.objects.filter(host=host, source=one.source, state__in=OPEN)
    crowd = _crowd(rows, one)
    if crowd is None:
        return True
    since = now() - timedelta(seconds=MAKES_ROOM_AFTER_S)
    gone = crowd.filter(
        state=Candidate.State.NEW, decided_at__isnull=True, last_seen_at__lt=since
    ).order_by("last_seen_at")
    oldest = gone.first()
    if oldest is None:
        return False
    oldest.delete()
    return True


def _crowd(rows: QuerySet[Candidate, Any], one: Sighting) -> QuerySet[Candidate, Any] | None:
    """Return those among which there is no room for one more; None: there is."""
    place = host_of(one.address)
    if one.source == "beacon" and place:
        written = f"://[{place}]:" if ":" in place else f"://{place}:"
        of_place = rows.filter(address__contains=written)
        if of_place.count() >= MOST_OF_ONE_PLACE:
            return of_place
    return rows if rows.count() >= MOST_OPEN else None
