"""A rig being invented: parts by role and hoses between their ports, written in any file form."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import escape, quoteattr

_WORDS = (
    "amber",
    "birch",
    "cedar",
    "delta",
    "ember",
    "fjord",
    "garnet",
    "harbor",
    "indigo",
    "juniper",
    "kelp",
    "lotus",
    "maple",
    "nickel",
    "onyx",
    "pine",
    "quartz",
    "river",
    "slate",
    "topaz",
    "umber",
    "violet",
    "willow",
    "xenon",
    "yarrow",
    "zinc",
)
_MISLEADING = (
    "flask_2,6-lutidine",
    "waste valve",
    "pump bottle",
    "solenoid_flask",
    "flask 3 M HCl",
    "Kolben_Äther",
    "瓶_1",
    "serial_flask",
    "default",
    "transferpump",
    "12",
)
_CHEMPUTER_CLASS = {
    "flask": ("ChemputerFlask", "flask"),
    "waste": ("ChemputerWaste", "waste"),
    "reactor": ("ChemputerReactor", "reactor"),
    "separator": ("ChemputerSeparator", "separator"),
    "filter": ("ChemputerFilter", "filter"),
    "rotavap": ("IKARV10", "rotavap"),
    "valve": ("ChemputerValve", "valve"),
    "pump": ("ChemputerPump", "pump"),
    "vacuum": ("ChemputerVacuum", "vacuum"),
    "cartridge": ("ChemputerCartridge", "cartridge"),
    "stirrer": ("HeiTORQUE_100", "stirrer"),
    "serial": ("ConductivitySensor", "conductivity_sensor"),
}
_UNILAB_CLASS = {
    "rotavap": "virtual_rotavap",
    "separator": "virtual_separator",
    "valve": "virtual_multiway_valve",
    "pump": "virtual_transfer_pump",
    "pump_valve": "syringe_pump_with_valve.runze.SY03B-T08",
    "solenoid": "virtual_solenoid_valve",
    "vacuum": "virtual_vacuum_pump",
    "gas": "virtual_gas_source",
    "column": "virtual_column",
    "stirrer": "virtual_stirrer",
    "serial": "serial",
}
VESSELS = {"flask", "waste", "reactor", "separator", "filter", "rotavap"}


@dataclass(frozen=True)
class Part:
    """One node."""

    name: str
    role: str
    max_volume: float | None = None
    style: str = ""
    """How the ports of a valve are named."""


@dataclass(frozen=True)
class Link:
    """One edge of the file."""

    a: str
    a_port: str
    b: str
    b_port: str
    medium: str = "fluid"
    is_two_way: bool = True


@dataclass
class Draft:
    """Parts and links, in no order."""

    dice: random.Random
    is_chemputer: bool
    parts: list[Part] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    _names: set[str] = field(default_factory=set)

    def add(self, role: str, max_volume: float | None = None, style: str = "") -> str:
        """Add a part under a name that says nothing, or the wrong thing; return the name."""
        name = self._name(role)
        self._names.add(name)
        self.parts.append(Part(name, role, max_volume, style))
        return name

    def _name(self, role: str) -> str:
        while True:
            word = self.dice.choice(_WORDS)
            names = [f"{word}_{self.dice.randrange(100)}", f"{role}_{word}", f"{word} {role}"]
            names.append(self.dice.choice(_MISLEADING))
            name = self.dice.choices(names, (5, 3, 1, 1))[0]
            if name not in self._names:
                return name

    def join(
        self,
        a: tuple[str, str],
        b: tuple[str, str],
        *,
        medium: str = "fluid",
        is_two_way: bool = True,
    ) -> None:
        """Link two ends."""
        self.links.append(Link(*a, *b, medium=medium, is_two_way=is_two_way))

    def role(self, name: str) -> str:
        """Return the role of a part."""
        return next(part.role for part in self.parts if part.name == name)

    def vessels(self) -> list[str]:
        """Name the vessels."""
        return [part.name for part in self.parts if part.role in VESSELS]

    def text(self, form: str) -> str:
        """Write the file in one of the forms `unilab`, `json`, `graphml`, `yed`."""
        self.dice.shuffle(self.parts)
        self.dice.shuffle(self.links)
        if form == "unilab":
            return self._unilab()
        if form == "json":
            return self._chemputer_json()
        return self._graphml(is_yed=form == "yed")

    def _unilab(self) -> str:
        nodes = [_unilab_node(part) for part in self.parts]
        links = []
        for number, link in enumerate(self.links):
            (a, pa, b, pb) = link.a, link.a_port, link.b, link.b_port
            if self.dice.random() < 0.5:
                a, pa, b, pb = b, pb, a, pa
            medium = link.medium
            if medium == "fluid":
                medium = self.dice.choice(("fluid", "physical"))
            edge: dict[str, Any] = {"id": f"link_{number}", "source": a, "target": b}
            edge["type"] = medium
            edge["port"] = {a: pa, b: pb} if self.dice.random() < 0.8 else f"({pa},{pb})"
            links.append(edge)
        return json.dumps({"nodes": nodes, "links": links}, ensure_ascii=False, indent=1)

    def _edges(self) -> list[tuple[str, str, str]]:
        """List source, target and port pair of a directed graph."""
        edges = []
        for link in self.links:
            edges.append((link.a, link.b, f"({link.a_port},{link.b_port})"))
            if link.is_two_way:
                edges.append((link.b, link.a, f"({link.b_port},{link.a_port})"))
        self.dice.shuffle(edges)
        return edges

    def _chemputer_json(self) -> str:
        nodes = [
            {"id": part.name, "name": part.name, **_chemputer_data(part)} for part in self.parts
        ]
        links = [{"source": a, "target": b, "port": port} for a, b, port in self._edges()]
        return json.dumps({"nodes": nodes, "links": links}, ensure_ascii=False, indent=1)

    def _graphml(self, *, is_yed: bool) -> str:
        ids = {part.name: f"n{i}" if is_yed else part.name for i, part in enumerate(self.parts)}
        keys = ["class", "type", "max_volume", "chemical"]
        head = [
            f'<key id="d{i}" for="node" attr.name="{key}" attr.type="string"/>'
            for i, key in enumerate(keys)
        ]
        head.append('<key id="d8" for="node" yfiles.type="nodegraphics"/>')
        head.append('<key id="d9" for="edge" attr.name="port" attr.type="string"/>')
        body = []
        for part in self.parts:
            data = _chemputer_data(part)
            inner = "".join(
                f'<data key="d{i}">{escape(str(data[key]))}</data>'
                for i, key in enumerate(keys)
                if key in data
            )
            if is_yed:
                label = f"<y:NodeLabel>{escape(part.name)}</y:NodeLabel>"
                inner += f'<data key="d8"><y:ShapeNode>{label}</y:ShapeNode></data>'
            body.append(f"<node id={quoteattr(ids[part.name])}>{inner}</node>")
        for a, b, port in self._edges():
            ends = f"source={quoteattr(ids[a])} target={quoteattr(ids[b])}"
            body.append(f'<edge {ends}><data key="d9">{port}</data></edge>')
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            '<graphml xmlns="http://graphml.graphdrawing.org/xmlns" '
            'xmlns:y="http://www.yworks.com/xml/graphml" '
            'xmlns:yfiles="http://www.yworks.com/xml/yfiles">'
            + "".join(head)
            + '<graph id="G" edgedefault="directed">'
            + "\n".join(body)
            + "</graph></graphml>\n"
        )


def _chemputer_data(part: Part) -> dict[str, Any]:
    name, kind = _CHEMPUTER_CLASS[part.role]
    data: dict[str, Any] = {"class": name, "type": kind}
    if part.max_volume is not None:
        data["max_volume"] = part.max_volume
    if part.role == "flask":
        data["chemical"] = "water"
    return data


def _unilab_node(part: Part) -> dict[str, Any]:
    is_held = part.role in VESSELS and part.role not in _UNILAB_CLASS
    config: dict[str, Any] = {}
    if part.max_volume is not None:
        config["max_volume"] = part.max_volume
    if part.role in {"valve", "pump_valve"}:
        config["positions"] = 8
    node: Mapping[str, Any] = {
        "id": part.name,
        "name": part.name,
        "children": [],
        "parent": None,
        "type": "container" if is_held else "device",
        "class": "container" if is_held else _UNILAB_CLASS[part.role],
        "position": {"x": 0, "y": 0, "z": 0},
        "config": config,
        "data": {},
    }
    return dict(node)
