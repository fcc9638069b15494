"""What this host sees: announcements on the network, serial ports, addresses that answer.

A process of its own, so that what a stranger sends is parsed apart from everything that
matters. It opens no device: it lists ports, and tries addresses that no admitted device uses.
"""

from __future__ import annotations

import logging
import socket
import struct
import threading
import time
from collections.abc import Callable

import msgspec

from drivers.transports.scan import is_listening, serial_ports
from drivers.transports.urls import line_key
from labweb.domain.enrollment.sighting import (
    LONGEST_BEACON_BYTES,
    beacon_bytes,
    expand_addresses,
    mark_of,
    parse_beacon,
    sighting_of,
)
from labweb.domain.errors import DefinitionError
from labweb.domain.messages import Sighting
from workers.config import BeaconConfig, DiscoveryConfig, HostConfig
from workers.journal import Journal
from workers.keys import is_signature
from workers.store import Store

log = logging.getLogger(__name__)

PACKETS_PER_S = 20.0
"""More are dropped unread."""

SENDER_PACKETS_PER_S = 2.0
MOST_SENDERS = 256
SAME_AGAIN_S = 15.0
"""How long the same thing is not told again."""

MOST_REMEMBERED = 1000


class Allowance:
    """So many a second, with a burst of twice that; what is beyond is dropped."""

    def __init__(self, per_s: float, now_s: float) -> None:
        self._per_s = per_s
        self._left = 2 * per_s
        self._at_s = now_s

    def take(self, now_s: float) -> bool:
        """Use one, if there is one left."""
        self._left = min(2 * self._per_s, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Sieve:
    """Lets through as much as a person could look at."""

    def __init__(self, mono_s: Callable[[], float] = time.monotonic) -> None:
        self._mono_s = mono_s
        self._all = Allowance(PACKETS_PER_S, mono_s())
        self._senders: dict[str, Allowance] = {}
        self._told_s: dict[tuple[str, str], float] = {}
        self.dropped_count = 0

    def admits(self, sender: str) -> bool:
        """Say whether a datagram of this sender is read at all."""
        now_s = self._mono_s()
        if not self._all.take(now_s):
            self.dropped_count += 1
            return False
        if sender not in self._senders and len(self._senders) >= MOST_SENDERS:
            self._senders.clear()
        own = self._senders.setdefault(sender, Allowance(SENDER_PACKETS_PER_S, now_s))
        is_admitted = own.take(now_s)
        self.dropped_count += not is_admitted
        return is_admitted

    def is_news(self, one: Sighting) -> bool:
        """Say whether this was not told just now."""
        now_s = self._mono_s()
        key = (mark_of(one), one.address)
        if now_s - self._told_s.get(key, -SAME_AGAIN_S) < SAME_AGAIN_S:
            return False
        if len(self._told_s) >= MOST_REMEMBERED:
            self._told_s.clear()
        self._told_s[key] = now_s
        return True


def read_packet(packet: bytes, sender: str) -> Sighting | None:
    """Return what an announcement says; None: it is none, or its signature does not hold."""
    try:
        beacon = parse_beacon(packet)
    except DefinitionError:
        return None
    if beacon.key and not is_signature(beacon.key, beacon_bytes(beacon), beacon.signature):
        return None
    return sighting_of(beacon, sender)


def scan(wanted: DiscoveryConfig, used: set[str]) -> list[Sighting]:
    """Look at ports and addresses; lines that an admitted device uses are left alone."""
    found = [
        Sighting(
            source="serial",
            address=f"serial://{port.path}",
            name=port.name,
            model=port.model,
            serial=port.serial,
        )
        for port in serial_ports(wanted.serial)
        if f"serial:{port.path}" not in used
    ]
    for host, number in expand_addresses(wanted.network):
        address = f"tcp://{f'[{host}]' if ':' in host else host}:{number}"
        if line_key(address) not in used and is_listening(host, number):
            found.append(Sighting(source="network", address=address))
    return found


class Discovery:
    """Listens and looks, and hands on what is new."""

    def __init__(self, config: HostConfig, wanted: DiscoveryConfig) -> None:
        self._wanted = wanted
        self._store = Store(config.valkey_url)
        self._config = config
        self._sieve = Sieve()
        self._lock = threading.Lock()

    def run(self) -> None:
        """Go on until the process is told to end."""
        if self._wanted.beacon is not None:
            listening = threading.Thread(
                target=self._listen, args=(self._wanted.beacon,), daemon=True
            )
            listening.start()
        while True:
            self._look()
            threading.Event().wait(self._wanted.every_s)

    def _look(self) -> None:
        journal = Journal(self._config.journal_path)
        try:
            used = {_line(device.transport) for device in journal.devices()}
        finally:
            journal.close()
        for one in scan(self._wanted, used):
            self._tell(one)

    def _listen(self, wanted: BeaconConfig) -> None:
        with open_socket(wanted) as listening:
            while True:
                packet, sender = listening.recvfrom(LONGEST_BEACON_BYTES + 1)
                if self._sieve.admits(sender[0]):
                    one = read_packet(packet, sender[0])
                    if one is not None:
                        self._tell(one)

    def _tell(self, one: Sighting) -> None:
        with self._lock:
            if self._sieve.is_news(one):
                self._store.keep_sighting(msgspec.json.encode(one))


def _line(transport: str) -> str:
    try:
        return line_key(transport)
    except DefinitionError:
        return ""


def open_socket(wanted: BeaconConfig) -> socket.socket:
    """Listen for announcements, by broadcast and in the multicast group.

    Source:
        IP multicast, RFC 1112; ip(7), IP_ADD_MEMBERSHIP.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listening.bind(("", wanted.port))
    member = struct.pack("4s4s", socket.inet_aton(wanted.group), socket.inet_aton(wanted.interface))
    try:
        listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    except OSError as error:
        log.warning("no multicast on %s: %s; broadcasts are heard", wanted.interface, error)
    return listening


def run_discovery(config: HostConfig) -> None:
    """Run until told to end."""
    if config.discovery is not None:
        Discovery(config, config.discovery).run()
