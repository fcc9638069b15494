"""Where everything is and what runs, at one moment of a plan; and what a step did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from labweb.domain.errors import Finding
from labweb.domain.messages import plan_fields as words
from labweb.domain.proof.device_abilities import pumps_of
from labweb.domain.proof.incompatible_liquids import Reactivity
from labweb.domain.proof.lot_amount_ranges import NOTHING, UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.plumbing import COLLECT, End, Plumbing, Stands

LOST, REMOVED = "@lost", "@removed"
"""Where matter is booked that dried away, and that a person emptied out."""

LOWER, UPPER = "lower", "upper"
ROOM_C = (15.0, 30.0)
"""Coldest and warmest that a room is, to which drifts what nothing heats or chills.

Source:
    USP 659, the excursions that controlled room temperature allows."""

TOLERANCE = UNITS_PER_NL // 2
"""Half a nanolitre: amounts that differ by no more are equal."""


@dataclass(slots=True)
class Syringe:
    """What a syringe holds."""

    nominal: int = 0
    """How far the plunger is out, in units: what strokes of uncertain size drew at most."""

    contents: Contents = field(default_factory=Contents)
    origin: End | None = None
    """Vessel or source of gas that it was drawn from, and by which port."""

    passed: tuple[str, ...] = ()
    """Cartridges and manifolds on its way so far."""

    phases: set[str] = field(default_factory=set)
    is_dissolved: bool = False
    """A person has stated what goes along of each solid: no cartridge keeps it back."""


@dataclass(frozen=True, slots=True)
class Flow:
    """Liquid or gas that one stroke brought into a vessel."""

    source: End
    target: End
    volume: AmountRange
    nominal: int
    passed: tuple[str, ...]
    liquids: Mapping[str, AmountRange]
    solids: Mapping[str, AmountRange]
    is_gas: bool


@dataclass(frozen=True, slots=True)
class ProofEffect:
    """Something that an action did, beside moving liquid."""

    name: str
    """The action."""

    device: str
    vessels: tuple[str, ...] = ()
    value: object = None
    """What the claim compares: a speed, a temperature, a duration, an amount."""

    lot: str = ""


@dataclass(slots=True)
class StepRecord:
    """What one step has done so far."""

    flows: list[Flow] = field(default_factory=list)
    effects: list[ProofEffect] = field(default_factory=list)
    turned: set[str] = field(default_factory=set)
    """Valves that this step has turned."""

    solenoids: set[str] = field(default_factory=set)
    """Solenoids that liquid of this step went through."""

    opened: set[str] = field(default_factory=set)
    """Solenoids that this step has opened."""

    touched: set[str] = field(default_factory=set)
    """Devices and vessels: what must not be used by two steps at once."""

    ways: list[tuple[End, ...]] = field(default_factory=list)
    """Ports that liquid was joined to, from each plunger that moved it on."""

    parting: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Vessel whose lower phase is drawn → the most that was there, what was drawn so far."""

    vapours: list[tuple[str, str]] = field(default_factory=list)
    """What boiled off: from which vessel into which."""

    rates: list[tuple[str, str, float]] = field(default_factory=list)
    """Pump, where its stroke leads (`draw`, `push` or `between`), and its rate in µL/s."""

    is_checked: bool = False
    """A person has confirmed something in this step."""


@dataclass(slots=True)
class VacuumState:
    """State of a vacuum pump."""

    is_running: bool = False
    pressure_mbar: float | None = None
    is_vented: bool = False


class State:
    """The whole rig."""

    def __init__(
        self, plumbing: Plumbing, capacities: Mapping[str, int], *, is_alone: bool = False
    ) -> None:
        self.plumbing = plumbing
        self.capacities = capacities
        self.contents: dict[str, Contents] = {}
        self.phases: dict[str, set[str]] = {}
        self.syringes: dict[str, Syringe] = {}
        self.stands = Stands()
        self.stirring: dict[str, float] = {}
        self.rotating: dict[str, float] = {}
        self.temperatures: dict[str, float] = {}
        """Heater, chiller or bath that is on → what it is set to."""

        self.warmth: dict[str, tuple[float, float]] = {}
        """Vessel → the coldest and warmest that it may be in °C; not in it: as the room."""

        self.vacuums: dict[str, VacuumState] = {}
        self.supplies: dict[End, str] = {}
        self.lowered: set[str] = set()
        self.lights: dict[str, words.Light] = {}
        """Lamp that is on → what is known of its light."""

        self.sounding: set[str] = set()
        """Ultrasonic baths and horns that are on."""

        self.watched: dict[str, set[str]] = {}
        """Vessel → sensors, or `@by_hand`, that watch it."""

        self.has_collecting = not is_alone
        """The collecting flask of a rotary evaporator is a vessel of its own."""

        self.reactivity = Reactivity({})
        """What is said of the chemistry of lots and wastes, and what syringes and valves keep."""

        self.record = StepRecord()
        self.routes: dict[int, tuple[str, ...]] = {}
        """Step → the tubes that its liquid went through, in the order of the graph."""

        self.findings: list[Finding] = []
        self.where = "plan"
        self.exposed = [] if is_alone else _exposed(plumbing)
        """Vessels that gas or vacuum can get to at all."""

        lines = [] if is_alone else [k for k, e in plumbing.elements.items() if e.role == "vacuum"]
        self._always_draws = any(not pumps_of(plumbing, key) for key in lines)

    def see_there(self, key: str, parts: Mapping[str, int]) -> None:
        """Add a finding for each lot of which a vessel holds less than so much for certain."""
        for lot, amount in parts.items():
            least = self.held(key).liquids.get(lot, NOTHING).least
            if least < amount - TOLERANCE:
                message = (
                    f"{microlitres(amount)} of {lot} leave {key}, which holds for certain "
                    f"{microlitres(least)} of it"
                )
                self.complain("interpret.not_there", message, vessel=key)

    def complain(self, code: str, message: str, **context: object) -> None:
        """Add a finding about where execution stands."""
        self.findings.append(Finding(code, f"{self.where}: {message}", self.where, context))

    def held(self, key: str) -> Contents:
        """Return the contents of a vessel, to be changed in place."""
        return self.contents.setdefault(key, Contents())

    def syringe(self, key: str) -> Syringe:
        """Return what a syringe holds, to be changed in place."""
        return self.syringes.setdefault(key, Syringe())

    def sources(self, vessel: str) -> set[str]:
        """Return the sources of gas that a vessel is joined to."""
        found = set()
        for end in self.plumbing.gases_at(vessel, self.stands):
            if self.plumbing.is_gas(end.key) or self.supplies.get(end) == "gas":
                found.add(end.key)
        return found

    def running_vacuum(self, vessel: str, *, maybe: bool = False) -> set[str]:
        """Return the running vacuum lines that a vessel is joined to."""
        ends = self.plumbing.gases_at(vessel, self.stands, maybe=maybe)
        return {end.key for end in ends if self._draws(end)}

    def see_no_vacuum(self, vessel: str, what: str) -> None:
        """Add a finding when running vacuum is, or may be, on a vessel while `what` is done."""
        owner = vessel.removesuffix(COLLECT)
        keys = {owner, *self.plumbing.evaporates_into(vessel)}.intersection(self.exposed)
        lines = {line for key in keys for line in self.running_vacuum(key, maybe=True)}
        if lines:
            names = ", ".join(sorted(lines))
            message = f"{what} while {names} is, or may be, drawing on it"
            self.complain("interpret.vacuum_on", message, vessel=vessel)

    def lines(self, vessel: str) -> set[str]:
        """Return all vacuum lines that a vessel is joined to, running or not."""
        ends = self.plumbing.gases_at(vessel, self.stands)
        return {end.key for end in ends if self.plumbing.elements[end.key].role == "vacuum"}

    def lines_without_valves(self, vessel: str) -> set[str]:
        """Return the vacuum lines that nothing can take off a vessel."""
        ends = self.plumbing.gases_at(vessel, Stands())
        return {end.key for end in ends if self.plumbing.elements[end.key].role == "vacuum"}

    def _draws(self, end: End) -> bool:
        element = self.plumbing.elements[end.key]
        if element.role != "vacuum":
            return self.supplies.get(end) == "vacuum"
        pumps = pumps_of(self.plumbing, end.key)
        return not pumps or any(pump in self.running_pumps() for pump in pumps)

    def running_pumps(self) -> set[str]:
        """Return the vacuum pumps that run."""
        return {key for key, vacuum in self.vacuums.items() if vacuum.is_running}

    def mix_in(self, vessel: str, more: Contents) -> None:
        """Put matter into a vessel, and see that it fits."""
        held = self.held(vessel)
        held.add(more)
        capacity = self.capacities.get(vessel)
        if capacity is None or more.volume == NOTHING:
            return
        if held.volume.least > capacity + TOLERANCE:
            self.complain(
                "interpret.overflow",
                f"{vessel} holds {microlitres(capacity)} and now has "
                f"{microlitres(held.volume.least)}",
                vessel=vessel,
            )
        elif held.volume.most > capacity + TOLERANCE and not self.record.is_checked:
            self.complain(
                "interpret.may_overflow",
                f"{vessel} holds {microlitres(capacity)}, may now have "
                f"{microlitres(held.volume.most)}, and nobody is asked first",
                vessel=vessel,
            )

    def dry(self) -> None:
        """Let liquid leave all vessels that running vacuum is, or may be, on."""
        if not (self._always_draws or self.running_pumps() or "vacuum" in self.supplies.values()):
            return
        for vessel in self.exposed:
            held = self.contents.get(vessel)
            if held is not None and held.volume.most and self.running_vacuum(vessel, maybe=True):
                self.held(LOST).add(held.let_go())


def _exposed(plumbing: Plumbing) -> list[str]:
    can_reach = Stands(opened={k for k, e in plumbing.elements.items() if e.role == "solenoid"})
    return [
        key
        for key in plumbing.elements
        if plumbing.is_vessel(key) and any(plumbing.gases_at(key, can_reach, maybe=True))
    ]


def microlitres(amount: int) -> str:
    """Write an amount of units for a person.

    Example:
        >>> microlitres(2_500_000_000)
        '2.5 µL'
    """
    return f"{amount / UNITS_PER_NL / 1000:.12g} µL"
