"""What a stranger's announcement may change: next to nothing, and never by itself.

Anybody on the network can say any serial number, with a key that he has just made, and write any
sender on a datagram. So a key counts as changed only when the device itself is gone and the
other is in its place: see `heard_alone_since`.
"""

from __future__ import annotations

import re
from datetime import datetime
from ipaddress import ip_address

KEY_CHANGED_AFTER_S = 45.0
"""For so long the other key alone has to be heard from where the device is."""

_HOST = re.compile(r"[a-z][a-z0-9+.]*://(?:\[([0-9A-Fa-f:.]+)\]|([^/?#:@\[\]]+))")

LONGEST_GAP_S = 60.0
"""A pause in which what was heard before counts no more."""


def host_of(address: str) -> str:
    """Return the host that an address names, plainly written; "" where it names none.

    Example:
        >>> host_of("modbus+tcp://[FD00::9]:502?device=1"), host_of("serial:///dev/ttyUSB0")
        ('fd00::9', '')
    """
    found = _HOST.match(address)
    name = "" if found is None else (found[1] or found[2]).lower()
    return str(ip_address(name)) if is_number(name) else name


def is_number(host: str) -> bool:
    """Tell whether a host is named by an IP address."""
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def is_its_place(address: str, *, transport: str, announced_at: str) -> bool:
    """Tell whether something speaks from where an admitted device is.

    Args:
        address: From where it speaks.
        transport: Carrier of the device, as a person wrote it.
        announced_at: From where the device announced itself. It counts where the carrier names
            no number: a name, a serial port.
    """
    bound = host_of(transport)
    place = bound if is_number(bound) else host_of(announced_at)
    return bool(place) and host_of(address) == place


def heard_alone_since(
    *, now: datetime, since: datetime | None, heard_at: datetime, known_at: datetime
) -> datetime:
    """Return since when only the other key has been heard, now that it is heard again.

    One datagram, or as many as one likes beside a device that still announces itself, begin
    anew each time. What is left to a stranger is to be heard for as long as the device is silent.

    Args:
        now: When it is heard this time.
        since: What this rule said the last time; None: it was not asked yet.
        heard_at: When the other key was heard before.
        known_at: When the admitted key was heard last.
    """
    is_pause = (now - heard_at).total_seconds() > LONGEST_GAP_S
    return now if since is None or known_at >= since or is_pause else since


def is_key_changed(since: datetime, now: datetime) -> bool:
    """Tell whether the other key has been heard alone for long enough."""
    return (now - since).total_seconds() >= KEY_CHANGED_AFTER_S


def is_same_everywhere(*, public_key: str, model: str, serial: str, address: str) -> bool:
    """Tell whether what two hosts see in the same way is the same thing.

    A key is. Model and serial number together are, as far as makers keep their word. A private
    address is not, nor is a serial port: each host has its own.
    """
    if public_key or serial:
        return bool(public_key or model)
    host = host_of(address)
    return is_number(host) and ip_address(host).is_global
