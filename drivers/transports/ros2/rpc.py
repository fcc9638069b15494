"""Requests and replies of ROS 2 services between any two makers' DDS.

A reply names the request that it answers in the inline QoS of its sample, and a request is
known by writer and sequence number. The Python binding of Cyclone DDS can neither read nor
write these, and `rmw_cyclonedds` puts them into the payload, which Fast DDS, the default of
ROS 2, does not read. So this module is a participant of its own, which speaks RTPS for
services alone: discovery, and reliable writers and readers without history.

Source:
    OMG, DDSI-RTPS 2.3, section 8.5; the identity that is used from rmw_fastrtps
    (`rmw_request.cpp`, `rmw_response.cpp`); that makers differ: ros2/rmw_cyclonedds issue 184.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import selectors
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Iterator

from drivers.transports.ros2 import discovery, rtps
from drivers.transports.ros2.discovery import Peer, PeerEndpoint
from drivers.transports.ros2.link import PARTICIPANTS_COUNT, LinkSettings
from drivers.transports.ros2.reliable import Heard, ReliableReader, Writer
from drivers.transports.ros2.rtps import Address, SampleIdentity
from labweb.domain.errors import DefinitionError, Effect, UnreachableError

ANNOUNCE_S = 2.0
ANNOUNCE_FIRST_S = 0.1
FIRST_COUNT = 20
"""So many announcements come quickly, for those who wait."""

TICK_S = 0.02
BEAT_S = 0.1
LONGEST_PAYLOAD_BYTES = 60_000
"""Of one request or reply; a longer one would have to travel in fragments."""

MOST_PEERS = 128
MOST_ENDPOINTS = 8192
_ERRORS = (struct.error, ValueError, IndexError, KeyError)

_SEDP = {
    rtps.PUBLICATIONS_WRITER: rtps.PUBLICATIONS_READER,
    rtps.SUBSCRIPTIONS_WRITER: rtps.SUBSCRIPTIONS_READER,
}
_BUILT_IN = 0xC0  # 9.3.1.2: the kind of an entity that every participant has
_READER_BIT = 0x04  # 9.3.1.2: kinds of readers have it, kinds of writers do not
MOST_OWED = 256
_Due = list[tuple[Heard, SampleIdentity, rtps.DataSubmessage]]


class Participant:
    """Takes part in one DDS domain, for services alone."""

    def __init__(self, settings: LinkSettings) -> None:
        """Bind the sockets and begin to announce.

        Raises:
            UnreachableError: No port is free, or the network card is not there.
        """
        self._settings = settings
        self.prefix = secrets.token_bytes(8) + struct.pack("<I", os.getpid())
        self._lock = threading.RLock()
        self._peers: dict[bytes, Peer] = {}
        self._heard_s: dict[bytes, float] = {}
        self._remote: dict[bytes, PeerEndpoint] = {}
        self._writers = {entity: Writer(entity, "", "", is_lasting=True) for entity in _SEDP}
        self._readers = {
            entity: ReliableReader(entity, "", "", self._discovered) for entity in _SEDP.values()
        }
        self._owed: deque[tuple[Writer, bytes, SampleIdentity]] = deque(maxlen=MOST_OWED)
        self._next_entity = 0
        self._announced_count = 0
        self._announce_due_s = self._beat_due_s = 0.0
        self._ending = threading.Event()
        self._socket = _bind(settings)
        self._group = None if settings.is_local else _join(settings)
        self.address: Address = (settings.address, self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._run, name="ros2-services", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Tell the others, and end. May be called twice."""
        if self._ending.is_set():
            return
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)
        key = self.prefix + rtps.PARTICIPANT
        gone = rtps.PL_CDR_LE + rtps.parameter_list([(rtps.PID_PARTICIPANT, key)])
        self._announce(gone, {rtps.PID_KEY_HASH: key, rtps.PID_STATUS: rtps.GONE}, number=2)
        self._socket.close()
        if self._group is not None:
            self._group.close()

    def writer(self, topic: str, type_name: str) -> bytes:
        """Make a reliable writer and return its GUID."""
        with self._lock:
            entity = self._entity(0x03)  # 9.3.1.2: a writer without key
            self._writers[entity] = Writer(entity, topic, type_name)
            return self._tell_endpoint(rtps.PUBLICATIONS_WRITER, entity, topic, type_name)

    def reader(self, topic: str, type_name: str, heard: Heard) -> bytes:
        """Make a reliable reader and return its GUID; `heard` is called on our thread."""
        with self._lock:
            entity = self._entity(0x04)  # 9.3.1.2: a reader without key
            self._readers[entity] = ReliableReader(entity, topic, type_name, heard)
            return self._tell_endpoint(rtps.SUBSCRIPTIONS_WRITER, entity, topic, type_name)

    def matched_count(self, guid: bytes) -> int:
        """Return how many endpoints of others one of ours talks with."""
        with self._lock:
            entity = guid[12:]
            if entity in self._writers:
                return len(self._writers[entity].listeners)
            return len(self._readers[entity].sources)

    def write(self, guid: bytes, payload: bytes, related: SampleIdentity) -> int:
        """Send one sample and return its sequence number.

        A reply to a reader that is not discovered yet waits for it; its number is 0.

        Raises:
            DefinitionError: It is too long. Nothing was sent.
        """
        if len(payload) > LONGEST_PAYLOAD_BYTES:
            raise DefinitionError(
                f"a request or reply of {len(payload)} bytes: {LONGEST_PAYLOAD_BYTES} may be sent",
                code="ros2.too_long",
            )
        with self._lock:
            writer, reader = self._writers[guid[12:]], related.guid
            is_reply = reader[:12] != self.prefix and reader[15] & _READER_BIT
            if is_reply and reader not in writer.listeners:
                self._owed.append((writer, payload, related))
                return 0
            return self._put(writer, payload, rtps.related(related))

    # What is sent.

    def _entity(self, kind: int) -> bytes:
        self._next_entity += 1
        return struct.pack(">I", self._next_entity << 8 | kind)

    def _tell_endpoint(self, through: bytes, entity: bytes, topic: str, type_name: str) -> bytes:
        guid = self.prefix + entity
        told = discovery.render_endpoint(guid, topic, type_name, self.address)
        self._put(self._writers[through], told, {})
        for endpoint in list(self._remote.values()):
            self._match(endpoint)
        return guid

    def _put(self, writer: Writer, payload: bytes, inline: dict[int, bytes]) -> int:
        number = writer.add(payload, inline)
        for guid in list(writer.listeners):
            self._send(guid, writer.samples(guid, [number]))
        return number

    def _send(self, guid: bytes, parts: bytes) -> None:
        """Send parts to one endpoint, as many together as a datagram takes."""
        if not parts:
            return
        message = rtps.HEADER + self.prefix + rtps.info_dst(guid[:12])
        for piece in rtps.pieces(parts):
            for address in self._addresses(guid):
                self._send_to(address, message + piece)

    def _send_to(self, address: Address, message: bytes) -> None:
        with contextlib.suppress(OSError):  # sent again until it is acknowledged
            self._socket.sendto(message, address)

    def _addresses(self, guid: bytes) -> tuple[Address, ...]:
        peer = self._peers.get(guid[:12])
        if peer is None:
            return ()
        if guid[15] & _BUILT_IN == _BUILT_IN:
            return peer.control
        found = self._remote.get(guid)
        return found.addresses if found is not None and found.addresses else peer.data

    def _announce(self, payload: bytes, inline: dict[int, bytes], *, number: int = 1) -> None:
        """Tell everybody; Fast DDS passes over a number that it has heard already."""
        part = rtps.data(rtps.SPDP_WRITER, rtps.SPDP_READER, number, payload, inline)
        message = rtps.HEADER + self.prefix + part
        for address in dict.fromkeys((*self._settings.announce_to(), *self._controls())):
            if address != self.address:
                self._send_to(address, message)

    def _controls(self) -> Iterator[Address]:
        for peer in list(self._peers.values()):
            yield from peer.control

    def _tick(self, now_s: float) -> None:
        if now_s >= self._announce_due_s:
            is_first = self._announced_count < FIRST_COUNT
            self._announced_count += 1
            self._announce_due_s = now_s + (ANNOUNCE_FIRST_S if is_first else ANNOUNCE_S)
            self._announce(discovery.render_participant(self.prefix, self.address), {})
        if now_s >= self._beat_due_s:
            self._beat_due_s = now_s + BEAT_S
            for writer in self._writers.values():
                for guid in writer.waiting():
                    self._send(guid, writer.beat(guid))
            for prefix, peer in list(self._peers.items()):
                if now_s - self._heard_s[prefix] > peer.lease_s:
                    self._forget(prefix)

    # What is heard.

    def _run(self) -> None:
        with selectors.DefaultSelector() as waiting:
            for one in (self._socket, self._group):
                if one is not None:
                    waiting.register(one, selectors.EVENT_READ, one)
            while not self._ending.is_set():
                for key, _ in waiting.select(TICK_S):
                    for heard, identity, sample in self._receive(key.data):
                        heard(identity, sample)
                with self._lock:
                    self._tick(time.monotonic())

    def _receive(self, source: socket.socket) -> _Due:
        """Take one datagram; return what is due, to be told once the lock is free."""
        try:
            packet = rtps.read_packet(source.recv(65536))
        except (OSError, *_ERRORS):
            return []
        if packet is None or packet.prefix == self.prefix:
            return []
        due: _Due = []
        with self._lock:
            if packet.prefix in self._peers:
                self._heard_s[packet.prefix] = time.monotonic()
            for target, part in packet.parts:
                if target in {b"", self.prefix}:
                    with contextlib.suppress(*_ERRORS):
                        due += self._take(packet.prefix, part)
        return due

    def _take(self, prefix: bytes, part: rtps.Part) -> _Due:
        if isinstance(part, rtps.Want):
            self._take_want(prefix, part)
            return []
        if part.writer == rtps.SPDP_WRITER:
            if isinstance(part, rtps.DataSubmessage):
                self._take_participant(part)
            return []
        guid = prefix + part.writer
        due: _Due = []
        for reader in list(self._readers.values()):
            if part.reader in {reader.entity, rtps.UNKNOWN_ENTITY}:
                for sample in self._take_for(reader, guid, part):
                    due.append((reader.heard, SampleIdentity(guid, sample.sequence), sample))
        return due

    def _take_for(
        self, reader: ReliableReader, guid: bytes, part: rtps.Part
    ) -> list[rtps.DataSubmessage]:
        match part:
            case rtps.DataSubmessage():
                return reader.take_data(guid, part)
            case rtps.Skip():
                return reader.take_skip(guid, part)
            case rtps.HeartbeatSubmessage():
                due, answer = reader.take_beat(guid, part)
                self._send(guid, answer)
                return due
        return []

    def _take_want(self, prefix: bytes, want: rtps.Want) -> None:
        writer, guid = self._writers.get(want.writer), prefix + want.reader
        if writer is not None and (again := writer.take_want(guid, want)):
            self._send(guid, writer.samples(guid, again))

    def _take_participant(self, sample: rtps.DataSubmessage) -> None:
        if sample.is_gone:
            self._forget(discovery.read_gone(sample.payload)[:12])
            return
        peer = discovery.read_participant(sample.payload)
        if peer is None or peer.prefix == self.prefix:
            return
        is_new = peer.prefix not in self._peers
        if is_new and len(self._peers) >= MOST_PEERS:
            return
        self._peers[peer.prefix] = peer
        self._heard_s[peer.prefix] = time.monotonic()
        if is_new:
            self._announce(discovery.render_participant(self.prefix, self.address), {})
            for writer, reader in _SEDP.items():
                self._readers[reader].match(peer.prefix + writer)
                guid = peer.prefix + reader
                self._send(guid, self._writers[writer].match(guid))

    def _discovered(self, identity: SampleIdentity, sample: rtps.DataSubmessage) -> None:
        with self._lock, contextlib.suppress(*_ERRORS):
            if sample.is_gone:
                self._lose(discovery.read_gone(sample.payload))
                return
            found = discovery.read_endpoint(sample.payload)
            is_own = found is not None and found.guid[:12] == identity.guid[:12]
            if found is not None and is_own and len(self._remote) < MOST_ENDPOINTS:
                self._remote[found.guid] = found
                self._match(found)

    def _match(self, found: PeerEndpoint) -> None:
        name = (found.topic, found.type)
        is_reader = found.guid[15] & _READER_BIT
        if not is_reader:
            for reader in self._readers.values():
                if (reader.topic, reader.type) == name:
                    reader.match(found.guid)
            return
        for writer in self._writers.values():
            if (writer.topic, writer.type) == name:
                self._send(found.guid, writer.match(found.guid))
        due = [one for one in self._owed if one[2].guid == found.guid]
        for owed in due:
            self._owed.remove(owed)
            self._put(owed[0], owed[1], rtps.related(owed[2]))

    def _forget(self, prefix: bytes) -> None:
        if self._peers.pop(prefix, None) is None:
            return
        del self._heard_s[prefix]
        guids = {guid for guid in self._remote if guid[:12] == prefix}
        for guid in guids | {prefix + entity for pair in _SEDP.items() for entity in pair}:
            self._lose(guid)

    def _lose(self, guid: bytes) -> None:
        self._remote.pop(guid, None)
        for writer in self._writers.values():
            writer.unmatch(guid)
        for reader in self._readers.values():
            reader.unmatch(guid)


def _bind(settings: LinkSettings) -> socket.socket:
    """Bind the first free port at which participants are looked for."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    try:
        packed = socket.inet_aton(settings.address)
        found.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, packed)
        for index in range(PARTICIPANTS_COUNT):
            with contextlib.suppress(OSError):
                found.bind((settings.address, settings.unicast_port(index)))
                return found
        reason = f"every port of domain {settings.domain} is taken at {settings.address}"
    except OSError as error:
        reason = f"{settings.address} is no network card here: {error}"
    found.close()
    raise UnreachableError(reason, effect=Effect.NONE)


def _join(settings: LinkSettings) -> socket.socket:
    """Hear what is announced by multicast on one network card."""
    host, port = settings.group
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        member = socket.inet_aton(host) + socket.inet_aton(settings.address)
        found.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    except OSError as error:
        found.close()
        text = f"no multicast at {settings.address}: {error}"
        raise UnreachableError(text, effect=Effect.NONE) from error
    return found
