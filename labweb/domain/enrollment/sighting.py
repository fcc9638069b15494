"""What a host sees on the lab's wires: announcements, each hostile until parsed.

A device announces itself by one UDP datagram of JSON, at most 1200 bytes:

```json
{"labweb": 1, "name": "Stirrer", "model": "HS-1", "serial": "0815", "driver": "IkaRctDigital",
 "scheme": "tcp", "port": 5000, "key": "…", "signature": "…"}
```

It says a port, never an address: the address is where the datagram came from. `key` and
`signature` (Ed25519, base64) are optional and go together; the signature is over the JSON of
all other fields with sorted keys and no blanks, after the words `labweb beacon 1` and a zero byte.
"""

from __future__ import annotations

import hashlib
import re
from ipaddress import ip_address, ip_network

import msgspec

from labweb.domain.errors import DefinitionError
from labweb.domain.messages import Sighting, canonical

LONGEST_BEACON_BYTES = 1200
LONGEST_TEXT = 100
MOST_ADDRESSES = 256
"""How many addresses a host may try in one round."""

MOST_OPEN = 200
"""How many candidates one host may have in the inbox at a time."""

FORGOTTEN_AFTER_S = 86400.0
"""A candidate that was not seen for so long has expired; it says so."""

SOURCES = ("beacon", "serial", "network")
_SCHEME = re.compile(r"[a-z][a-z0-9+]{0,19}")


class Beacon(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One announcement, as it comes."""

    labweb: int
    name: str
    port: int
    scheme: str = "tcp"
    model: str = ""
    serial: str = ""
    driver: str = ""
    key: str = ""
    signature: str = ""


def parse_beacon(packet: bytes) -> Beacon:
    """Read a datagram.

    Raises:
        DefinitionError: It is no announcement.
    """
    if len(packet) > LONGEST_BEACON_BYTES:
        raise DefinitionError("the datagram is too long", code="beacon.malformed")
    try:
        beacon = msgspec.json.decode(packet, type=Beacon)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise DefinitionError("the datagram is no announcement", code="beacon.malformed") from error
    texts = (beacon.name, beacon.model, beacon.serial, beacon.driver, beacon.key, beacon.signature)
    is_whole = (
        beacon.labweb == 1
        and 0 < beacon.port < 65536
        and _SCHEME.fullmatch(beacon.scheme) is not None
        and bool(beacon.name.strip())
        and all(len(text) <= LONGEST_TEXT and text.isprintable() for text in texts)
        and bool(beacon.key) == bool(beacon.signature)
    )
    if not is_whole:
        raise DefinitionError("a field of the announcement is wrong", code="beacon.malformed")
    return beacon


def beacon_bytes(beacon: Beacon) -> bytes:
    """Return what a device signs."""
    plain = msgspec.to_builtins(msgspec.structs.replace(beacon, signature=""))
    del plain["signature"]
    return b"labweb beacon 1\0" + canonical(plain)


def sighting_of(beacon: Beacon, sender: str) -> Sighting:
    """Turn an announcement whose signature holds, if it has one, into what the server is told."""
    host = f"[{sender}]" if ":" in sender else sender
    return Sighting(
        source="beacon",
        address=f"{beacon.scheme}://{host}:{beacon.port}",
        name=beacon.name,
        model=beacon.model,
        serial=beacon.serial,
        public_key=beacon.key,
        driver=beacon.driver,
    )


def mark_of(one: Sighting) -> str:
    """Return what makes two sightings the same candidate: its key, else its serial, else where.

    Another key is another candidate, whatever it says it is.
    """
    if one.public_key:
        who: tuple[str, ...] = ("key", one.public_key)
    elif one.serial:
        who = ("serial", one.model, one.serial)
    else:
        who = ("address", one.address)
    return hashlib.sha256(canonical(list(who))).hexdigest()


def is_sane(one: Sighting) -> bool:
    """Tell whether a sighting may be kept: known source, short printable texts."""
    texts = (one.address, one.name, one.model, one.serial, one.public_key, one.driver)
    is_short = all(len(text) <= 2 * LONGEST_TEXT and text.isprintable() for text in texts)
    return one.source in SOURCES and bool(one.address) and is_short


def expand_addresses(texts: list[str]) -> list[tuple[str, int]]:
    """Return the addresses that a host's configuration asks to try, `192.0.2.0/28:5000`.

    Raises:
        DefinitionError: One is none, or they are more than 256.
    """
    found: list[tuple[str, int]] = []
    for text in texts:
        where, _, port = text.rpartition(":")
        try:
            network = ip_network(where.strip("[]"), strict=False)
            number = int(port)
        except ValueError as error:
            raise DefinitionError(f"{text!r:.80} is no address with a port") from error
        if network.num_addresses > MOST_ADDRESSES or not 0 < number < 65536:
            raise DefinitionError(
                f"{text!r:.80} is more than {MOST_ADDRESSES} addresses, or no port"
            )
        hosts = list(network.hosts()) or [ip_address(network.network_address)]
        found += [(str(host), number) for host in hosts]
    if len(found) > MOST_ADDRESSES:
        raise DefinitionError(f"more than {MOST_ADDRESSES} addresses to try")
    return found
