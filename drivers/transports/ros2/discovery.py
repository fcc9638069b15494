"""What participants and endpoints say of themselves when they are looked for.

Source:
    OMG, DDSI-RTPS 2.3, sections 8.5 and 9.6.2; the user data of a participant from
    rmw_dds_common, without which ROS 2 does not list it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.transports.ros2 import rtps
from drivers.transports.ros2.rtps import Address

LEASE_S = 20
LONGEST_LEASE_S = 600.0
_GUID_BYTES, _PREFIX_BYTES = 16, 12
_RELIABLE, _VOLATILE = 2, 0
_TENTH_OF_A_SECOND = 0x1999999A


@dataclass(frozen=True, slots=True)
class Peer:
    """Another participant, as it announced itself."""

    prefix: bytes
    control: tuple[Address, ...]
    data: tuple[Address, ...]
    lease_s: float


@dataclass(frozen=True, slots=True)
class PeerEndpoint:
    """A writer or reader of a peer."""

    guid: bytes
    topic: str
    type: str
    addresses: tuple[Address, ...]


def render_participant(prefix: bytes, own: Address) -> bytes:
    """Say who we are, where we hear, and for how long that counts."""
    place = rtps.locator(own)
    enclave = b"enclave=/;"
    return rtps.PL_CDR_LE + rtps.parameter_list(
        [
            (rtps.PID_VERSION, rtps.VERSION + b"\0\0"),
            (rtps.PID_VENDOR, rtps.VENDOR + b"\0\0"),
            (rtps.PID_PARTICIPANT, prefix + rtps.PARTICIPANT),
            (rtps.PID_METATRAFFIC_UNICAST, place),
            (rtps.PID_DEFAULT_UNICAST, place),
            (rtps.PID_LEASE, struct.pack("<iI", LEASE_S, 0)),
            (rtps.PID_ENDPOINTS, struct.pack("<I", rtps.ENDPOINT_SET)),
            (rtps.PID_USER_DATA, struct.pack("<I", len(enclave)) + enclave),
        ]
    )


def read_participant(payload: bytes) -> Peer | None:
    """Read what a participant says; None: it does not say who it is.

    Raises:
        struct.error, ValueError: It is malformed.
    """
    order, pairs = rtps.read_parameters(payload)
    found = dict(pairs)
    prefix = found.get(rtps.PID_PARTICIPANT, b"")[:_PREFIX_BYTES]
    if len(prefix) != _PREFIX_BYTES:
        return None
    lease = found.get(rtps.PID_LEASE)
    lease_s = LEASE_S if lease is None else struct.unpack(f"{order}iI", lease[:8])[0]
    return Peer(
        prefix,
        _locators(order, pairs, rtps.PID_METATRAFFIC_UNICAST),
        _locators(order, pairs, rtps.PID_DEFAULT_UNICAST),
        min(max(1.0, float(lease_s)), LONGEST_LEASE_S),
    )


def render_endpoint(guid: bytes, topic: str, type_name: str, own: Address) -> bytes:
    """Say what an endpoint of ours is: reliable, and without history."""
    return rtps.PL_CDR_LE + rtps.parameter_list(
        [
            (rtps.PID_ENDPOINT, guid),
            (rtps.PID_PARTICIPANT, guid[:_PREFIX_BYTES] + rtps.PARTICIPANT),
            (rtps.PID_KEY_HASH, guid),
            (rtps.PID_TOPIC, rtps.string(topic)),
            (rtps.PID_TYPE, rtps.string(type_name)),
            (rtps.PID_VERSION, rtps.VERSION + b"\0\0"),
            (rtps.PID_VENDOR, rtps.VENDOR + b"\0\0"),
            (rtps.PID_UNICAST, rtps.locator(own)),
            (rtps.PID_RELIABILITY, struct.pack("<IiI", _RELIABLE, 0, _TENTH_OF_A_SECOND)),
            (rtps.PID_DURABILITY, struct.pack("<I", _VOLATILE)),
        ]
    )


def read_endpoint(payload: bytes) -> PeerEndpoint | None:
    """Read what an endpoint says; None: it does not say what it is.

    Raises:
        struct.error, ValueError: It is malformed.
    """
    order, pairs = rtps.read_parameters(payload)
    found = dict(pairs)
    guid = found.get(rtps.PID_ENDPOINT, b"")
    if len(guid) != _GUID_BYTES or not {rtps.PID_TOPIC, rtps.PID_TYPE} <= set(found):
        return None
    return PeerEndpoint(
        guid,
        rtps.read_string(order, found[rtps.PID_TOPIC]),
        rtps.read_string(order, found[rtps.PID_TYPE]),
        _locators(order, pairs, rtps.PID_UNICAST),
    )


def read_gone(payload: bytes) -> bytes:
    """Return the GUID of what is no more, or nothing.

    Raises:
        struct.error, ValueError: It is malformed.
    """
    _, pairs = rtps.read_parameters(payload)
    found = dict(pairs)
    names = (rtps.PID_ENDPOINT, rtps.PID_KEY_HASH, rtps.PID_PARTICIPANT)
    guid = next((found[name] for name in names if name in found), b"")
    return guid if len(guid) == _GUID_BYTES else b""


def _locators(order: str, pairs: list[tuple[int, bytes]], pid: int) -> tuple[Address, ...]:
    found = (rtps.read_locator(order, value) for key, value in pairs if key == pid)
    return tuple(one for one in found if one is not None)[:8]
