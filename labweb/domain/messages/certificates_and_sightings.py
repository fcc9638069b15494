"""Frames of the uplink that are about identity: the host's next certificate, devices it sees."""

from __future__ import annotations

import msgspec

MOST_SIGHTINGS_PER_FRAME = 50


class Renew(msgspec.Struct, frozen=True, tag="renew", tag_field="t", kw_only=True):
    """Ask for the next certificate, in a session that the present key opened."""

    epoch: int
    csr: str
    """PKCS #10, PEM, for the next key."""


class Renewed(msgspec.Struct, frozen=True, tag="renewed", tag_field="t", kw_only=True):
    """The next certificate. The present one stays good until the next has opened a session."""

    certificate: str
    """PEM."""


class Sighting(msgspec.Struct, frozen=True, kw_only=True):
    """Something on the lab's wires that may be a device; whatever it says is a claim."""

    source: str
    """`beacon`, `serial` or `network`."""

    address: str
    """Where the host sees it, `tcp://192.168.1.10:5000`; the carrier's URL without options."""

    name: str = ""
    model: str = ""
    serial: str = ""
    public_key: str = ""
    """Ed25519, base64; it signed the announcement. Empty: nothing vouches for who it is."""

    driver: str = ""
    """Driver class that it asks for; a hint."""


class Sightings(msgspec.Struct, frozen=True, tag="sightings", tag_field="t", kw_only=True):
    """What the host has seen since the last frame, at most 50."""

    epoch: int
    found: list[Sighting]
