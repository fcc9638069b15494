"""Writes of hosts, devices and drivers: admission, sessions, fences."""

from __future__ import annotations

from labweb.enrollment.services.devices import (
    admit_device,
    found_device,
    keep_driver,
    read_catalog,
    suspend_device,
)
from labweb.enrollment.services.fencing import revoke_host, sign_fence, withdraw_fences
from labweb.enrollment.services.hosts import (
    acknowledge_stop,
    add_host,
    beat,
    close_session,
    open_session,
    quarantine_host,
    readmit_host,
    record_of,
    resume_host,
    watch_hosts,
    welcome_of,
)
from labweb.enrollment.services.link import host_group, tell_host

__all__ = [
    "acknowledge_stop",
    "add_host",
    "admit_device",
    "beat",
    "close_session",
    "found_device",
    "host_group",
    "keep_driver",
    "open_session",
    "quarantine_host",
    "read_catalog",
    "readmit_host",
    "record_of",
    "resume_host",
    "revoke_host",
    "sign_fence",
    "suspend_device",
    "tell_host",
    "watch_hosts",
    "welcome_of",
    "withdraw_fences",
]
