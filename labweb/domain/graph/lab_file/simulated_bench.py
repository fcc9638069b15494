"""What simulated instruments need to stand in for a lab: vessels, lines and plumbing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from labweb.domain.graph.lab_file.lab_model import DeviceEntry, LabFile, LabFileMaterial
from labweb.domain.graph.lab_file.untrusted_json import refuse
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS, is_vessel

SCHEMA = "labweb.bench/1"
"""Version of the description that simulated instruments read."""

CARRIER_BY_MODEL: Mapping[str, str | None] = {
    "tricontinent_c3000": "pty",
    "ika_rct_digital": "pty",
    "mettler_sics": "tcp",
    "modbus_ph": "tcp",
    "ika_ret_control_visc": "pty",
    "ika_microstar_75": "pty",
    "ika_rv10_digital": "pty",
    "heidolph_hei_torque_100": "pty",
    "heidolph_rzr_2052": "pty",
    "heidolph_hei_connect": "pty",
    "runze_sy03b": "pty",
    "runze_sy01": "pty",
    "runze_sv06": "pty",
    "hamilton_ml600": "pty",
    "harvard_elite_11": "pty",
    "new_era_ne1000": "pty",
    "vici_multiposition": "pty",
    "vici_injection": "pty",
    "idex_mxii": "pty",
    "knauer_valve": "tcp",
    "knauer_injection_valve": "tcp",
    "knauer_azura_compact": "tcp",
    "chemputer_pump": "tcp",
    "chemputer_valve": "tcp",
    "huber_pb": "pty",
    "julabo_cf41": "pty",
    "vacuubrand_cvc3000": "pty",
    "modbus_tds": "pty",
    "eurotherm": "pty",
    "riden_rd6006": "pty",
    "keysight_e3633a": "pty",
    "itech_it6300": "pty",
    "tti_pl": "pty",
    "tdk_genesys": "pty",
    "manson_hcs": "pty",
    "neware_bts": "tcp",
    "cytomat": "pty",
    "bioshake": "pty",
    "ur_dashboard": "tcp",
    "seer_agv": "tcp",
    "masterflex_ls": "pty",
    "watson_marlow_323": "pty",
    "conductivity_sensor": "pty",
    "network_camera": "tcp",
    "lads_controller": "tcp",
    "timer": None,
    "lauda_loop": "pty",
    "s7_furnace": "tcp",
    "robotiq_2f85": "pty",
    "grbl_gantry": "pty",
    "sila_controller": "tcp",
    "buchi_c815": "tcp",
    "magritek_spinsolve": "tcp",
    "mettler_quantos": "tcp",
    "lab_hplc": "tcp",
    "lab_gcms": "tcp",
    "lab_ms": "tcp",
    "emstat_pico": "pty",
    "opentrons_ot2": "tcp",
    "slurm_rest": "tcp",
    "spectramax": "pty",
    "simex_trs02a": "pty",
    "bronkhorst_es_flow": "pty",
    "chinwe_separator": "tcp",
}
"""Model of simulated instrument → what carries its bytes; None needs no carrier."""

_BARE_PUMPS = frozenset({"chemputer_pump"})
"""Models of a pump with one outlet and no valve."""

_OUTLET, _COMMON = "outlet", "common"
_CENTRE = "-1"
"""What a Chemputer valve calls its common port; the others are 0 to 5 on it."""

ASSUMED_DENSITY_MG_UL = 1.0
ASSUMED_TARE_MG = 0.0
ASSUMED_TEMPERATURE_C = 22.0
ASSUMED_TUBE_UL = 500.0
SMALLEST_TUBE_UL = 0.001
SIMULATED_PH = (0.0, 14.0)

_INSTRUMENT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")

_TOUCHING = frozenset({Medium.THERMAL, Medium.MECHANICAL, Medium.ELECTRICAL, Medium.VACUUM})
"""Media over which a heater, stirrer, probe or vacuum acts on a vessel."""


@dataclass(frozen=True, slots=True)
class BenchNotes:
    """What a description of the bench assumes or leaves out."""

    assumed: tuple[str, ...]
    """Numbers that the lab does not know and that a simulation cannot do without. The
    lab itself goes on not knowing them."""

    unattached: tuple[str, ...]
    """Ports whose far end nothing simulates."""


def endpoints_needed(lab: LabFile) -> list[tuple[str, str]]:
    """List each line of simulated instruments with its carrier, `pty` or `tcp`.

    Raises:
        LabFileError: Nobody simulates a model, or two on one line need different carriers.
    """
    found: dict[str, str] = {}
    for device in lab.devices:
        carrier = _carrier(device)
        if carrier is None:
            continue
        if found.setdefault(device.line, carrier) != carrier:
            message = f"line {device.line!r} would be both {found[device.line]} and {carrier}"
            raise refuse("bench.carrier_differs", message, device.key)
    return list(found.items())


def bench_for(lab: LabFile, endpoints: Mapping[str, str]) -> dict[str, Any]:
    """Describe the lab to its simulated instruments.

    Args:
        lab: A lab in mode sim.
        endpoints: Line, as `endpoints_needed` names it → `pty:/path` or
            `tcp:127.0.0.1:port`.

    Returns:
        JSON-ready description, with nothing in it that the instruments do not read;
        `bench_notes` says what it assumes.

    Raises:
        LabFileError: A line has no endpoint, or nobody simulates a model.
    """
    return _built(lab, endpoints).document


def bench_notes(lab: LabFile, endpoints: Mapping[str, str]) -> BenchNotes:
    """Say what `bench_for` has to assume or leave out.

    Raises:
        LabFileError: As `bench_for`.
    """
    bench = _built(lab, endpoints)
    return BenchNotes(assumed=tuple(bench.assumed), unattached=tuple(bench.unattached))


def _built(lab: LabFile, endpoints: Mapping[str, str]) -> _Bench:
    missing = [line for line, _ in endpoints_needed(lab) if line not in endpoints]
    if missing:
        raise refuse("bench.no_endpoint", f"no endpoint for {', '.join(missing)}", missing[0])
    return _Bench(lab, endpoints)


def instrument_id(device: DeviceEntry) -> str:
    """Return what a device's simulated instrument is called: its key, or its id.

    The name is part of file names, so a key with other letters than A–Z cannot serve.
    """
    return device.key if _INSTRUMENT_ID.fullmatch(device.key) else str(device.id)


def _is_plumbed(resource: Resource) -> bool:
    """Tell whether liquid comes to an instrument through a port of its own."""
    return resource.kind == "syringe_pump" or KINDS[resource.kind].conducts


def _carrier(device: DeviceEntry) -> str | None:
    if device.simulator is None:
        return None
    model = device.simulator.model
    if model not in CARRIER_BY_MODEL:
        message = f"{device.key}: nobody simulates {model!r}; known: {', '.join(CARRIER_BY_MODEL)}"
        raise refuse("bench.model_unknown", message, device.key)
    return CARRIER_BY_MODEL[model]


class _Bench:
    """One description in the making."""

    def __init__(self, lab: LabFile, endpoints: Mapping[str, str]) -> None:
        self.lab = lab
        self.endpoints = endpoints
        self.assumed: list[str] = []
        self.unattached: list[str] = []
        self.owners = {node: device for device in lab.devices for node in device.nodes.values()}
        self.document = self._render()

    def _render(self) -> dict[str, Any]:
        vessels = [self._vessel(r) for r in self.lab.resources if self._is_store(r)]
        instruments = [self._instrument(device) for device in self.lab.devices if _carrier(device)]
        return {
            "schema": SCHEMA,
            "vessels": vessels,
            "instruments": instruments,
        }

    def _is_store(self, resource: Resource) -> bool:
        # The syringe is part of its pump: the instrument itself simulates it.
        return is_vessel(resource.kind) and resource.kind != "syringe_pump"

    def _known(self, value: float | None, otherwise: float, what: str) -> float:
        if value is not None:
            return value
        self._assume(f"{what}: {otherwise:g}")
        return otherwise

    def _vessel(self, resource: Resource) -> dict[str, Any]:
        key, config = resource.key, resource.config
        return {
            "id": key,
            **self._capacity(resource),
            "tare_mg": self._known(config.get("tare_mg"), ASSUMED_TARE_MG, f"tare_mg of {key}"),
            "temperature_c": self._known(
                config.get("temperature_c"), ASSUMED_TEMPERATURE_C, f"temperature_c of {key}"
            ),
            "contents": [
                self._part(lot, amount_nl)
                for lot, amount_nl in self.lab.contents.get(resource.id, {}).items()
            ],
            **self._condenser(resource),
        }

    def _condenser(self, resource: Resource) -> dict[str, str]:
        """Return where the vapour of a vessel ends: behind a way for gas that leads one way."""
        for way in self.lab.graph.by_resource.get(resource.id, ()):
            far = self.lab.tree.by_id[way.target.resource_id]
            is_out = way.source.resource_id == resource.id and not way.is_two_way
            if way.medium is Medium.GAS and is_out and self._is_store(far):
                return {"condenses_into": far.key}
        return {}

    def _part(self, lot_id: LotId, amount_nl: int) -> dict[str, Any]:
        lot = self.lab.lots_by_id[lot_id]
        material = self.lab.materials_by_id[lot.material_id]
        return {
            "lot": lot.key,
            "volume_ul": amount_nl / 1000,
            "density_mg_ul": self._known(
                material.density_mg_ul, ASSUMED_DENSITY_MG_UL, f"density_mg_ul of {material.key}"
            ),
            **self._ph(material),
        }

    def _capacity(self, resource: Resource) -> dict[str, float]:
        capacity_ul = resource.config.get("capacity_ul")
        if capacity_ul is None:
            self._assume(f"capacity_ul of {resource.key}: never full")
            return {}
        return {"capacity_ul": capacity_ul}

    def _ph(self, material: LabFileMaterial) -> dict[str, float]:
        """Return the pH of a material, and none where nobody knows it."""
        if material.ph is None:
            return {}
        low, high = SIMULATED_PH
        shown = min(max(material.ph, low), high)
        if shown != material.ph:
            self._assume(f"ph of {material.key}: {shown:g}")
        return {"ph": shown}

    def _assume(self, text: str) -> None:
        if text not in self.assumed:
            self.assumed.append(text)

    def _instrument(self, device: DeviceEntry) -> dict[str, Any]:
        simulator = device.simulator
        return {
            "id": instrument_id(device),
            "model": simulator.model if simulator else "",
            "endpoint": self.endpoints[device.line],
            "settings": dict(simulator.settings) if simulator else {},
            "attached": self._attached(device),
        }

    def _attached(self, device: DeviceEntry) -> dict[str, Any]:
        plumbed = device.nodes.get("valve", device.nodes.get("pump"))
        if plumbed is not None:
            return {"ports": dict(self._ports(device, plumbed))}
        vessel = self._vessel_at(device)
        return {} if vessel is None else {"vessel": vessel.key}

    def _ports(self, device: DeviceEntry, plumbed: UUID) -> Iterator[tuple[str, dict[str, Any]]]:
        own_nodes = set(device.nodes.values())
        for own, far, tube in self._tubes(plumbed):
            if far.resource_id in own_nodes:
                continue
            resource = self.lab.tree.by_id[far.resource_id]
            other = self.owners.get(far.resource_id)
            behind = self._behind(resource)
            port = self._port_on(device, own)
            if self._is_store(resource):
                yield port, {"vessel": resource.key}
            elif behind is not None:
                yield port, {"vessel": behind.key, "through": resource.key}
            elif other is not None and _is_plumbed(resource):
                end = {"instrument": instrument_id(other), "port": self._port_on(other, far)}
                yield port, end | {"capacity_ul": self._tube_ul(tube)}
            else:
                self.unattached.append(f"port {own.port} of {device.key}: {resource.key}")

    def _port_on(self, device: DeviceEntry, end: PortRef) -> str:
        """Return what an instrument itself calls a port of the lab."""
        model = "" if device.simulator is None else device.simulator.model
        if model in _BARE_PUMPS:
            return _OUTLET
        resource = self.lab.tree.by_id[end.resource_id]
        if resource.kind != "rotary_valve":
            return end.port
        if model != "chemputer_valve":
            return _COMMON if end.port == resource.config.get("common_port") else end.port
        if not end.port.isdecimal():
            return _CENTRE
        return str(int(end.port) - int(device.config.get("first_port_index", 0)))

    def _behind(self, resource: Resource) -> Resource | None:
        """Return the vessel into which a cartridge leads."""
        if resource.kind != "cartridge":
            return None
        ways = (w for o, _, w in self._tubes(resource.id) if w.source.resource_id == resource.id)
        ends = (self.lab.tree.by_id[way.target.resource_id] for way in ways)
        return next((end for end in ends if self._is_store(end)), None)

    def _tube_ul(self, tube: Connection) -> float:
        if tube.dead_volume_nl is None:
            return self._known(None, ASSUMED_TUBE_UL, f"dead_volume_ul of {tube.key}")
        return max(tube.dead_volume_nl / 1000, SMALLEST_TUBE_UL)

    def _tubes(self, resource_id: UUID) -> Iterator[tuple[PortRef, PortRef, Connection]]:
        for connection in self.lab.graph.by_resource.get(resource_id, ()):
            if connection.medium is Medium.LIQUID:
                ends = (connection.source, connection.target)
                own, far = ends if ends[0].resource_id == resource_id else ends[::-1]
                yield own, far, connection

    def _vessel_at(self, device: DeviceEntry) -> Resource | None:
        """Find the one vessel that stands on a device, or that it touches or dips into."""
        found: dict[UUID, Resource] = {}
        for node in dict.fromkeys(device.nodes.values()):
            for child in self.lab.tree.children.get(node, ()):
                if self._is_store(child):
                    found[child.id] = child
            for connection in self.lab.graph.by_resource.get(node, ()):
                if connection.medium not in _TOUCHING:
                    continue
                for end in (connection.source, connection.target):
                    resource = self.lab.tree.by_id[end.resource_id]
                    if self._is_store(resource):
                        found[resource.id] = resource
        if len(found) > 1:
            keys = ", ".join(sorted(resource.key for resource in found.values()))
            self.unattached.append(f"{device.key}: several vessels: {keys}")
            return None
        return next(iter(found.values()), None)
