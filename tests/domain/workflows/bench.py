"""Small labs drawn in a few words, for tests of routing and planning."""

# ruff: noqa: ANN401 - builders hand on whatever they are given

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any
from uuid import UUID, uuid5

from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec, StatusSpec
from labweb.domain.graph.ports_and_connections import Connection, Medium, PhysicalGraph, PortRef
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.resources.resource_tree import Tree
from labweb.domain.workflows.compile_workflow import PlannerView

SPACE = UUID("7a3c1d52-4f7b-5a57-8a4c-2d9b6f2f0c11")


def id_of(key: str) -> UUID:
    return uuid5(SPACE, key)


def device_id_of(key: str) -> UUID:
    return uuid5(SPACE, f"device/{key}")


def _number(name: str, low: float | None = None, high: float | None = None) -> ParameterSpec:
    return ParameterSpec(name=name, type="number", minimum=low, maximum=high)


def _action(
    name: str, role: str, *parameters: ParameterSpec, recovery: Any = "R2", **rest: Any
) -> ActionSpec:
    return ActionSpec(
        name=name,
        role=role,
        parameters=parameters,
        recovery=recovery,
        **{"timeout_s": 3600.0} | rest,
    )


def _statuses(*names: str) -> tuple[StatusSpec, ...]:
    return tuple(StatusSpec(name=n, value=ParameterSpec(name=n, type="number")) for n in names)


def _spec(name: str, actions: tuple[ActionSpec, ...], *statuses: str) -> DriverSpec:
    return DriverSpec(
        class_name=name, module="", digest="0" * 64, actions=actions, statuses=_statuses(*statuses)
    )


_PORT = ParameterSpec(name="port_index", type="integer", minimum=1, maximum=12)
SELECT = _action("select_port", "valve", _PORT, recovery="R1")
_MOVE = (_number("volume_ul", 0.001, 100_000.0), _number("rate_ul_s", 0.001, 100_000.0))
PUMP_ACTIONS = (
    _action("initialize", "pump", operation="transfer"),
    _action("aspirate", "pump", *_MOVE, operation="transfer"),
    _action("dispense", "pump", *_MOVE, operation="transfer"),
)
PUMP = _spec("Pump", (*PUMP_ACTIONS, SELECT), "volume_ul", "is_initialized", "port_index")
BARE_PUMP = _spec("BarePump", PUMP_ACTIONS, "volume_ul", "is_initialized")
VALVE = _spec("Valve", (SELECT,), "port_index")
_TEMPERATURE = (_number("temperature_c", 0.0, 310.0), _number("tolerance_c", 0.1, 50.0))
HEATER = _spec(
    "Heater",
    (
        _action("heat_to", "heater_stirrer", *_TEMPERATURE, recovery="R1"),
        _action("hold", "heater_stirrer", _number("duration_s", 0.0), *_TEMPERATURE, recovery="R1"),
        _action("stop_heating", "heater_stirrer", recovery="R1"),
        _action("stir", "heater_stirrer", _number("speed_rpm", 0.0, 1500.0), recovery="R1"),
        _action("stop_stirring", "heater_stirrer", recovery="R1"),
    ),
    "temperature_c",
    "speed_rpm",
)
BALANCE = _spec(
    "Balance",
    (
        _action("weigh", "balance", operation="read", recovery="R1"),
        _action("tare", "balance", recovery="R3"),
    ),
    "mass_mg",
    "is_stable",
)
PH = _spec(
    "Ph",
    (_action("measure", "sensor", operation="read", recovery="R1"),),
    "value_ph",
    "temperature_c",
)
TIMER = _spec("Timer", (_action("wait", "timer", _number("duration_s", 0.0), recovery="R1"),))


@dataclass
class Bench:
    """A lab under construction; `view()` freezes it."""

    resources: list[Resource] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    devices: list[AdmittedDevice] = field(default_factory=list)
    states: dict[UUID, ResourceState] = field(default_factory=dict)
    densities: dict[LotId, float | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.add("lab", "lab", on=None)

    def add(
        self,
        key: str,
        kind: str,
        *,
        on: str | None = "lab",
        config: Mapping[str, Any] | None = None,
        **state: Any,
    ) -> UUID:
        parent = None if on is None else id_of(on)
        name = key.replace("_", " ").capitalize()
        self.resources.append(
            Resource(
                id=id_of(key),
                key=key,
                name=name,
                kind=kind,
                nature=KINDS[kind].nature,
                parent_id=parent,
                config=config or {},
            )
        )
        state = {"contents": {}, **state}
        self.states[id_of(key)] = ResourceState(
            id=id_of(key), name=name, kind=kind, parent_id=parent, **state
        )
        return id_of(key)

    def stand(self, key: str, on: str) -> None:
        """Put a resource elsewhere."""
        self.resources = [
            replace(one, parent_id=id_of(on)) if one.key == key else one for one in self.resources
        ]

    def vessel(
        self,
        key: str,
        holds_nl: int = 0,
        *,
        capacity_nl: int | None = 500_000_000,
        lot: str | None = None,
        density: float | None = 1.0,
        kind: str = "flask",
        **rest: Any,
    ) -> UUID:
        name = LotId(lot or key)
        self.densities.setdefault(name, density)
        contents = {name: holds_nl} if holds_nl else {}
        return self.add(key, kind, contents=contents, capacity_nl=capacity_nl, **rest)

    def device(self, key: str, spec: DriverSpec, nodes: Mapping[str, str], **config: Any) -> None:
        self.devices.append(
            AdmittedDevice(
                id=device_id_of(key),
                key=key,
                name=key.replace("_", " ").capitalize(),
                host_id=SPACE,
                spec=spec,
                transport="serial:///dev/null",
                config=config,
                nodes={role: id_of(node) for role, node in nodes.items()},
            )
        )

    def pump(
        self,
        number: int,
        ports: Mapping[int, tuple[str, int | None]],
        *,
        syringe_nl: int = 5_000_000,
        ready: bool = True,
        contents: Mapping[LotId, int] | None = None,
        **config: Any,
    ) -> None:
        """Add a pump with its valve; `ports` says which vessel each valve port joins."""
        pump, valve = f"pump_{number}", f"valve_{number}"
        self.add(
            pump,
            "syringe_pump",
            capacity_nl=syringe_nl,
            contents=dict(contents or {}),
            data={"is_initialized": True} if ready else {},
        )
        self.add(valve, "rotary_valve")
        self.tube(f"{pump}:outlet", f"{valve}:common", 0)
        for port, (vessel, dead_nl) in ports.items():
            self.tube(f"{valve}:{port}", f"{vessel}:", dead_nl)
        self.device(pump, PUMP, {"pump": pump, "valve": valve}, **config)

    def tube(
        self,
        source: str,
        target: str,
        dead_nl: int | None = 0,
        *,
        medium: Medium = Medium.LIQUID,
        two_way: bool = True,
    ) -> None:
        key = f"tube_{len(self.connections)}"
        ends = []
        for end in (source, target):
            name, _, port = end.partition(":")
            ends.append(PortRef(id_of(name), port))
        self.connections.append(
            Connection(
                id=id_of(key),
                key=key,
                source=ends[0],
                target=ends[1],
                medium=medium,
                is_two_way=two_way,
                dead_volume_nl=dead_nl,
            )
        )

    @property
    def tree(self) -> Tree:
        return Tree(tuple(self.resources))

    @property
    def graph(self) -> PhysicalGraph:
        return PhysicalGraph(tuple(self.connections))

    def view(self) -> PlannerView:
        return PlannerView(
            tree=self.tree,
            graph=self.graph,
            devices=tuple(self.devices),
            snapshot=dict(self.states),
            densities_mg_ul=dict(self.densities),
        )


def a_bench(**pump: Any) -> Bench:
    """Draw the bench most tests use.

    ::

        water ── 1│valve 1│common ── pump 1
        dye ──── 2│       │
        reactor  3│       │     reactor stands on heater 1
        flask ── 4│       │     flask stands on balance 1
    """
    bench = Bench()
    bench.add("heater_1", "heater_stirrer", config={"max_temperature_c": 150.0})
    bench.add("balance_1", "balance")
    bench.add("ph_1", "transmitter")
    bench.add("timer_1", "timer")
    bench.vessel("water", 400_000_000, kind="bottle", density=0.998)
    bench.vessel("dye", 50_000_000, kind="bottle", density=None)
    bench.vessel("reactor", on="heater_1", capacity_nl=100_000_000, kind="reactor")
    bench.vessel("flask", on="balance_1", capacity_nl=50_000_000)
    ports: dict[int, tuple[str, int | None]] = {
        1: ("water", 180_000), 2: ("dye", 120_000), 3: ("reactor", 150_000), 4: ("flask", None)
    }  # fmt: skip
    bench.pump(1, ports, **pump)
    bench.device("heater_1", HEATER, {"heater": "heater_1", "stirrer": "heater_1"})
    bench.device("balance_1", BALANCE, {"balance": "balance_1"})
    bench.device("ph_1", PH, {"transmitter": "ph_1"})
    bench.device("timer_1", TIMER, {"timer": "timer_1"})
    return bench


def step(step_id: str, kind: str, **params: Any) -> dict[str, Any]:
    return {"id": step_id, "kind": kind, "params": params}


def flow(*steps: dict[str, Any], edges: tuple[str, ...] = ()) -> dict[str, Any]:
    """Make a workflow; an edge is `"a.done>b.start"`, or `"a>b"` for order alone."""
    drawn = []
    for place, text in enumerate(edges):
        ends = [end.partition(".") for end in text.split(">")]
        (source, _, out), (target, _, into) = ends
        drawn.append(
            {"id": f"e{place}", "source": source, "source_port": out or "done"}
            | {"target": target, "target_port": into or "start"}
        )
    return {"schema": "labweb.workflow/1", "name": "Test", "steps": list(steps), "edges": drawn}


def chain(*steps: dict[str, Any]) -> dict[str, Any]:
    """Make a workflow of steps one after another."""
    ids = [s["id"] for s in steps]
    edges = tuple(f"{a}>{b}" for a, b in pairwise(ids))
    return flow(*steps, edges=edges)


def transfer(step_id: str, source: str, target: str, volume: str, **more: Any) -> dict[str, Any]:
    params = {"source": f"@{source}", "target": f"@{target}", "volume": volume, **more}
    return step(step_id, "transfer", **params)
