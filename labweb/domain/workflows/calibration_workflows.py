"""The workflows that calibrate, drawn as a person would draw them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any
from uuid import UUID

SCHEMA = "labweb.workflow/1"
_ACROSS, _DOWN = 260, 120


def weighing_ids(place: int) -> tuple[str, str, str]:
    """Return the ids of the steps of one weighing: before, move, after.

    Example:
        >>> weighing_ids(0)
        ('before-1', 'move-1', 'after-1')
    """
    return f"before-{place + 1}", f"move-{place + 1}", f"after-{place + 1}"


def weighing_order(levels: Sequence[float], repeats: int) -> list[float]:
    """Return the level of each weighing: every level in turn, so that drift hits all alike.

    Example:
        >>> weighing_order([100.0, 500.0], 2)
        [100.0, 500.0, 100.0, 500.0]
    """
    return [level for _ in range(repeats) for level in levels]


def gravimetric_workflow(
    name: str,
    *,
    pump: UUID,
    balance: UUID,
    source: UUID,
    target: UUID,
    volumes_ul: Sequence[float],
) -> dict[str, Any]:
    """Draw the weighings of a pump: weigh, move water onto the balance, weigh.

    Source:
        ISO 8655-6:2022, 10, 50 and 100 % of the nominal volume, with evaporation seen between
        the weighings.
    """
    steps: list[dict[str, Any]] = []
    for place, volume_ul in enumerate(volumes_ul):
        before, move, after = weighing_ids(place)
        moved = {
            "source": str(source),
            "target": str(target),
            "volume": f"{volume_ul:.1f} uL",
            "pump": str(pump),
        }
        weighed = {"balance": str(balance)}
        row = [(before, "weigh", weighed), (move, "transfer", moved), (after, "weigh", weighed)]
        steps += _placed(row, place)
    return _in_a_row(name, steps)


def reading_id(buffer: int, reading: int) -> str:
    """Return the id of the step that reads a probe.

    Example:
        >>> reading_id(0, 2)
        'read-1-3'
    """
    return f"read-{buffer + 1}-{reading + 1}"


def buffer_workflow(  # noqa: PLR0913 - what such a row of readings is made of; all keywords
    name: str,
    *,
    pump: UUID,
    probe: UUID,
    vessel: UUID,
    waste: UUID,
    sources: Sequence[UUID],
    volume_ul: float,
    dead_ul: float,
    settle_s: float,
    repeats: int,
) -> dict[str, Any]:
    """Draw the readings of a probe: rinse with the buffer, fill, let it stand, read, empty.

    The vessel is empty at first; what it cannot give stays in it from the first filling on.

    Source:
        Buck et al., Pure Appl. Chem. 74 (2002) 2169, 9.3: two or three buffers, each after a
        rinse with itself.
    """
    moved = {"volume": f"{volume_ul:g} uL", "pump": str(pump), "target": str(vessel)}
    emptied = {"source": str(vessel), "target": str(waste), "pump": str(pump)}
    steps: list[dict[str, Any]] = []
    for place, source in enumerate(sources):
        number, filled = place + 1, {**moved, "source": str(source)}
        first_ul = volume_ul if place else volume_ul - dead_ul
        row: list[tuple[str, str, dict[str, Any]]] = [
            (f"rinse-{number}", "transfer", filled),
            (f"drain-{number}", "transfer", {**emptied, "volume": f"{first_ul:g} uL"}),
            (f"fill-{number}", "transfer", filled),
            (f"settle-{number}", "wait", {"duration": f"{settle_s:g} s"}),
        ]
        row += [
            (reading_id(place, reading), "measure_ph", {"transmitter": str(probe)})
            for reading in range(repeats)
        ]
        row.append((f"empty-{number}", "transfer", {**emptied, "volume": moved["volume"]}))
        steps += _placed(row, place)
    return _in_a_row(name, steps)


def comparison_ids(set_point: int, reading: int) -> tuple[str, str]:
    """Return the ids of the steps that hold a set point, and then read the reference.

    Example:
        >>> comparison_ids(0, 2)
        ('hold-1-3', 'read-1-3')
    """
    place = f"{set_point + 1}-{reading + 1}"
    return f"hold-{place}", f"read-{place}"


def thermal_workflow(  # noqa: PLR0913 - what such a comparison is made of; all keywords
    name: str,
    *,
    heater: UUID,
    thermometer: UUID,
    vessel: UUID,
    set_points_c: Sequence[float],
    settle_s: float,
    repeats: int,
    tolerance_c: float,
    stir_speed_rpm: float | None,
) -> dict[str, Any]:
    """Draw the comparison of a heater's probe: reach, then hold and read in turn, then off.

    Source:
        EURAMET Calibration Guide 13: readings at held set points over the range that is used.
    """
    bring: dict[str, Any] = {"vessel": str(vessel)}
    if stir_speed_rpm is not None:
        bring["stir_speed"] = f"{stir_speed_rpm:g} rpm"
    read = {"device": str(thermometer), "action": "measure"}
    steps: list[dict[str, Any]] = []
    for place, set_point_c in enumerate(set_points_c):
        args = {
            "duration_s": settle_s,
            "temperature_c": set_point_c,
            "tolerance_c": tolerance_c,
        }
        hold = {"device": str(heater), "action": "hold", "args": args}
        reached = {**bring, "temperature": f"{set_point_c:g} °C"}
        row: list[tuple[str, str, dict[str, Any]]] = [(f"reach-{place + 1}", "heat_chill", reached)]
        for reading in range(repeats):
            hold_id, read_id = comparison_ids(place, reading)
            row += [(hold_id, "device_action", hold), (read_id, "device_action", read)]
        steps += _placed(row, place)
    off = [("off", "stop_heat_stir", {"vessel": str(vessel)})]
    return _in_a_row(name, [*steps, *_placed(off, len(set_points_c))])


def _placed(row: Sequence[tuple[str, str, dict[str, Any]]], place: int) -> list[dict[str, Any]]:
    """Put the steps of a row beside each other."""
    return [
        {
            "id": step_id,
            "kind": kind,
            "params": params,
            "position": {"x": column * _ACROSS, "y": place * _DOWN},
        }
        for column, (step_id, kind, params) in enumerate(row)
    ]


def _in_a_row(name: str, steps: list[dict[str, Any]]) -> dict[str, Any]:
    edges = [
        {
            "id": f"e{number}",
            "source": first["id"],
            "source_port": "done",
            "target": second["id"],
            "target_port": "start",
        }
        for number, (first, second) in enumerate(pairwise(steps), start=1)
    ]
    return {"schema": SCHEMA, "name": name, "steps": steps, "edges": edges}
