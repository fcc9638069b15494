"""Colours by role, light and dark; the same roles as the page's tokens."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Literal

Theme = Literal["light", "dark"]
Rgb = tuple[int, int, int]

THEMES: tuple[Theme, ...] = ("light", "dark")


class Role(StrEnum):
    """What a surface is, apart from its colour."""

    GROUND = "ground"
    """Behind everything."""

    SLAB = "slab"
    """Bench, deck, tray."""

    BODY = "body"
    """Housing of an instrument."""

    TOP = "top"
    """Its lit parts: lids, plates, caps."""

    DARK = "dark"
    """Its displays, knobs and edges."""

    GLASS = "glass"
    LIQUID = "liquid"
    TUBE = "tube"
    RUN = "run"
    DOUBT = "doubt"
    NEED = "need"
    OFF = "off"


# Rings of the dark theme are a step deeper than the page's: the scene's lights brighten them.
_COLOURS: Mapping[Theme, Mapping[Role, str]] = {
    "light": {
        Role.GROUND: "EBEEF1",
        Role.SLAB: "F2F4F6",
        Role.BODY: "D9DEE4",
        Role.TOP: "F2F4F6",
        Role.DARK: "9AA4B1",
        Role.GLASS: "C4CBD3",
        Role.LIQUID: "A9BFD6",
        Role.TUBE: "9AA4B1",
        Role.RUN: "0B5CAD",
        Role.DOUBT: "9A1B6B",
        Role.NEED: "F2B33D",
        Role.OFF: "566170",
    },
    "dark": {
        Role.GROUND: "0F1216",
        Role.SLAB: "2D353F",
        Role.BODY: "4A5460",
        Role.TOP: "5C6875",
        Role.DARK: "1A2027",
        Role.GLASS: "AEBBCB",
        Role.LIQUID: "51708F",
        Role.TUBE: "6E7A89",
        Role.RUN: "4F93E0",
        Role.DOUBT: "D65FA8",
        Role.NEED: "F5C265",
        Role.OFF: "A7B1BE",
    },
}

GLASS_OPACITY: Mapping[Theme, float] = {"light": 0.45, "dark": 0.2}
GHOST_OPACITY = 0.3
"""Bodies of devices that are offline."""

_TINTS: Mapping[Theme, tuple[str, ...]] = {
    "light": ("A9BFD6", "A9CBC4", "9FC6DC", "B9BBDD", "BFC8D0"),
    "dark": ("4F6478", "4C6560", "4D6A78", "5A5C72", "5C6670"),
}
"""Liquids by lot: near grey, so that a full bench with nothing wrong stays quiet."""


def rgb(hexadecimal: str) -> Rgb:
    """Read six hexadecimal digits."""
    red, green, blue = bytes.fromhex(hexadecimal)
    return red, green, blue


def colour(theme: Theme, role: Role) -> Rgb:
    """Return the colour of a role."""
    return rgb(_COLOURS[theme][role])


def liquid(theme: Theme, shares: Mapping[int, float]) -> Rgb:
    """Mix the tints of the lots in a vessel by volume.

    Args:
        theme: Light or dark.
        shares: Volume by the lot's number in the lab; the number picks the tint.
    """
    total = sum(shares.values())
    if total <= 0:
        return colour(theme, Role.LIQUID)
    tints = _TINTS[theme]
    mixed = [0.0, 0.0, 0.0]
    for number, volume in shares.items():
        for channel, value in enumerate(rgb(tints[number % len(tints)])):
            mixed[channel] += value * volume / total
    return round(mixed[0]), round(mixed[1]), round(mixed[2])
