"""What must not meet: in wastes, and in the syringes and valves that one liquid after another uses.

What is said of the lots stands here; how much of them has met, in `encounters`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, ElementRole
from labweb.domain.graph.rig.nodes_as_elements import volume_nl
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, Contents
from labweb.domain.proof.plan_read import ProofPlan
from labweb.domain.proof.unplanned_mixing import (
    Company,
    Encounters,
    Enmities,
    Gift,
    Item,
    Memory,
    amounts,
)
from labweb.domain.proof.wetted_lines import Lines, Wetted
from labweb.domain.resources.compatibility_table import CONFLICTS, STREAMS

_GRAIN = UNITS_PER_NL // 2
_PLAN = ProofPlan(())


@dataclass(frozen=True, slots=True)
class Came:
    """What came into a vessel in one step."""

    amounts: Mapping[Item, int]
    """Lot → units, at most."""

    sources: Collection[str] = ()
    """Vessels that it came out of; none: a person brought it."""


@dataclass(frozen=True)
class WettedPast:
    """What wets syringes and valves, and what has met."""

    wetted: Wetted
    met: Memory


@dataclass(slots=True)
class _Step:
    """What the step that goes on has done so far."""

    before: Mapping[str, Contents] = field(default_factory=dict)
    meant: frozenset[Item] = frozenset()
    """What it brings its liquid onto."""

    origins: set[str] = field(default_factory=set)


class Reactivity:
    """What must not meet, what wastes take, and what still wets each syringe and valve."""

    def __init__(
        self,
        elements: Mapping[str, Element],
        plan: ProofPlan = _PLAN,
        condensing: Collection[str] = (),
    ) -> None:
        self._elements = elements
        self._groups = plan.groups
        self._takes = {
            key: frozenset(words)
            for key, element in elements.items()
            if is_waste(element) and (words := _words(element, "takes")) is not None
        }
        wastes = {key for key, element in elements.items() if is_waste(element)}
        self._of_nobody = wastes | {*condensing} - {*plan.bindings.vessels.values()}
        left = (
            _stated(elements[key]) & {*_lots(held)} - plan.bindings.reagents.keys()
            for key, held in plan.contents.items()
            if key in elements and key not in plan.flasks()
        )
        self._left = frozenset[str]().union(*left)
        self._lines = Lines()
        self._met = Encounters(self._enmities(plan))
        self._step = _Step()

    def _enmities(self, plan: ProofPlan) -> Enmities:
        """Return which lots must not meet: by their groups, and by what the lab lists."""
        called, avoids = _materials(self._elements, plan)
        for lot in self._groups:
            called[lot] = called.get(lot, frozenset()) | self._known(lot)
        found: dict[frozenset[str], str] = {}
        for two in combinations(sorted(called), 2):
            groups = [self._known(lot) for lot in two]
            for one, other, outcome, _ in CONFLICTS:
                if any(a in groups[0] and b in groups[1] for a, b in ((one, other), (other, one))):
                    found.setdefault(frozenset(two), outcome)
            if any(avoids.get(a, frozenset()) & called[b] for a, b in (two, two[::-1])):
                found.setdefault(frozenset(two), "the lab keeps them apart")
        return found

    def check_declared(self, plan: ProofPlan) -> list[Finding]:
        """List words that are none, and vessels that say more than the plan takes over."""
        findings = [
            Finding("interpret.chemistry", f"{word!r} of {lot} is no group", "groups")
            for lot, words in self._groups.items()
            for word in sorted(words - STREAMS.keys())
        ]
        findings += [
            Finding("interpret.chemistry", f"`{name}` of {key} is no list of words", key)
            for key, element in self._elements.items()
            for name in ("groups", "takes")
            if element.role is ElementRole.VESSEL and not _is_readable(_said(element, name))
        ]
        if self._met.enmities and not plan.keeps_apart:
            two = " and ".join(sorted(min(self._met.enmities, key=sorted)))
            message = f"{two} must not meet, and the plan does not say that any lots must not"
            findings.append(Finding("interpret.chemistry", message, "keeps_apart"))
        return [*findings, *self._check_vessels(plan)]

    def _check_vessels(self, plan: ProofPlan) -> Iterator[Finding]:
        """Yield a finding for words at a vessel that the plan says of none of its lots."""
        inside = {key: _lots(contents) for key, contents in plan.contents.items()}
        for lot, flasks in plan.bindings.reagents.items():
            for key in [flasks] if isinstance(flasks, str) else flasks:
                inside.setdefault(key, set()).add(lot)
        for key, element in sorted(self._elements.items()):
            said = {*(_words(element, "groups") or ())} & STREAMS.keys()
            lots = sorted(inside.get(key, ()))
            level = element.attributes.get("current_volume")
            is_held = bool(volume_nl(level, element.nl_per_unit))
            if not lots and said and (is_held or is_waste(element)):
                words = ", ".join(sorted(said))
                message = f"{key} holds something ({words}), and the plan does not say what"
                yield Finding("interpret.chemistry", message, "contents")
            missing = sorted(said.difference(*map(self._known, lots))) if lots else []
            if missing:
                what = f"{key} says that {' or '.join(lots)} is {', '.join(missing)}"
                yield Finding("interpret.chemistry", f"{what}; the plan does not", "groups")

    def pour(self, vessel: str, coming: Contents) -> Iterator[Finding]:
        """Yield a finding for a stream that a waste does not take."""
        element = self._elements.get(vessel)
        if element is None or not is_waste(element) or not self._takes:
            return
        sure = {lot for lot, amount in coming.liquids.items() if amount.least > 0}
        streams = {STREAMS[g] for lot in sure for g in self._known(lot)} - {""}
        unknown = sorted(lot for lot in sure if not self._known(lot))
        if strange := sorted(streams - self._takes.get(vessel, frozenset())) + unknown:
            message = f"{vessel} does not take {', '.join(strange)}"
            yield Finding("interpret.waste", message, vessel)

    def begin(self, before: Mapping[str, Contents], targets: Collection[str]) -> None:
        """Begin a step: what it brings its liquid onto may be in the syringes still."""
        onto = [before[key] for key in targets if key in before and key not in self._of_nobody]
        self._lines.begin()
        self._step = _Step(before, frozenset(item for held in onto for item in amounts(held)))

    def finish(self, came: Mapping[str, Came], now: Mapping[str, Contents]) -> Iterator[Finding]:
        """End a step: yield what came together in it that must not."""
        step, met = self._step, self._met
        flowed = {item for one in came.values() for item in one.amounts}
        ends = came.keys() | {source for one in came.values() for source in one.sources}
        traces = {key: met.traces(key, step.before.get(key, Contents())) for key in ends}
        for key, one in sorted(came.items()):
            gifts = [
                Gift(item, amount, self._company(one.sources, item))
                for item, amount in sorted(one.amounts.items())
            ]
            before = step.before.get(key, Contents())
            brought = _sum(traces[source] for source in one.sources if source != key)
            brought = {item: most for item, most in brought.items() if item not in flowed}
            film = _sum((brought, self._lines.carried(flowed))) if one.sources else {}
            if key in self._of_nobody:
                new = [*gifts, *(Gift(item, most, is_film=True) for item, most in film.items())]
                found = list(met.find(key, new))
                met.give(key, new)
            else:
                found = list(self._find_left(key, before, gifts))
                if one.sources:
                    found += self._find_carried(key, before, flowed, brought)
                if key not in one.sources:
                    found += met.find_traced(gifts, traces[key])
                met.mix(key, before, gifts, now.get(key, Contents()))
                own = self._lines.carried(flowed, key, amounts(before)) if one.sources else {}
                met.trace(key, _sum((brought, own)), now.get(key, Contents()))
            for text in found:
                yield Finding("interpret.incompatible", text, key)
        for key in ends - came.keys():
            if not amounts(now.get(key, Contents())):
                met.drain(key)
        self._lines.finish(frozenset(came))

    def fill_before(self, vessel: str, held: Contents) -> None:
        """Note what is in a vessel before the first step."""
        gifts = [Gift(item, amount) for item, amount in amounts(held).items()]
        if vessel in self._of_nobody:
            self._met.give(vessel, gifts)
        else:
            self._met.mix(vessel, Contents(), gifts, held)

    def empty(self, vessel: str) -> None:
        """Note that a person has emptied a vessel."""
        self._met.empty(vessel)

    def remember(self) -> WettedPast:
        """Return what is known now."""
        return WettedPast(self._lines.remember(), self._met.remember())

    def may_be(self, past: WettedPast) -> None:
        """Know from now on no more than that it is as here or as there."""
        self._met.may_be(past.met)
        self._lines.may_be(past.wetted)

    def pass_over(self, key: str, coming: Contents, origin: str) -> Iterator[Finding]:
        """Let liquid, or gas, go over a syringe or valve; yield what it must not meet."""
        element = self._elements.get(key)
        if element is None or element.role not in (ElementRole.PUMP, ElementRole.VALVE):
            return
        self._step.origins.add(origin)
        wet = self._lines.amounts_on(key)
        for new, films in self._lines.meet(key, origin, coming):
            company = {item: self._company((origin,), item) for item in new}
            there = {item: wet[item] for item in films - self._step.meant}
            if text := self._met.find_on_film(there, company):
                message = f"{text} in {key}, which was not rinsed between them"
                yield Finding("interpret.residue", message, key)
        self._lines.wet(key, origin, coming)

    def _company(self, sources: Collection[str], item: Item) -> Company:
        """Return what a lot has been with; what rested in a vessel came there in this step."""
        held = {key for key in sources if item in amounts(self._step.before.get(key, Contents()))}
        if sources and not held:
            held = {
                key
                for key in self._step.origins
                if item in amounts(self._step.before.get(key, Contents()))
            }
        return self._met.company(held, item)

    def _find_left(self, key: str, before: Contents, gifts: Collection[Gift]) -> Iterator[str]:
        """Yield what meets something that was in a vessel before the recipe began."""
        for item, amount in sorted(amounts(before).items()):
            for gift in gifts:
                outcome = self._met.outcome(item, gift.item)
                (lot, _), (other, _) = item, gift.item
                if outcome is None or self._left.isdisjoint((lot, other)):
                    continue
                known = self._met.company((key,), item).get(gift.item, 0)
                if gift.company.get(item, 0) + _GRAIN < amount and known + _GRAIN < gift.amount:
                    yield f"{other} meets {lot} ({outcome}) in {key}, and one of them was left"

    def _find_carried(
        self, key: str, before: Contents, flowed: Collection[Item], brought: Mapping[Item, int]
    ) -> Iterator[str]:
        """Yield what is carried onto an enemy in a vessel of the recipe by wet syringes and valves.

        Not what went over them into this vessel only, as long as it is there or has been with the
        enemy; nor where the enemy has been with as much of it as they carry. What wet lines have
        brought before into the vessel that it comes out of is carried on.
        """
        there = amounts(before)
        for enemy in sorted(there.keys() - flowed):
            known = self._met.company((key,), enemy)
            film = self._lines.carried(flowed, key, there.keys() | known.keys())
            for item, amount in sorted(_sum((film, brought)).items()):
                outcome = self._met.outcome(enemy, item)
                if outcome is not None and known.get(item, 0) + _GRAIN < amount:
                    what = f"{item[0]}, which wets the lines, meets {enemy[0]} ({outcome})"
                    yield f"{what} in {key}"

    def _known(self, lot: str) -> frozenset[str]:
        return self._groups.get(lot, frozenset()) & STREAMS.keys()


def _sum(films: Iterable[Mapping[Item, int]]) -> dict[Item, int]:
    found: dict[Item, int] = {}
    for film in films:
        for item, amount in film.items():
            found[item] = found.get(item, 0) + amount
    return found


def _materials(
    elements: Mapping[str, Element], plan: ProofPlan
) -> tuple[dict[str, frozenset[str]], dict[str, frozenset[str]]]:
    """Return lot → what materials that avoid it may list, and lot → what its own avoids."""
    owners: dict[str, set[str]] = {}
    for lot, flasks in plan.bindings.reagents.items():
        for key in [flasks] if isinstance(flasks, str) else flasks:
            owners.setdefault(key, set()).add(lot)
    called: dict[str, frozenset[str]] = {}
    avoids: dict[str, frozenset[str]] = {}
    for key, element in elements.items():
        for entry in _entries(element):
            names = {str(entry.get("material") or "")} - {""} | {*_listed(entry, "groups")}
            for lot in owners.get(key) or {str(entry.get("liquid_type"))}:
                called[lot] = called.get(lot, frozenset()) | names
                shuns = frozenset(_listed(entry, "incompatible_with"))
                avoids[lot] = avoids.get(lot, frozenset()) | shuns
    return called, avoids


def _entries(element: Element) -> Iterator[Mapping[str, object]]:
    data = element.attributes.get("data")
    listed = data.get("liquid") if isinstance(data, Mapping) else None
    if element.role is ElementRole.VESSEL and isinstance(listed, list):
        yield from (entry for entry in listed if isinstance(entry, Mapping))


def _listed(entry: Mapping[str, object], name: str) -> list[str]:
    said = entry.get(name)
    said = said.split(",") if isinstance(said, str) else said
    words = said if isinstance(said, list | tuple) else ()
    return [word.strip() for word in words if isinstance(word, str) and word.strip()]


def _stated(element: Element) -> set[str]:
    """Return the names under which a graph says that something is in a vessel."""
    own = str(_said(element, "chemical") or "").strip()
    return {own, f"contents of {element.key}"} | {
        str(entry.get("liquid_type")) for entry in _entries(element)
    }


def is_waste(element: Element) -> bool:
    """Tell whether a vessel is one for waste, by its class, or else by its type."""
    words = (element.kind.lower(), str(element.attributes.get("type") or "").lower())
    return element.role is ElementRole.VESSEL and any("waste" in word for word in words)


def _lots(contents: Contents) -> set[str]:
    both = (*contents.liquids.items(), *contents.solids.items())
    return {lot for lot, amount in both if amount.most > 0}


def _said(element: Element, name: str) -> object:
    """Return what a node says under a name, in itself or in its objects; None: nothing."""
    inner = (element.attributes.get(place) for place in ("config", "data"))
    for place in (element.attributes, *(one for one in inner if isinstance(one, Mapping))):
        found = place.get(name)
        if found is not None and not (isinstance(found, str) and not found.strip()):
            return found
    return None


def _is_readable(said: object) -> bool:
    if isinstance(said, str):
        return bool(said.replace(",", " ").strip())
    if isinstance(said, list | tuple):
        return all(isinstance(word, str) for word in said)
    return said is None


def _words(element: Element, name: str) -> list[str] | None:
    """Return the words that a node says; None: it says none, which an empty list does not."""
    said = _said(element, name)
    said = said.split(",") if isinstance(said, str) else said
    if not isinstance(said, list | tuple):
        return None
    return [word.strip() for word in said if isinstance(word, str) and word.strip()]
