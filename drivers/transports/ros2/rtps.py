"""Bytes of RTPS, as far as requests and replies need them.

Source:
    OMG, DDSI-RTPS 2.3 (formal/2019-04-03), section 9; PID_RELATED_SAMPLE_IDENTITY from
    OMG, RPC over DDS 1.0, section 7.8.2, and under 0x800f as Fast DDS sends it as well.
"""

from __future__ import annotations

import ipaddress
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

VENDOR = b"\x00\x00"  # 9.3.2.1: a vendor that is not known
VERSION = b"\x02\x03"
HEADER = b"RTPS" + VERSION + VENDOR
HEADER_BYTES = 20
UNKNOWN_ENTITY = b"\x00\x00\x00\x00"
LONGEST_PARTS_BYTES = 60_500
NO_SEQUENCE = -1 << 32  # 9.3.2: SEQUENCENUMBER_UNKNOWN, high -1 and low 0

ACKNACK, HEARTBEAT, GAP, INFO_DST, DATA = 0x06, 0x07, 0x08, 0x0E, 0x15  # 9.4.5.1.1
_MAY_BE_EMPTY = (0x01, 0x09)  # PAD and INFO_TS
_LITTLE, _FINAL, _INLINE_QOS, _HAS_DATA, _HAS_KEY = 0x01, 0x02, 0x02, 0x04, 0x08

# 9.6.2.2.2 and 9.6.3
PID_SENTINEL, PID_LEASE, PID_TOPIC, PID_TYPE = 0x0001, 0x0002, 0x0005, 0x0007
PID_VERSION, PID_VENDOR, PID_RELIABILITY, PID_DURABILITY = 0x0015, 0x0016, 0x001A, 0x001D
PID_USER_DATA, PID_UNICAST, PID_DEFAULT_UNICAST = 0x002C, 0x002F, 0x0031
PID_METATRAFFIC_UNICAST, PID_PARTICIPANT, PID_ENDPOINTS = 0x0032, 0x0050, 0x0058
PID_ENDPOINT, PID_KEY_HASH, PID_STATUS = 0x005A, 0x0070, 0x0071
PID_RELATED, PID_RELATED_FAST = 0x0083, 0x800F

CDR_LE, PL_CDR_BE, PL_CDR_LE = b"\x00\x01\x00\x00", b"\x00\x02\x00\x00", b"\x00\x03\x00\x00"
GONE = struct.pack(">I", 3)  # 9.6.3.9: disposed and unregistered

PARTICIPANT = b"\x00\x00\x01\xc1"
SPDP_WRITER, SPDP_READER = b"\x00\x01\x00\xc2", b"\x00\x01\x00\xc7"
PUBLICATIONS_WRITER, PUBLICATIONS_READER = b"\x00\x00\x03\xc2", b"\x00\x00\x03\xc7"
SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER = b"\x00\x00\x04\xc2", b"\x00\x00\x04\xc7"
ENDPOINT_SET = 0b111111  # 9.3.2, Table 9.4: participants, publications, subscriptions, both ways

Address = tuple[str, int]


@dataclass(frozen=True, slots=True)
class SampleIdentity:
    """Which sample of which endpoint."""

    guid: bytes
    sequence: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DataSubmessage:
    """One sample."""

    reader: bytes
    writer: bytes
    """Entity ids, four bytes."""

    sequence: int
    related: SampleIdentity | None
    is_gone: bool
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class HeartbeatSubmessage:
    """What a writer has: the first and the last sequence number."""

    reader: bytes
    writer: bytes
    first: int
    last: int
    is_final: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Want:
    """What a reader has, all below `base`, and what it misses."""

    reader: bytes
    writer: bytes
    base: int
    missing: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Skip:
    """Samples that will never come."""

    reader: bytes
    writer: bytes
    first: int
    end: int
    others: tuple[int, ...]


Part = DataSubmessage | HeartbeatSubmessage | Want | Skip


@dataclass(slots=True)
class Packet:
    """What one datagram says, and to whom."""

    prefix: bytes
    parts: list[tuple[bytes, Part]] = field(default_factory=list)
    """Each with the prefix that it is meant for; empty: anybody."""


def read_packet(data: bytes) -> Packet | None:
    """Read a datagram; None: it is no RTPS. Parts that are not known are passed over.

    Raises:
        struct.error, IndexError, ValueError: It is cut off, or contradicts itself.
    """
    if len(data) < HEADER_BYTES or data[:4] != b"RTPS" or data[4] != VERSION[0]:
        return None
    packet = Packet(data[8:20])
    target, at = b"", HEADER_BYTES
    while at + 4 <= len(data):
        kind, flags = data[at], data[at + 1]
        order = "<" if flags & _LITTLE else ">"
        (length,) = struct.unpack_from(f"{order}H", data, at + 2)
        if not length and kind not in _MAY_BE_EMPTY:
            length = len(data) - at - 4  # 9.4.5.1.3: up to the end
        body = data[at + 4 : at + 4 + length]
        at += 4 + length
        if kind == INFO_DST:
            target = body[:12]
        part = _read_part(kind, flags, order, body)
        if part is not None:
            packet.parts.append((b"" if target == bytes(12) else target, part))
    return packet


def _read_part(kind: int, flags: int, order: str, body: bytes) -> Part | None:
    match kind:
        case 0x15:
            return _read_data(flags, order, body)
        case 0x07:
            first, last = _number(order, body, 8), _number(order, body, 16)
            is_final = bool(flags & _FINAL)
            return HeartbeatSubmessage(
                reader=body[:4], writer=body[4:8], first=first, last=last, is_final=is_final
            )
        case 0x06:
            base, missing = _read_set(order, body, 8)
            return Want(reader=body[:4], writer=body[4:8], base=base, missing=missing)
        case 0x08:
            end, others = _read_set(order, body, 16)
            first = _number(order, body, 8)
            return Skip(reader=body[:4], writer=body[4:8], first=first, end=end, others=others)
    return None


def _read_data(flags: int, order: str, body: bytes) -> DataSubmessage:
    (skip,) = struct.unpack_from(f"{order}H", body, 2)
    at = 4 + skip
    found: dict[int, bytes] = {}
    if flags & _INLINE_QOS:
        for pid, value, end in _parameters(order, body, at):
            found.setdefault(pid, value)
            at = end
    raw = found.get(PID_RELATED, found.get(PID_RELATED_FAST))
    related = None
    if raw is not None and len(raw) >= 24:
        related = SampleIdentity(raw[:16], _number(order, raw, 16))
    status = found.get(PID_STATUS, b"\0\0\0\0")
    has_payload = flags & (_HAS_DATA | _HAS_KEY)
    return DataSubmessage(
        reader=body[4:8],
        writer=body[8:12],
        sequence=_number(order, body, 12),
        related=related,
        is_gone=bool(status[-1] & 3),
        payload=body[at:] if has_payload else b"",
    )


def _number(order: str, data: bytes, at: int) -> int:
    high, low = struct.unpack_from(f"{order}iI", data, at)
    return int(high * (1 << 32) + low)


def _read_set(order: str, body: bytes, at: int) -> tuple[int, tuple[int, ...]]:
    base = _number(order, body, at)
    (count,) = struct.unpack_from(f"{order}I", body, at + 8)
    if count > 256:
        raise ValueError("a set of sequence numbers has at most 256 bits")
    words = struct.unpack_from(f"{order}{(count + 31) // 32}I", body, at + 12)
    bits = range(count)
    return base, tuple(base + i for i in bits if words[i // 32] >> (31 - i % 32) & 1)


def _parameters(order: str, data: bytes, at: int) -> Iterator[tuple[int, bytes, int]]:
    """Yield each parameter and where the next one begins."""
    while True:
        pid, length = struct.unpack_from(f"{order}HH", data, at)
        if pid == PID_SENTINEL:
            yield pid, b"", at + 4
            return
        if at + 4 + length > len(data):
            raise ValueError("a parameter is longer than what holds it")
        yield pid, data[at + 4 : at + 4 + length], at + 4 + length
        at += 4 + length


def info_dst(prefix: bytes) -> bytes:
    """Say whom what follows is meant for."""
    return _part(INFO_DST, 0, prefix)


def data(
    writer: bytes, reader: bytes, sequence: int, payload: bytes, inline: Mapping[int, bytes]
) -> bytes:
    """Render one sample."""
    flags = _HAS_KEY if PID_STATUS in inline else _HAS_DATA
    qos = b""
    if inline:
        flags |= _INLINE_QOS
        qos = parameter_list(list(inline.items()))
    body = struct.pack("<HH4s4s", 0, 16, reader, writer) + _render(sequence) + qos
    return _part(DATA, flags, body + payload)


def related(identity: SampleIdentity) -> dict[int, bytes]:
    """Name the request that a sample answers, or the reader that waits for the answer."""
    value = identity.guid + _render(identity.sequence)
    return {PID_RELATED: value, PID_RELATED_FAST: value}


def heartbeat(
    writer: bytes, reader: bytes, has: tuple[int, int], count: int, *, is_final: bool
) -> bytes:
    """Say what a writer has: the first and the last number."""
    body = reader + writer + _render(has[0]) + _render(has[1]) + struct.pack("<I", count)
    return _part(HEARTBEAT, _FINAL if is_final else 0, body)


def acknack(reader: bytes, writer: bytes, wants: tuple[int, Sequence[int]], count: int) -> bytes:
    """Say what a reader wants: it has all below the first number, and misses the others."""
    body = reader + writer + _render_set(*wants) + struct.pack("<I", count)
    return _part(ACKNACK, 0 if wants[1] else _FINAL, body)


def gap(writer: bytes, reader: bytes, first: int, end: int) -> bytes:
    """Say that the samples from `first` up to `end`, without it, will never come."""
    return _part(GAP, 0, reader + writer + _render(first) + _render_set(end, ()))


def _render(sequence: int) -> bytes:
    return struct.pack("<iI", sequence >> 32, sequence & 0xFFFFFFFF)


def _render_set(base: int, members: Sequence[int]) -> bytes:
    offsets = [one - base for one in members if 0 <= one - base < 256]
    count = max(offsets, default=-1) + 1
    words = [0] * ((count + 31) // 32)
    for offset in offsets:
        words[offset // 32] |= 1 << (31 - offset % 32)
    return _render(base) + struct.pack(f"<I{len(words)}I", count, *words)


def _part(kind: int, flags: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    return struct.pack("<BBH", kind, flags | _LITTLE, len(body)) + body


def pieces(parts: bytes) -> list[bytes]:
    """Cut rendered parts into datagrams, each as long as one may be."""
    found = [b""]
    at = 0
    while at < len(parts):
        (length,) = struct.unpack_from("<H", parts, at + 2)
        end = at + 4 + length
        if found[-1] and len(found[-1]) + end - at > LONGEST_PARTS_BYTES:
            found.append(b"")
        found[-1] += parts[at:end]
        at = end
    return found


def parameter_list(pairs: Sequence[tuple[int, bytes]]) -> bytes:
    """Render parameters with their end."""
    found = b"".join(
        struct.pack("<HH", pid, len(value) + -len(value) % 4) + value + bytes(-len(value) % 4)
        for pid, value in pairs
    )
    return found + struct.pack("<HH", PID_SENTINEL, 0)


def read_parameters(payload: bytes) -> tuple[str, list[tuple[int, bytes]]]:
    """Read the payload of a discovery sample: its byte order and its parameters.

    Raises:
        struct.error, ValueError: It is none.
    """
    if payload[:2] not in {PL_CDR_LE[:2], PL_CDR_BE[:2]}:
        raise ValueError("no parameter list")
    order = "<" if payload[:2] == PL_CDR_LE[:2] else ">"
    return order, [(pid, value) for pid, value, _ in _parameters(order, payload, 4)]


def string(text: str) -> bytes:
    """Render a string as CDR does."""
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def read_string(order: str, value: bytes) -> str:
    """Read a string.

    Raises:
        struct.error, ValueError: It is none.
    """
    (length,) = struct.unpack_from(f"{order}I", value)
    return value[4 : 4 + length].rstrip(b"\0").decode()


def locator(address: Address) -> bytes:
    """Render an IPv4 address and port."""
    host, port = address
    packed = ipaddress.IPv4Address(host).packed
    return struct.pack("<iI12s4s", 1, port, b"", packed)


def read_locator(order: str, value: bytes) -> Address | None:
    """Read a locator; None: it is no IPv4 address over UDP."""
    kind, port, _, packed = struct.unpack(f"{order}iI12s4s", value[:24])
    if kind != 1 or not 0 < port < 1 << 16:
        return None
    return str(ipaddress.IPv4Address(packed)), port
