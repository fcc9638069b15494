"""What a host sees on the lab's wires: announcements, each hostile until parsed.

A device announces itself by one UDP datagram of JSON, at most 1200 bytes:

```json
{"labweb": 1, "name": "Stirrer", "model": "HS-1", "serial": "0815", "driver": "IkaRctDigital",
 "scheme": "tcp", "port": 5000, "key": "…", "signature": "…"}
```

It says a port, never an address: the address is where the datagram came from. It comes every ten
seconds, always with the same bytes. `key` and
`signature` (Ed25519, base64) are optional and go together; the signature is over the JSON of
all other fields with sorted keys and no blanks, after the words `labweb beacon 1` and a zero byte.

Over DDS the same text is the `data` of a `std_msgs/msg/String` on the topic `/labweb/beacon`. DDS
does not say where a sample came from, so there it also says its `address`, a plain IP address, and
has to have a key: what nobody signed could name any machine.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import unicodedata
from ipaddress import ip_address, ip_network
from typing import TypeVar

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import DefinitionError
from labweb.domain.messages.certificates_and_sightings import Sighting

LONGEST_BEACON_BYTES = 1200
LONGEST_TEXT = 100
MOST_ADDRESSES = 256
"""How many addresses a host may try in one round."""

MOST_OPEN = 200
"""How many candidates of one source one host may have in the inbox at a time."""

MOST_OF_ONE_PLACE = 32
"""How many of them may announce themselves from one address."""

MAKES_ROOM_AFTER_S = 600.0
"""In a full inbox, what nobody has answered and was not seen for so long goes first."""

FORGOTTEN_AFTER_S = 86400.0
"""A candidate that was not seen for so long has expired; it says so."""

SOURCES = ("beacon", "serial", "network")
_SCHEME = re.compile(r"[a-z][a-z0-9+]{0,19}")
_KEY_BYTES = 32
_MOST_MARKS = 2
"""More accents on one letter are no language's; they paint over the lines above."""

_UNSEEN = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]"
)
"""Signs that are printable and show nothing; Unicode 16, Default_Ignorable_Code_Point."""


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


_Sort = TypeVar("_Sort", bound=Beacon)


class DdsBeacon(Beacon, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One announcement over DDS, as it comes."""

    address: str


def parse_dds_beacon(text: bytes) -> DdsBeacon:
    """Read what was announced over DDS.

    Raises:
        DefinitionError: It is no announcement, has no key, or says no address of a machine.
    """
    beacon = _parse(text, DdsBeacon)
    try:
        address = ip_address(beacon.address)
    except ValueError as error:
        raise DefinitionError("its address is none", code="beacon.malformed") from error
    is_plain = str(address) == beacon.address and "%" not in beacon.address
    if address.is_multicast or address.is_unspecified or not is_plain:
        raise DefinitionError("its address is no machine's", code="beacon.malformed")
    if not beacon.key:
        raise DefinitionError("it has no key", code="beacon.malformed")
    return beacon


def parse_beacon(packet: bytes) -> Beacon:
    """Read a datagram.

    Raises:
        DefinitionError: It is no announcement.
    """
    return _parse(packet, Beacon)


def _parse(packet: bytes, sort: type[_Sort]) -> _Sort:
    if len(packet) > LONGEST_BEACON_BYTES:
        raise DefinitionError("the datagram is too long", code="beacon.malformed")
    try:
        beacon = msgspec.json.decode(packet, type=sort)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise DefinitionError("the datagram is no announcement", code="beacon.malformed") from error
    texts = (beacon.name, beacon.model, beacon.serial, beacon.driver, beacon.key, beacon.signature)
    is_whole = (
        beacon.labweb == 1
        and 0 < beacon.port < 65536
        and _SCHEME.fullmatch(beacon.scheme) is not None
        and bool(beacon.name.strip())
        and all(len(text) <= LONGEST_TEXT and is_legible(text) for text in texts)
        and bool(beacon.key) == bool(beacon.signature)
        and (not beacon.key or is_key(beacon.key))
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
    """Tell whether a sighting may be kept: known source, a key or none, short legible texts."""
    texts = (one.address, one.name, one.model, one.serial, one.public_key, one.driver)
    is_short = all(len(text) <= 2 * LONGEST_TEXT and is_legible(text) for text in texts)
    has_key_or_none = not one.public_key or is_key(one.public_key)
    return one.source in SOURCES and bool(one.address) and is_short and has_key_or_none


def is_legible(text: str) -> bool:
    """Tell whether a person sees all of a text, and nothing but it.

    No control signs and none that turn the direction of writing, none that show nothing, no
    towers of accents, and no blanks but one between two words: two texts that look the same
    would be two serial numbers.
    """
    run = 0
    for sign in unicodedata.normalize("NFC", text):
        run = run + 1 if unicodedata.category(sign) in {"Mn", "Me"} else 0
        if run > _MOST_MARKS:
            return False
    is_shown = text.isprintable() and _UNSEEN.search(text) is None
    return is_shown and text == unicodedata.normalize("NFC", " ".join(text.split()))


def legible(text: str) -> str:
    """Return what USB says of itself as a text that may be kept; "" where it cannot be read."""
    plain = unicodedata.normalize("NFC", " ".join(text.split()))[:LONGEST_TEXT].rstrip()
    return plain if is_legible(plain) else ""


def is_key(text: str) -> bool:
    """Tell whether a text is an Ed25519 key, written in the one way in which it may be.

    Base64 has several ways to write the same bytes: a key that was rejected would come back
    as another.
    """
    try:
        raw = base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        return False
    return len(raw) == _KEY_BYTES and base64.b64encode(raw).decode() == text


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
