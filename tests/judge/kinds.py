"""What a node is to a liquid, from its class and type alone; the tables of the judge.

Chemputer (class names of the published rigs, lower case, underscores left out):

    valve               rotary, common port -1, outer ports 0 to 5
    pump                syringe, port 0, volume in `max_volume`, mL
    flask, waste, reactor, separator, filter, collectionflask, rotavap
                        vessels (also the rotary evaporators IKARV10, RV10Rotovap, R300Rotovap)
    all others          no place for liquid: vacuum, cartridge, column, manifold, sensors, heaters

Uni-Lab-OS (`type` first, then words in `class`, first match wins):

    type container, well, tube, vial, bottle, flask, vessel      vessel
    vacuum | gas | controller | peristaltic                      other
    solenoid                                                     solenoid
    pump and valve                                               syringe with a valve built in
    valve                                                        rotary valve
    pump                                                         syringe
    rotavap | separator | filter | reactor                       vessel
    anything else                                                other

The common port of a Uni-Lab-OS valve is the one named as the pump's: `transferpump` (registry of
Uni-Lab-OS), `multiway-valve-inlet` (its older stations), or one of the plain words below. A pump's
`positions` or a valve's, a whole number n, declares the ports 1 to n.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tests.judge.rig import Device, Kind

NL_PER_ML = 1_000_000

_CHEMPUTER = {
    "valve": Kind.VALVE,
    "pump": Kind.PUMP,
    **dict.fromkeys(
        ("flask", "waste", "reactor", "separator", "filter", "collectionflask", "rotavap"),
        Kind.VESSEL,
    ),
}
_EVAPORATORS = {"ikarv10", "rv10rotovap", "r300rotovap"}
_CHEMPUTER_PORTS = frozenset("012345")
_HOLDERS = {"container", "well", "tube", "vial", "bottle", "flask", "vessel"}
_DRY_WORDS = ("vacuum", "gas", "controller", "peristaltic")
_VESSEL_WORDS = ("rotavap", "rotovap", "separator", "filter", "reactor")
COMMON_NAMES = (
    "-1",
    "transferpump",
    "multiway-valve-inlet",
    "common",
    "com",
    "pump",
    "syringe",
    "inlet",
    "in",
)


def is_chemputer_class(name: object) -> bool:
    """Tell whether a class name is one of the Chemputer's own."""
    return isinstance(name, str) and name.lower().startswith("chemputer")


def chemputer_device(node_id: str, node: Mapping[str, Any]) -> Device:
    """Return a node of a Chemputer graph."""
    name = str(node.get("class") or "")
    plain = name.lower().replace("_", "")
    kind = _CHEMPUTER.get(plain.removeprefix("chemputer"), Kind.OTHER)
    if not plain.startswith("chemputer"):
        kind = Kind.VESSEL if plain in _EVAPORATORS else Kind.OTHER
    if kind is Kind.VALVE:
        return Device(node_id, kind, name, common="-1", declared=_CHEMPUTER_PORTS)
    volume = capacity_nl(node.get("max_volume")) if kind is Kind.PUMP else None
    return Device(node_id, kind, name, capacity_nl=volume)


def unilab_device(node_id: str, node: Mapping[str, Any], linked: Iterable[str]) -> Device:
    """Return a node of a Uni-Lab-OS graph; `linked` are its ports with links of any medium."""
    name = str(node.get("class") or "")
    raw = node.get("config")
    config = raw if isinstance(raw, Mapping) else {}
    kind = unilab_kind(name.lower(), str(node.get("type") or "").lower())
    positions = config.get("positions")
    count = positions if isinstance(positions, int) and 0 < positions < 1000 else 0
    declared = frozenset(str(number) for number in range(1, count + 1))
    if kind is Kind.VALVE:
        return Device(node_id, kind, name, common=_common_of(set(linked)), declared=declared)
    if kind in {Kind.PUMP, Kind.PUMP_VALVE}:
        volume = capacity_nl(config.get("max_volume", node.get("max_volume")))
        return Device(node_id, kind, name, capacity_nl=volume, declared=declared)
    return Device(node_id, kind, name)


def unilab_kind(name: str, node_type: str) -> Kind:
    """Return what a node of Uni-Lab-OS is, by its class and type in lower case."""
    if node_type in _HOLDERS:
        return Kind.VESSEL
    if any(word in name for word in _DRY_WORDS):
        return Kind.OTHER
    if "solenoid" in name:
        return Kind.SOLENOID
    if "pump" in name:
        return Kind.PUMP_VALVE if "valve" in name else Kind.PUMP
    if "valve" in name:
        return Kind.VALVE
    return Kind.VESSEL if any(word in name for word in _VESSEL_WORDS) else Kind.OTHER


def _common_of(linked: set[str]) -> str:
    found = [name for name in COMMON_NAMES if name in {port.lower() for port in linked}]
    if not found:
        return "-1"
    return next(port for port in sorted(linked) if port.lower() == found[0])


def capacity_nl(value: object) -> int | None:
    """Return a volume in mL as nanolitres; None when it is no positive number."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        volume = round(float(value) * NL_PER_ML)
    except (ValueError, OverflowError):
        return None
    return volume if volume > 0 else None
