"""What stands on the deck of an OT-2, and what is refused before anything is sent to it.

Source:
    Opentrons, HTTP API of the robot server (`/openapi.json`): slots, names of definitions, wells.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from labweb.domain.errors import DefinitionError, PreconditionError

_SLOT = re.compile(r"[1-9]|1[01]")
_DEFINITION = re.compile(r"([a-z0-9_.-]{1,100})/([a-z0-9_.-]{1,200})/([1-9][0-9]{0,3})")
_WELL = re.compile(r"[A-P](?:[1-9]|1[0-9]|2[0-4])")


def parse_deck(deck: Mapping[str, str]) -> dict[str, tuple[str, str, int]]:
    """Read what stands on a deck: namespace, name and version, by slot.

    Raises:
        DefinitionError: A slot or a definition is malformed.

    Example:
        >>> parse_deck({"1": "opentrons/opentrons_96_tiprack_300ul/1"})
        {'1': ('opentrons', 'opentrons_96_tiprack_300ul', 1)}
    """
    found = {}
    for slot, text in deck.items():
        told = _DEFINITION.fullmatch(text)
        if told is None or not _SLOT.fullmatch(slot):
            raise DefinitionError(
                f"deck: {slot!r:.20}: {text!r:.80} is no slot of 1 to 11 with a definition "
                "namespace/name/version",
                code="driver.config",
            )
        found[slot] = (told[1], told[2], int(told[3]))
    return found


def well_in(labware: Mapping[str, str], slot: str, well: str) -> dict[str, str]:
    """Return how a command names a well; `labware` has the id of what stands in each slot.

    Raises:
        PreconditionError: Nothing stands in the slot, or it is no well.

    Example:
        >>> well_in({"2": "lab-2"}, "2", "A1")
        {'labwareId': 'lab-2', 'wellName': 'A1'}
    """
    if slot not in labware:
        raise PreconditionError(
            f"slot {slot!r:.20} was asked for; the deck has {sorted(labware)}",
            code="device.limit",
        )
    if not _WELL.fullmatch(well):
        raise PreconditionError(f"{well!r:.20} is no well: A1 to P24", code="device.limit")
    return {"labwareId": labware[slot], "wellName": well}


def refuse_long_stroke(volume_ul: float, rate_ul_s: float, limit_s: float) -> None:
    """Refuse a stroke of the plunger that would be stopped before its end.

    Raises:
        PreconditionError: It takes longer than a command may.
    """
    if volume_ul / rate_ul_s > limit_s:
        raise PreconditionError(
            f"{volume_ul:g} µL at {rate_ul_s:g} µL/s take {volume_ul / rate_ul_s:g} s; a command "
            f"of this device may take {limit_s:g} s: go faster, or in smaller volumes",
            code="device.limit",
            context={"limit_s": limit_s},
        )
