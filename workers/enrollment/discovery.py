"""What this host sees: announcements on the network, serial ports, addresses that answer.

A process of its own, so that what a stranger sends is parsed apart from everything that
matters. It opens no device: it lists ports, and tries addresses that no admitted device uses.
"""

from __future__ import annotations

import logging
import socket
import struct
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import msgspec

from drivers.transports.scan import is_listening, serial_ports
from drivers.transports.urls import line_key
from labweb.domain.enrollment.device_announcements import (
    LONGEST_BEACON_BYTES,
    Beacon,
    DdsBeacon,
    beacon_bytes,
    expand_addresses,
    legible,
    parse_beacon,
    parse_dds_beacon,
    sighting_of,
)
from labweb.domain.errors import DefinitionError, LabError
from labweb.domain.messages.certificates_and_sightings import Sighting
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base.config import BeaconConfig, DdsConfig, DiscoveryConfig, HostConfig
from workers.base.signatures import is_signature
from workers.base.valkey_store import ValkeyStore
from workers.enrollment.rate_limit import AnnouncementFilter
from workers.journal.journal import Journal

log = logging.getLogger(__name__)


def read_packet(packet: bytes) -> Beacon | None:
    """Return what an announcement says; None: it is none, or its signature does not hold."""
    try:
        beacon = parse_beacon(packet)
    except DefinitionError:
        return None
    if beacon.key and not is_signature(beacon.key, beacon_bytes(beacon), beacon.signature):
        return None
    return beacon


def read_announcement(text: bytes) -> DdsBeacon | None:
    """Return what an announcement over DDS says; None: it is none, or its signature fails."""
    try:
        beacon = parse_dds_beacon(text)
    except DefinitionError:
        return None
    if not is_signature(beacon.key, beacon_bytes(beacon), beacon.signature):
        return None
    return beacon


def scan(wanted: DiscoveryConfig, used: set[str]) -> list[Sighting]:
    """Look at ports and addresses; lines that an admitted device uses are left alone."""
    found = [
        Sighting(
            source="serial",
            address=f"serial://{port.path}",
            name=legible(port.name),
            model=legible(port.model),
            serial=legible(port.serial),
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

    def __init__(
        self, config: HostConfig, wanted: DiscoveryConfig, store: ValkeyStore | None = None
    ) -> None:
        self._wanted = wanted
        self._store = ValkeyStore(config.valkey_url) if store is None else store
        self._config = config
        self._filter = AnnouncementFilter()
        self._lock = threading.Lock()
        self._announcements: Any = None

    def run(self) -> None:
        """Go on until the process is told to end."""
        self.serve()
        self.listen()
        while True:
            self.look()
            threading.Event().wait(self._wanted.every_s)

    def listen(self) -> None:
        """Hear announcements from now on."""
        if self._wanted.beacon is not None:
            listening = threading.Thread(
                target=self._listen, args=(self._wanted.beacon,), daemon=True
            )
            listening.start()
        if self._wanted.dds is not None:
            self._listen_over_dds(self._wanted.dds)

    def close(self) -> None:
        """Hear nothing over DDS any more."""
        if self._announcements is not None:
            self._announcements.close()

    def serve(self) -> list[DeviceConfig]:
        """Return the devices that this host serves; what they announce is always heard."""
        journal = Journal(self._config.journal_path)
        try:
            served = journal.devices()
        finally:
            journal.close()
        with self._lock:
            self._filter.serve({device.public_key for device in served})
        return served

    def look(self) -> None:
        """Look once at ports and addresses, and say what was too much to listen to."""
        for one in scan(self._wanted, {_line(device.transport) for device in self.serve()}):
            self._tell(one)
        with self._lock:
            complaint = self._filter.complaint()
        if complaint:
            log.warning("%s", complaint)

    def _listen(self, wanted: BeaconConfig) -> None:
        with open_socket(wanted) as listening:
            while True:
                packet, sender = listening.recvfrom(LONGEST_BEACON_BYTES + 1)
                self._hear(packet, sender[0])

    def _hear(self, packet: bytes, sender: str) -> None:
        beacon = self._read(packet, sender, read_packet)
        if beacon is not None and not isinstance(beacon, DdsBeacon):
            self._tell(sighting_of(beacon, sender))

    def _read(
        self, packet: bytes, sender: str, read: Callable[[bytes], Beacon | None]
    ) -> Beacon | None:
        """Return what is said; what a served device said before needs neither share nor check."""
        with self._lock:
            beacon = self._filter.known(packet)
            is_admitted = beacon is None and self._filter.admits(sender)
        if not is_admitted:
            return beacon
        beacon = read(packet)
        if beacon is not None:
            with self._lock:
                self._filter.learn(packet, beacon)
        return beacon

    def _listen_over_dds(self, wanted: DdsConfig) -> None:
        """Hear announcements on threads of the library; what is wrong here ends nothing else."""
        try:
            # Hosts that hear none over DDS need not have its library.
            link = import_module("drivers.transports.ros2.link")
            announcing = import_module("drivers.transports.ros2.announcing")
            settings = link.LinkSettings(wanted.domain, wanted.address, tuple(wanted.peers))
            self._announcements = announcing.Announcements(settings, LONGEST_BEACON_BYTES)
            self._announcements.listen(self._hear_over_dds)
        except (ImportError, LabError) as error:
            log.error("no announcements are heard over DDS: %s", error)

    def _hear_over_dds(self, text: bytes, sender: str) -> None:
        beacon = self._read(text, f"dds {sender}", read_announcement)
        if isinstance(beacon, DdsBeacon):
            self._tell(sighting_of(beacon, beacon.address))

    def _tell(self, one: Sighting) -> None:
        with self._lock:
            if self._filter.is_news(one):
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
