"""Writes of hosts, devices and drivers: admission, sessions, fences."""

from __future__ import annotations

from labweb.enrollment.services.certificates import renew_certificate
from labweb.enrollment.services.devices import (
    admit_device,
    found_device,
    suspend_device,
)
from labweb.enrollment.services.discovery import (
    Wanted,
    set_candidate_aside,
    take_sightings,
    take_up,
)
from labweb.enrollment.services.drivers import (
    CatalogDriver,
    inspect_text,
    keep_driver,
    parts_of,
    propose_driver,
    read_catalog,
    read_driver,
    settle_proposal,
    withdraw_driver,
)
from labweb.enrollment.services.fencing import revoke_host, sign_fence, withdraw_fences
from labweb.enrollment.services.hosts import (
    acknowledge_stop,
    add_host,
    beat,
    close_session,
    devices_of,
    is_session_open,
    open_session,
    quarantine_host,
    readmit_host,
    record_of,
    resume_host,
    watch_hosts,
    welcome_of,
)
from labweb.enrollment.services.joining import (
    admit_request,
    answer_to,
    join_command,
    make_token,
    reject_request,
    require_admission,
    take_request,
    withdraw_token,
)
from labweb.enrollment.services.link import host_group, join_group, tell_host
from labweb.enrollment.services.replacing import (
    note_ready,
    note_refused,
    switch_driver,
    want_driver,
)

__all__ = [
    "CatalogDriver",
    "Wanted",
    "acknowledge_stop",
    "add_host",
    "admit_device",
    "admit_request",
    "answer_to",
    "beat",
    "close_session",
    "devices_of",
    "found_device",
    "host_group",
    "inspect_text",
    "is_session_open",
    "join_command",
    "join_group",
    "keep_driver",
    "make_token",
    "note_ready",
    "note_refused",
    "open_session",
    "parts_of",
    "propose_driver",
    "quarantine_host",
    "read_catalog",
    "read_driver",
    "readmit_host",
    "record_of",
    "reject_request",
    "renew_certificate",
    "require_admission",
    "resume_host",
    "revoke_host",
    "set_candidate_aside",
    "settle_proposal",
    "sign_fence",
    "suspend_device",
    "switch_driver",
    "take_request",
    "take_sightings",
    "take_up",
    "tell_host",
    "want_driver",
    "watch_hosts",
    "welcome_of",
    "withdraw_driver",
    "withdraw_fences",
    "withdraw_token",
]
