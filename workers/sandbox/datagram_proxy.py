"""Send datagrams for a confined line of DDS: on its own card's network, and nowhere else.

Whom a line of DDS talks with it learns from the network: any machine there may be a node. So its
proxy copies each datagram and its address, looks where it goes, and sends it itself on the
line's own socket, out of the line's own card, whatever the line has set on that socket or writes
over the address meanwhile:

```text
its group (discovery)    its card, one hop
its card's own network   its card, no gateway; ports from 1024
its named peers          its card, by whatever gateway; ports from 1024
on loopback also         any address of this machine itself, over loopback; ports from 1024
anything else            refused: other groups, broadcasts, other networks, IPv6
```

A node of this machine may name the address of any of its cards, also to those that stay on it.
Ports below 1024 are no node's: nodes take what the system gives, or from 7400 on.

Source:
    Linux, sendmsg(2) (MSG_DONTROUTE), ip(7) (IP_PKTINFO, IP_TTL), rtnetlink(7) (RTM_GETADDR);
    OMG, DDSI-RTPS 2.3, section 9.6.1.
"""

from __future__ import annotations

import errno
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Interface

LOWEST_PORT = 1024
LONGEST_BYTES = 65_536
_MOST_PARTS = 256
_CARD_S = 1.0
"""How long it is believed which card has an address."""

_MOST_CARDS = 256
"""Of so many addresses it is remembered, at most."""

_MESSAGE = struct.Struct("=QIIQQQQiI")
_PART = struct.Struct("=QQ")
_FINE_FLAGS = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
_REQUEST = struct.Struct("=IHHIIBBHi")
_GET_ADDRESSES, _NEW_ADDRESS, _ASK_ALL, _IFA_LOCAL = 22, 20, 0x301, 2
_IP_PKTINFO = 8

Read = Callable[[int, int], bytes]
"""Copy so many bytes from a place in the line's memory."""


@dataclass(frozen=True)
class NetworkCard:
    """A network card of this machine."""

    index: int
    here: IPv4Interface


@dataclass(frozen=True)
class DatagramSegment:
    """Where the datagrams of one domain of DDS may go."""

    address: str
    """Of this machine's card."""

    group: tuple[str, int]
    peers: frozenset[str] = frozenset()
    """Machines that a person has named."""

    def is_reached(self, host: str, port: int, card: NetworkCard) -> bool:
        """Tell whether a datagram may go there."""
        to = IPv4Address(host)
        if to.is_multicast:
            return (host, port) == self.group and not card.here.ip.is_loopback
        if port < LOWEST_PORT:
            return False
        network = card.here.network
        is_one = network.num_addresses <= 2 or to not in (
            network.network_address,
            network.broadcast_address,
        )
        return (to in network and is_one) or host in self.peers


@dataclass
class DatagramProxy:
    """Sends for the lines of one proxy."""

    segments: frozenset[DatagramSegment]
    _cards: dict[str, tuple[float, NetworkCard | None]] = field(default_factory=dict)

    def send(self, opened: socket.socket, content: bytes, raw: bytes, flags: int) -> int:
        """Send one datagram of the line on its own socket; return how many bytes went.

        Args:
            opened: The line's socket.
            content: What is sent.
            raw: The address as the kernel takes it; empty: where the socket is connected to,
                which the proxy has seen.
            flags: As the line has given them.

        Raises:
            OSError: It may not go there, or the kernel refuses.
        """
        if flags & ~_FINE_FLAGS:
            raise OSError(errno.EPERM, "flags")
        flags |= socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
        if not raw:
            return opened.send(content, flags)
        (family,) = struct.unpack_from("=H", raw)
        if family != opened.family:
            raise OSError(errno.EAFNOSUPPORT, "family")
        if family == socket.AF_NETLINK:
            # Words to the kernel itself: which cards are there. They leave this machine by none.
            return opened.sendto(content, flags, struct.unpack_from("=HHII", raw)[2:])
        if family != socket.AF_INET or opened.type != socket.SOCK_DGRAM:
            raise OSError(errno.EACCES, "family")
        port, packed = struct.unpack_from(">H4s", raw, 2)
        return self._send_out(opened, content, (str(IPv4Address(packed)), port), flags)

    def _send_out(
        self, opened: socket.socket, content: bytes, to: tuple[str, int], flags: int
    ) -> int:
        for segment in self.segments:
            card = self._card(segment.address)
            if card is None or not (segment.is_reached(*to, card) or self._is_own(*to, card)):
                continue
            here = struct.pack("=i4s4x", card.index, card.here.ip.packed)
            words = [(socket.IPPROTO_IP, _IP_PKTINFO, here)]
            if to[0] not in segment.peers:
                words.append((socket.IPPROTO_IP, socket.IP_TTL, struct.pack("=i", 1)))
                flags |= socket.MSG_DONTROUTE
            return opened.sendmsg([content], words, flags, to)
        raise OSError(errno.EACCES, "address")

    def _is_own(self, host: str, port: int, card: NetworkCard) -> bool:
        """Tell whether a datagram goes to this machine, of a line that stays on it."""
        is_local = card.here.ip.is_loopback and port >= LOWEST_PORT
        return is_local and self._card(host) is not None

    def _card(self, address: str) -> NetworkCard | None:
        """Return the card that has an address now; None: none has."""
        now_s = time.monotonic()
        at_s, card = self._cards.get(address, (now_s - _CARD_S, None))
        if now_s - at_s >= _CARD_S:
            card = find_card(address)
            if len(self._cards) >= _MOST_CARDS:
                self._cards.clear()
            self._cards[address] = (now_s, card)
        return card


def read_message(read: Read, place: int) -> tuple[bytes, bytes]:
    """Copy a message out of the line's memory: content and address.

    Raises:
        OSError: It is too long, or carries more than content and address.
    """
    name, name_size, _, parts, parts_count, _, control_size, _, _ = _MESSAGE.unpack(
        read(place, _MESSAGE.size)
    )
    if control_size or parts_count > _MOST_PARTS or name_size > _MESSAGE.size * 2:
        raise OSError(errno.EPERM, "message")
    table = read(parts, _PART.size * parts_count) if parts_count else b""
    pieces = list(_PART.iter_unpack(table))
    if sum(size for _, size in pieces) > LONGEST_BYTES:
        raise OSError(errno.EMSGSIZE, "message")
    content = b"".join(read(at, size) for at, size in pieces if size)
    return content, read(name, name_size) if name and name_size else b""


def find_card(address: str) -> NetworkCard | None:
    """Return the card that has an address; None: none has."""
    wanted = IPv4Address(address)
    request = _REQUEST.pack(24, _GET_ADDRESSES, _ASK_ALL, 1, 0, socket.AF_INET, 0, 0, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as asking:
        asking.settimeout(1.0)
        asking.send(request)
        while True:
            told = asking.recv(65_536)
            while told:
                length, sort = struct.unpack_from("=IH", told)
                if sort != _NEW_ADDRESS:
                    return None  # that was all of them
                found = _read_card(told[16:length], wanted)
                if found is not None:
                    return found
                told = told[_aligned(length) :]


def _read_card(told: bytes, wanted: IPv4Address) -> NetworkCard | None:
    _, prefix, _, _, index = struct.unpack_from("=BBBBI", told)
    at = 8
    while at < len(told):
        length, sort = struct.unpack_from("=HH", told, at)
        if sort == _IFA_LOCAL and told[at + 4 : at + length] == wanted.packed:
            return NetworkCard(index, IPv4Interface(f"{wanted}/{prefix}"))
        at += _aligned(length)
    return None


def _aligned(length: int) -> int:
    return max(4, length + 3 & ~3)
