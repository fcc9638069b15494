"""Which ends are joined to a syringe while valves and solenoids stand as they do.

    draw:  liquid comes to the syringe, so hoses are walked against their direction
    push:  liquid leaves the syringe, so hoses are walked along it

A rotary valve joins its common port with the one port it stands on; a hose on any other port of it
ends there. A shut solenoid ends a hose. Two hoses on one port meet in a tee, whether or not the
valve stands on that port. A syringe at rest passes its barrel but gives and takes nothing. Tubes
hold no volume.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from enum import StrEnum

from tests.judge.rig import End, Hose, Kind, Rig


class Sense(StrEnum):
    """Which way the plunger goes."""

    DRAW = "draw"
    PUSH = "push"


@dataclass(frozen=True)
class Stray:
    """A way out of the tubes that is no vessel and no syringe."""

    code: str
    message: str


@dataclass
class Joined:
    """What a syringe is joined to."""

    vessels: set[End] = field(default_factory=set)
    pumps: set[str] = field(default_factory=set)
    strays: list[Stray] = field(default_factory=list)
    touched: set[str] = field(default_factory=set)
    """Every device at which liquid passes or is stopped."""

    def vessel_ids(self) -> set[str]:
        """Name the vessels, however many of their ports are joined."""
        return {name for name, _ in self.vessels}


class Walk:
    """One walk through the tubes from a syringe."""

    def __init__(
        self, rig: Rig, positions: Mapping[str, str], opened: Set[str], sense: Sense
    ) -> None:
        self._rig, self._positions, self._opened, self._sense = rig, positions, opened, sense
        self._left: set[End] = set()
        self.joined = Joined()
        self.hoses: set[Hose] = set()
        """The hoses that are walked."""

    def start(self, pump: str) -> Joined:
        """Walk from the barrel of this pump."""
        self.joined.touched.add(pump)
        self._from_barrel(pump, None)
        self.joined.pumps.discard(pump)
        return self.joined

    def _from_barrel(self, pump: str, came_by: Hose | None) -> None:
        if self._rig.devices[pump].kind is Kind.PUMP_VALVE:
            self._through_selected(pump)
            return
        for end in self._rig.ends_of(pump):
            self._leave(end, came_by)

    def _through_selected(self, valve: str) -> None:
        port = self._positions.get(valve)
        if port is None:
            self._stray("valve-unset", f"nothing says where {valve} stands")
        else:
            self._leave((valve, port), None, must_lead=True)

    def _leave(self, end: End, came_by: Hose | None, *, must_lead: bool = False) -> None:
        """Go out by every hose on a port; `must_lead`: a port without a hose is open to the air."""
        hoses = self._rig.hoses_at(end)
        if not hoses and must_lead:
            self._no_hose(end)
        if end in self._left:
            return
        self._left.add(end)
        for hose in hoses:
            far = hose.other(end)
            is_open = hose.carries(end if self._sense is Sense.PUSH else far)
            if hose is not came_by and is_open:
                self.hoses.add(hose)
                self._arrive(far, hose)

    def _no_hose(self, end: End) -> None:
        medium = self._rig.dry_ends.get(end)
        if medium is None:
            self._stray("open-port", f"{end[0]} stands on {end[1]}, where no hose is")
        else:
            self._stray("not-fluid", f"the link on {end[1]} of {end[0]} is {medium}, not fluid")

    def _arrive(self, end: End, hose: Hose) -> None:
        device = self._rig.devices[end[0]]
        self.joined.touched.add(device.id)
        match device.kind:
            case Kind.VESSEL:
                self.joined.vessels.add(end)
            case Kind.OTHER:
                self._stray("not-a-vessel", f"the way is open to {device.id}, which is no vessel")
            case Kind.PUMP:
                is_new = device.id not in self.joined.pumps
                self.joined.pumps.add(device.id)
                if is_new:
                    self._from_barrel(device.id, hose)
            case Kind.SOLENOID:
                self._leave(end, hose)
                if device.id in self._opened:
                    for far in self._rig.ends_of(device.id):
                        if far != end:
                            self._leave(far, None)
            case Kind.VALVE | Kind.PUMP_VALVE:
                self._leave(end, hose)
                self._at_valve(end)

    def _at_valve(self, end: End) -> None:
        device, position = self._rig.devices[end[0]], self._positions.get(end[0])
        if not end[1]:
            self._stray("unnamed-port", f"the hose is on no named port of {device.id}")
        elif position is None:
            self._stray("valve-unset", f"nothing says where {device.id} stands")
        elif device.kind is Kind.PUMP_VALVE:
            if end[1] == position:
                self.joined.pumps.add(device.id)
        elif end[1] == device.common:
            self._leave((device.id, position), None, must_lead=True)
        elif end[1] == position:
            self._leave((device.id, device.common), None, must_lead=True)

    def _stray(self, code: str, message: str) -> None:
        self.joined.strays.append(Stray(code, message))


def joined_to(
    rig: Rig, pump: str, sense: Sense, positions: Mapping[str, str], opened: Set[str]
) -> Joined:
    """Return what a syringe draws from or pushes to."""
    return Walk(rig, positions, opened, sense).start(pump)
