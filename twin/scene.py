"""What the lab looks like, as plain data: computed from a snapshot, drawn by the server."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

from twin import meshes, tubing
from twin.frames import ABSTRACT, Frame, Vector, frames_of, ride
from twin.levels import AT_WORK, jobs_by_device, plungers_ul, volumes_ul
from twin.meshes import Form, Mesh
from twin.palette import Role
from twin.parking import Tray, park
from twin.sizes import size_of
from twin.state import Snapshot, TwinDevice, TwinResource

State = Literal["idle", "running", "in_doubt", "offline"]

FOLDED = frozenset({"well", "tip_spot", "slot"})
"""Drawn with the ware or deck they belong to."""

TRAY_KEY = "parking tray"
_MOST_CAPTIONS = 80


@dataclass(frozen=True)
class Surface:
    """One coloured surface of a thing, in the thing's frame."""

    name: str
    role: Role
    mesh: Mesh
    lots: tuple[tuple[int, float], ...] = ()
    """Of a liquid: volume by the lot's number, which picks its tint."""


@dataclass(frozen=True)
class Thing:
    """One resource as it stands in the room."""

    key: str
    frame: Frame
    surfaces: tuple[Surface, ...]
    state: State = "idle"
    is_parked: bool = False
    title: str = ""
    """Shown to a person who has selected it."""

    height_mm: float = 0.0


@dataclass(frozen=True)
class DrawnTube:
    """One tube as points in the room, mm."""

    key: str
    points_mm: tuple[Vector, ...]


@dataclass(frozen=True)
class Caption:
    """Words that stand in the room."""

    key: str
    text: str
    at_mm: Vector


@dataclass(frozen=True)
class Scene:
    """Everything there is to see."""

    things: dict[str, Thing] = field(default_factory=dict)
    tubes: dict[str, DrawnTube] = field(default_factory=dict)
    captions: dict[str, Caption] = field(default_factory=dict)
    low_mm: Vector = (-300.0, -200.0, 0.0)
    high_mm: Vector = (300.0, 200.0, 200.0)


def describe(snapshot: Snapshot) -> Scene:
    """Compute what the lab looks like."""
    return _Describer(snapshot).scene()


class _Describer:
    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        self.rows = _in_service(snapshot.resources)
        self.frames, parked = frames_of(self.rows)
        self.parked = {key: row for key, row in parked.items() if self._has_place(row)}
        self.drawn = self._drawn()
        self.forms = self._forms()
        self.tray = self._park()
        self.volumes = volumes_ul(snapshot)
        self.plungers = plungers_ul(snapshot)
        self.states = self._states()

    def scene(self) -> Scene:
        things = {key: self._thing(key) for key in self.drawn if key in self.frames}
        tubes = self._tubes()
        named = {thing.key: thing for thing in things.values()}
        for probe, cable in self._probes():
            named[probe.key], tubes[cable.key] = probe, cable
        if self.tray is not None:
            named[TRAY_KEY] = _tray_thing(self.tray)
        low, high = self._bounds(self.frames)
        return Scene(named, tubes, self._captions(), low, high)

    def _has_place(self, row: TwinResource) -> bool:
        """Tell whether an unplaced resource is worth a place on the tray: it is a body."""
        if row.kind in FOLDED:
            return False
        is_surface = row.kind in {"bench", "deck"} and row.size_mm is None
        rides = (r for r in self.rows.values() if r.parent_id == row.id and r.pose is not None)
        return not is_surface or any(True for _ in rides)

    def _drawn(self) -> list[str]:
        """List what has a body of its own, in tree order."""
        return [
            key
            for key, row in self.rows.items()
            if row.kind not in ABSTRACT
            and not (row.kind in FOLDED and row.parent_id in self.rows)
            and (row.pose is not None or key in self.parked)
        ]

    def _forms(self) -> dict[str, Form]:
        cells = Counter(row.parent_id for row in self.rows.values() if row.kind in FOLDED)
        tops: dict[str, list[tuple[float, float]]] = {}
        for row in self.rows.values():
            if row.pose is not None and row.parent_id is not None:
                size = size_of(row)
                centre = (row.pose.x_mm + size[0] / 2.0, row.pose.y_mm + size[1] / 2.0)
                tops.setdefault(row.parent_id, []).append(centre)
        return {key: _form(self.rows[key], cells[key], tops.get(key, [])) for key in self.drawn}

    def _park(self) -> Tray | None:
        placed = [key for key in self.drawn if key in self.frames]
        low, high = self._bounds(placed) if placed else (None, None)
        sizes = [(key, self.forms[key].size_mm) for key in self.drawn if key in self.parked]
        tray = park(sizes, low, high)
        if tray is not None:
            self.frames.update(tray.frames)
            ride(self.rows, self.frames)
        return tray

    def _bounds(self, keys: Iterable[str]) -> tuple[Vector, Vector]:
        boxes = [(self.frames[key], self.forms[key].size_mm) for key in keys if key in self.forms]
        if self.__dict__.get("tray") is not None and self.tray is not None:
            boxes.append((self.tray.frame, self.tray.size_mm))
        corners = [
            frame.to_room((x, y, z))
            for frame, size in boxes
            for x, y, z in product(*((0.0, extent) for extent in size))
        ]
        if not corners:
            return Scene().low_mm, Scene().high_mm
        columns = list(zip(*corners, strict=True))
        low, high = [min(c) for c in columns], [max(c) for c in columns]
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])

    def _states(self) -> dict[str, State]:
        """Tell which resources carry a ring, and which."""
        found: dict[str, State] = {}
        jobs = jobs_by_device(self.snapshot)
        for device in self.snapshot.devices.values():
            state = _device_state(device, jobs[device.id].state if device.id in jobs else "")
            foot = self._foot_of(device)
            if foot is not None and state != "idle":
                found[foot] = state
        for key in self.drawn:
            if self.rows[key].is_quarantined:
                found[key] = "in_doubt"
        return found

    def _foot_of(self, device: TwinDevice) -> str | None:
        """Return the lowest of a device's resources; the ring lies around it once."""
        nodes = sorted({n for n in device.nodes.values() if n in self.frames and n in self.forms})
        return min(nodes, key=lambda node: self.frames[node].position_mm[2], default=None)

    def _thing(self, key: str) -> Thing:
        row, form = self.rows[key], self.forms[key]
        surfaces = [Surface(p.name, p.role, p.mesh) for p in meshes.body(form)]
        capacity = row.capacity_ul or 0.0
        volume = self.volumes.get(key, 0.0)
        if form.kind == "syringe_pump" and capacity:
            share = self.plungers.get(key, volume) / capacity
            surfaces.append(Surface("plunger", Role.DARK, meshes.plunger(form, share)))
        if capacity and volume > 0:
            wet = meshes.liquid(form, volume / capacity)
            if wet is not None:
                surfaces.append(Surface("liquid", Role.LIQUID, wet, _lots(row)))
        state = self.states.get(key, "idle")
        if state != "idle":
            surfaces.append(_ring(form, state))
        return Thing(
            key=row.key,
            frame=self.frames[key],
            surfaces=tuple(surfaces),
            state=state,
            is_parked=key in self.parked,
            title=_title(row, volume, state),
            height_mm=form.size_mm[2],
        )

    def _tubes(self) -> dict[str, DrawnTube]:
        ports: dict[str, list[str]] = {}
        rows = list(self.snapshot.connections.values())
        liquid = [row for row in rows if row.medium == "liquid"]
        for row in liquid:
            for end in (row.source, row.target):
                ports.setdefault(end.resource_id, []).append(end.port)
        found = {}
        for lane, row in enumerate(liquid):
            ends = []
            for end in (row.source, row.target):
                node = self.rows.get(end.resource_id)
                if node is None or node.id not in self.forms or node.id not in self.frames:
                    break
                names = sorted(set(ports[node.id]) - {node.common_port})
                mouth = tubing.mouth(
                    self.forms[node.id],
                    end.port,
                    common_port=node.common_port,
                    number=names.index(end.port) if end.port in names else 0,
                    count=len(names),
                )
                ends.append((self.frames[node.id], mouth))
            if len(ends) == 2:
                found[row.key] = DrawnTube(row.key, tubing.route(ends[0], ends[1], lane))
        return found

    def _probes(self) -> Iterator[tuple[Thing, DrawnTube]]:
        """Stand the probe of each transmitter in the vessel it is connected to."""
        for row in self.snapshot.connections.values():
            ends = [self.rows.get(end.resource_id) for end in (row.source, row.target)]
            ends.sort(key=lambda node: node is None or node.kind != "transmitter")
            meter, vessel = ends
            if row.medium != "mechanical" or meter is None or vessel is None:
                continue
            known = self.forms.keys() & self.frames.keys()
            if meter.kind != "transmitter" or not {meter.id, vessel.id} <= known:
                continue
            form, frame = self.forms[vessel.id], self.frames[vessel.id]
            (x, y), height = meshes.axis_of(form), form.size_mm[2]
            tip, length = (x, y, height * 0.16), height * 1.05
            head = tubing.Mouth((x, y, tip[2] + length + 22.0), (0.0, 0.0, 1.0))
            socket = tubing.mouth(self.forms[meter.id], "", common_port="", number=0, count=1)
            surface = Surface("probe", Role.DARK, meshes.probe(tip, length))
            cable = tubing.route((self.frames[meter.id], socket), (frame, head), 0)
            yield Thing(row.key, frame, (surface,), title=meter.name), DrawnTube(row.key, cable)

    def _captions(self) -> dict[str, Caption]:
        found = {}
        for key in self.drawn:
            state = self.states.get(key, "idle")
            is_parked = key in self.parked
            if key in self.frames and (state in {"in_doubt", "offline"} or is_parked):
                row, size = self.rows[key], self.forms[key].size_mm
                words = [row.name] + ([state.replace("_", " ")] if state != "idle" else [])
                at = self.frames[key].to_room((size[0] / 2.0, size[1] / 2.0, size[2] + 14.0))
                found[row.key] = Caption(row.key, " · ".join(words), at)
            if len(found) >= _MOST_CAPTIONS:
                break
        if self.tray is not None:
            x, y, _ = self.tray.size_mm
            found[TRAY_KEY] = Caption(
                TRAY_KEY, "pose unknown", self.tray.frame.to_room((x / 2.0, -y * 0.02 - 10.0, 0.0))
            )
        if self.snapshot.lab.is_stopped:
            low, high = self._bounds(self.frames)
            middle = ((low[0] + high[0]) / 2.0, low[1], high[2] + 60.0)
            found["lab stopped"] = Caption("lab stopped", "Lab stopped", middle)
        return found


def _in_service(resources: Mapping[str, TwinResource]) -> dict[str, TwinResource]:
    """Leave out what was archived, with everything in it."""
    kept: dict[str, TwinResource] = {}
    gone: set[str] = {key for key, row in resources.items() if row.is_archived}
    for key, row in resources.items():
        chain, above = [key], row.parent_id
        while above is not None and above in resources and above not in chain:
            chain.append(above)
            above = resources[above].parent_id
        if not gone.intersection(chain):
            kept[key] = row
    return kept


def _form(row: TwinResource, cells: int, tops: list[tuple[float, float]]) -> Form:
    top = None
    if tops and row.kind in {"heater_stirrer", "heater", "stirrer", "balance"}:
        top = (sum(x for x, _ in tops) / len(tops), sum(y for _, y in tops) / len(tops))
    return Form(
        kind=row.kind,
        size_mm=size_of(row),
        shape=row.shape,
        top_at_mm=top,
        ports_count=row.ports_count or 0,
        cells_count=cells if row.kind not in {"deck", "bench"} else 0,
    )


def _device_state(device: TwinDevice, job_state: str) -> State:
    if job_state == "in_doubt":
        return "in_doubt"
    if device.link in {"offline", "quarantined"}:
        return "offline"
    return "running" if job_state in AT_WORK else "idle"


def _ring(form: Form, state: State) -> Surface:
    role = {"running": Role.RUN, "in_doubt": Role.DOUBT}.get(state, Role.OFF)
    return Surface("ring", role, meshes.state_ring(form, is_dashed=state != "running"))


def _lots(row: TwinResource) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((int(lot), float(amount)) for lot, amount in row.contents_nl.items()))


def _title(row: TwinResource, volume_ul: float, state: State) -> str:
    words = [row.name]
    if row.capacity_ul:
        words.append(f"{volume_ul / 1000.0:.2f} mL of {row.capacity_ul / 1000.0:g} mL")
    if state != "idle":
        words.append(state.replace("_", " "))
    return " · ".join(words)


def _tray_thing(tray: Tray) -> Thing:
    form = Form("tray", tray.size_mm)
    surfaces = tuple(Surface(p.name, p.role, p.mesh) for p in meshes.body(form))
    return Thing(TRAY_KEY, tray.frame, surfaces, title="Pose unknown", height_mm=tray.size_mm[2])
