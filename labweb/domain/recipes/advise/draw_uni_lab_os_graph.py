"""A Uni-Lab-OS graph that is changed on paper: nodes and links come in, ports are found.

Source:
    Node and link fields, classes and port names of the published Uni-Lab-OS stations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.graph.elements import NL_PER_ML, ElementRole
from labweb.domain.graph.lab_file.uni_lab_os.node_liquid import nl_per_unit
from labweb.domain.graph.rig.nodes_as_elements import element_of
from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing, DrawnPort, NotDrawnError
from labweb.domain.recipes.on_rig.equipment import COLLECT, GASES, size_nl
from labweb.domain.resources.exact_volumes import from_nl

VALVE_PORTS = 8
"""Positions of a valve that is added.

Source:
    `positions` of the multiway valves in the published stations."""

_COMMON = "transferpump"
"""Port of a valve that its pump is joined to."""

_TOP = "top"
_NAMED = frozenset(("in", "out", "evaporate", COLLECT))
"""Ports that a change names as they are read."""


@dataclass(frozen=True, slots=True)
class _Word:
    """How such a graph says what a Chemputer graph says by a class."""

    class_: str
    type: str = "device"
    port: str = _TOP
    """Where its only tube is, or what joins it to a vessel that it acts on."""

    link: str = "fluid"
    config: tuple[tuple[str, Any], ...] = ()


_HEATS = ("virtual_heatchill", "device", "heatchill", "mechanical")
_WORDS: Mapping[str, _Word] = {
    "ChemputerFlask": _Word("container", "flask"),
    "ChemputerReactor": _Word("container", "reactor"),
    "ChemputerWaste": _Word("container", "waste"),
    "ChemputerSeparator": _Word("virtual_separator", port="bottomphaseout"),
    "ChemputerValve": _Word("virtual_multiway_valve", config=(("positions", VALVE_PORTS),)),
    "ChemputerPump": _Word("virtual_transfer_pump", port=_COMMON),
    "ChemputerCartridge": _Word("virtual_column"),
    "IKARV10": _Word("virtual_rotavap", config=(("max_temp", 180.0),)),
    "CVC3000": _Word("virtual_vacuum_pump", port="vacuumpump"),
    "HeiTORQUE_100": _Word("virtual_stirrer", port="stirrer", link="mechanical"),
    "heater_chiller": _Word(*_HEATS),
    "JULABOCF41": _Word(*_HEATS, (("min_temp", -40.0), ("max_temp", 100.0))),
    "IKARCTDigital": _Word(*_HEATS, (("min_temp", 18.0), ("max_temp", 360.0))),
}
"""Class as a change says it → node of a station. What is not here the published stations have no
class for, or no port by which what is drawn leaves: it is not drawn."""

_GAS = _Word("virtual_gas_source", port="gassource")
_BY_CLASS = {word.class_: word for word in (*_WORDS.values(), _GAS)}
_CONFIG = {
    "max_volume": "max_volume",
    "min_temp": "min_temp",
    "max_temp": "max_temp",
    "takes": "takes",
}


class UniDrawing(Drawing):
    """A copy of a Uni-Lab-OS graph. A flask of a reagent comes full; a link conducts both ways."""

    common = _COMMON

    @property
    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the nodes by id: their class, and their size in millilitres."""
        return {key: _view(node) for key, node in self._entries.items()}

    @property
    def _entries(self) -> dict[str, dict[str, Any]]:
        return {str(node["id"]): node for node in self.graph["nodes"]}

    def add(self, wanted: str, class_: str, **fields: object) -> str:
        """Add a node and return its id.

        Raises:
            NotDrawnError: The published stations have no class for it.
        """
        word = _WORDS.get(class_)
        if word is None:
            raise NotDrawnError(class_)
        chemical = str(fields.get("chemical") or "")
        gas = GASES.get(chemical.lower(), "")
        if gas and "max_volume" in fields:
            raise NotDrawnError(gas)  # Gas comes from a source of its own.
        word = _GAS if gas else word
        config = dict(word.config)
        config |= {_CONFIG[name]: value for name, value in fields.items() if name in _CONFIG}
        data: dict[str, Any] = {"gas_type": gas} if gas else {}
        if class_ == "ChemputerCartridge":
            config |= {"column_type": chemical, "chemical": chemical}
            chemical = ""
        key = self._node(wanted, word, config, data)
        if chemical and not gas:
            self.alter(key, chemical=chemical)
        return key

    def _node(self, wanted: str, word: _Word, config: dict[str, Any], data: dict[str, Any]) -> str:
        key = self._new_key(wanted)
        parent = next((n.get("parent") for n in self.graph["nodes"] if _is_valve(n)), None)
        above = self._entries.get(str(parent))
        node: dict[str, Any] = {"id": key, "name": key, "children": [], "parent": parent}
        node |= {"type": word.type, "class": word.class_, "position": {"x": 0, "y": 0, "z": 0}}
        self.graph["nodes"].append(node | {"config": config, "data": data})
        if above is not None and isinstance(above.get("children"), list):
            above["children"].append(key)
        return key

    def alter(self, key: str, **fields: object) -> None:
        """Change the size of a vessel, or fill it with a liquid."""
        node = self._entries[key]
        size_ml, chemical = fields.get("max_volume"), fields.get("chemical")
        if isinstance(size_ml, int | float):
            _resize(node, size_ml)
        held = (node.get("data") or {}).get("liquid")
        if isinstance(chemical, str) and chemical:
            amount = {"liquid_volume": node["config"]["max_volume"]}
            node["data"] = {"liquid": [{"liquid_type": chemical, **amount}]}
        elif isinstance(size_ml, int | float) and key in self.added and held:
            held[0]["liquid_volume"] = size_ml
        self._rig = None

    def lay(self, source: DrawnPort, target: DrawnPort, *, both: bool = False) -> None:  # noqa: ARG002
        """Lay a tube; here each conducts both ways."""
        self._join(source.key, target.key, "fluid", (self._end(source), self._end(target)))

    def attach(self, device: str, vessel: str) -> None:
        """Join a device to a vessel that it acts on."""
        word = _BY_CLASS[self.nodes[device]["class"]]
        far = _TOP if word.link == "fluid" else "bind"
        self._join(device, vessel, word.link, (word.port, far))

    def _join(self, source: str, target: str, type_: str, ports: tuple[str, str]) -> None:
        wanted, taken = f"link_{source}_{target}", {str(link.get("id")) for link in self.links}
        key, number = wanted, 2
        while key in taken:
            key, number = f"{wanted}_{number}", number + 1
        ends = {"id": key, "source": source, "target": target, "type": type_}
        self.links.append(ends | {"port": {source: ports[0], target: ports[1]}})
        self._rig = None

    def _end(self, port: DrawnPort) -> str:
        """Return the port as such a graph calls it: a container has one for all its tubes."""
        class_ = self.nodes[port.key]["class"]
        if port.port in _NAMED or _is_valve({"class": class_}):
            return port.port
        word = _BY_CLASS.get(class_)
        return port.port if word is None else word.port

    def free_port_of(self, vessel: str) -> DrawnPort:
        """Return the port of a vessel that tubes are joined to; it takes several."""
        return DrawnPort(vessel, _TOP)

    def gas_place(self, vessel: str) -> DrawnPort:
        """Return where a tube for gas is joined to a vessel."""
        return DrawnPort(vessel, _TOP)

    def vacuum_lines(self) -> list[str]:
        """Return the vacuum pumps that a valve can be joined to."""
        return sorted(e.key for e in self.rig().elements if e.role is ElementRole.VACUUM)

    def new_vacuum(self, vessel: str) -> tuple[str, ...]:
        """Add a vacuum pump, which is a line by itself."""
        return (self.add(f"vacuum_{vessel}", "CVC3000"),)

    def valve_ports(self, key: str) -> tuple[str, ...]:
        """Return the ports of a valve beside the common one; none when nobody says how many."""
        count = (self._entries[key].get("config") or {}).get("positions")
        if not isinstance(count, int) or isinstance(count, bool):
            return ()
        return tuple(str(number) for number in range(1, count + 1))

    def idle_flask(self) -> None:
        """Return none: what is in a flask of a station is somebody's."""

    def is_flask(self, node: Mapping[str, Any]) -> bool:
        """Tell whether a node is a container that may be moved to another valve."""
        return str(node.get("class")) == "container"

    def size(self, key: str) -> str:
        """Return how large a vessel is and what is to be filled in, as text before its name."""
        found = super().size(key)
        is_full = bool((self._entries[key].get("data") or {}).get("liquid"))
        return f"{found}, full," if found and is_full and key in self.added else found

    def _move_tubes(self, flask: str, old: DrawnPort, new: DrawnPort) -> None:
        for link in self.links:
            ends = {str(link["source"]), str(link["target"])}
            if ends == {old.key, flask} and isinstance(link.get("port"), Mapping):
                link["port"] = {flask: link["port"].get(flask, _TOP), new.key: new.port}
                for end in ("source", "target"):
                    if str(link[end]) == old.key:
                        link[end] = new.key
        self._rig = None


def _is_valve(node: Mapping[str, Any]) -> bool:
    return "valve" in str(node.get("class"))


def _resize(node: dict[str, Any], size_ml: float) -> None:
    """Write the size of a vessel in its `config`, in the unit of the node, and nowhere else."""
    config = node.get("config")
    node["config"] = config = dict(config) if isinstance(config, Mapping) else {}
    for place in (node, config, node.get("data")):
        if isinstance(place, dict):
            for name in ("max_volume", "capacity_ul"):
                place.pop(name, None)
    config["max_volume"] = size_ml * (NL_PER_ML // nl_per_unit(config))


def _view(node: Mapping[str, Any]) -> dict[str, Any]:
    found = {"id": str(node["id"]), "class": str(node.get("class") or "")}
    found_nl = size_nl(element_of(found["id"], node))
    return found if found_nl is None else found | {"max_volume": from_nl(found_nl, NL_PER_ML)}
