"""What is declared of the chemistry of liquids and wastes; nothing is inferred from a name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, combinations

from labweb.domain.errors import Finding
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort
from labweb.domain.recipes.on_rig.stated import Stated, check_materials, materials_in, words_at
from labweb.domain.recipes.xdl.file_format.findings import nearest
from labweb.domain.recipes.xdl.file_format.recipe_model import Reagent
from labweb.domain.resources.compatibility_table import CONFLICTS, STREAMS
from labweb.domain.resources.substances_table import SUBSTANCES

TAKES = frozenset(stream for stream in STREAMS.values() if stream)
"""What a waste may say that it takes."""

_PAIRS: Mapping[frozenset[str], tuple[str, str]] = {
    frozenset((one, other)): (outcome, source) for one, other, outcome, source in CONFLICTS
}


@dataclass(frozen=True, slots=True)
class Clash:
    """Two lots that must not meet."""

    there: str
    coming: str
    outcome: str
    source: str

    def __str__(self) -> str:
        return f"{self.coming} must not meet {self.there} ({self.outcome}; {self.source})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chemistry:
    """Groups of the lots, and streams that wastes take."""

    groups: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Lot → its groups. Not named: nobody says, and no rule applies to it."""

    takes: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Waste → the streams that it says it takes; none says: the wastes are not divided."""

    apart: Mapping[frozenset[str], str] = field(default_factory=dict)
    """Two lots whose materials must not meet, as the lab lists it → the material that lists it."""

    def clash(self, there: Collection[str], coming: Collection[str]) -> Clash | None:
        """Return the first two lots that must not meet, of some that have never met."""
        for one in sorted(set(there)):
            for other in sorted(set(coming)):
                found = self.pair(one, other)
                if found is not None:
                    return Clash(one, other, *found)
        return None

    def told(self, there: str, coming: str) -> Clash:
        """Say of two lots that must not meet what would come of it."""
        return Clash(there, coming, *(self.pair(there, coming) or ("", "")))

    def pairs(self) -> set[frozenset[str]]:
        """Return all lots, two by two, that must not meet."""
        lots = sorted({*self.groups, *chain(*self.apart)})
        both = (frozenset(two) for two in combinations(lots, 2))
        return {two for two in both if self.pair(*sorted(two)) is not None}

    def pair(self, one: str, other: str) -> tuple[str, str] | None:
        """Return what comes of two lots that must not meet, and who says so; None: nobody does."""
        if one == other:
            return None
        listed = self.apart.get(frozenset((one, other)))
        if listed is not None:
            return "the lab keeps them apart", f"`incompatible_with` of {listed}"
        return next(
            (
                _PAIRS[pair]
                for a in sorted(self.groups.get(one, ()))
                for b in sorted(self.groups.get(other, ()))
                if (pair := frozenset((a, b))) in _PAIRS
            ),
            None,
        )

    def unknown(self, lots: Iterable[str]) -> list[str]:
        """Return the lots of which nobody says the groups."""
        return sorted(lot for lot in lots if not self.groups.get(lot))

    def streams(self, lots: Iterable[str]) -> frozenset[str]:
        """Return the streams of waste that lots belong to."""
        groups = {group for lot in lots for group in self.groups.get(lot, ())}
        return frozenset(STREAMS[group] for group in groups if STREAMS[group])


def read_chemistry(
    equipment: Equipment,
    reagents: Iterable[Reagent],
    flasks: Mapping[str, Collection[str]],
    declared: Mapping[str, Collection[str]],
    held: Mapping[str, Collection[str]] | None = None,
) -> tuple[Chemistry, list[Finding]]:
    """Read what is declared of reagents, of what is in vessels, and of wastes.

    Args:
        equipment: The rig. A vessel may say the `groups` of what is in it, a waste what it `takes`.
        reagents: Those of the recipe, with their CAS numbers.
        flasks: Reagent → the flasks that it is taken from.
        declared: Lot → groups that a person states.
        held: Vessel → lots that a person says are in it.

    Returns:
        The chemistry, and a finding for each word that is none, and for each vessel whose words
        may be of one of its lots or of another.
    """
    at_vessels, odd = words_at(equipment, "groups")
    at_wastes, odd_wastes = words_at(equipment, "takes")
    findings = [
        *odd,
        *odd_wastes,
        *check_materials(equipment),
        *_strange("the groups of", declared, STREAMS),
        *_strange("the groups at", at_vessels, STREAMS),
        *_strange("what is taken by", at_wastes, TAKES),
    ]
    known: dict[str, frozenset[str]] = {}
    for key in equipment.vessels:
        for material in materials_in(equipment, key):
            named = set(material.groups) or _tabled(inchikey=material.inchikey)
            if named & STREAMS.keys():
                known.setdefault(material.name, frozenset(named & STREAMS.keys()))
    by_id = {reagent.id: reagent for reagent in reagents}
    inside = lots_at(equipment, flasks, held or {})
    for lot in sorted({*by_id, *flasks, *declared, *chain(*inside.values())}):
        said = {*declared.get(lot, ())} | (set() if lot in flasks else {*known.get(lot, ())})
        for key in (key for key, lots in inside.items() if lot in lots):
            said |= {*at_vessels.get(key, ())} if len(inside[key]) == 1 else set()
        for key in flasks.get(lot, ()):
            names = [material.name for material in materials_in(equipment, key)]
            said |= {*known.get(names[0], ())} if len(names) == 1 else set()
        named = said & STREAMS.keys() or _of_reagent(by_id.get(lot))
        if named:
            known[lot] = frozenset(named)
    findings += _unassigned(equipment, at_vessels, inside, known)
    findings += [
        Finding("xdl.not_declared", f"groups are stated of {lot!r}, which is nowhere used", lot)
        for lot in sorted(declared.keys() - by_id.keys() - {*chain(flasks, *inside.values())})
    ]
    takes = {
        key: frozenset(words) & TAKES
        for key, words in at_wastes.items()
        if equipment.sort(key) is VesselSort.WASTE
    }
    apart = _apart(equipment, flasks, inside, known)
    return Chemistry(groups=known, takes=takes, apart=apart), findings


def _apart(
    equipment: Equipment,
    flasks: Mapping[str, Collection[str]],
    inside: Mapping[str, Collection[str]],
    known: Mapping[str, Collection[str]],
) -> dict[frozenset[str], str]:
    """Return the lots that materials of the lab list each other as incompatible with."""
    materials: dict[str, list[Stated]] = {}
    for key, lots in inside.items():
        for material in materials_in(equipment, key):
            for lot in lots:
                if lot == material.name or key in flasks.get(lot, ()):
                    materials.setdefault(lot, []).append(material)
    called = {
        lot: {*known.get(lot, ()), *chain(*(one.called for one in materials.get(lot, ())))}
        for lot in sorted({*materials, *known})
    }
    return {
        frozenset((lot, other)): material.name
        for lot, own in sorted(materials.items())
        for material in own
        for other in called.keys() - {lot}
        if material.incompatible_with & called[other]
    }


def lots_at(
    equipment: Equipment,
    flasks: Mapping[str, Collection[str]],
    held: Mapping[str, Collection[str]],
) -> dict[str, set[str]]:
    """Return the lots of each vessel before the first step: a flask of a reagent holds that."""
    bound: dict[str, set[str]] = {}
    for lot, keys in flasks.items():
        for key in keys:
            bound.setdefault(key, set()).add(lot)
    return {
        key: (bound.get(key) or {name for name, _ in equipment.contents(key)})
        | {*held.get(key, ())}
        for key in equipment.vessels
    }


def _unassigned(
    equipment: Equipment,
    at_vessels: Mapping[str, Collection[str]],
    inside: Mapping[str, Collection[str]],
    known: Mapping[str, Collection[str]],
) -> Iterator[Finding]:
    """Yield a finding for words at a vessel that are of none of its lots for certain."""
    for key, words in sorted(at_vessels.items()):
        lots = sorted(inside[key])
        if words and not lots and equipment.sort(key) is VesselSort.WASTE:
            message = (
                f"{key} says {', '.join(sorted(words))} and not that anything is in it: say how "
                "much (`current_volume`), or take the words away where it is empty"
            )
            yield Finding("plan.unknown_chemistry", message, key, {"lots": []})
        open_words = {*words} & STREAMS.keys() - {*chain(*(known.get(lot, ()) for lot in lots))}
        if len(lots) > 1 and open_words:
            message = (
                f"{key} says {', '.join(sorted(open_words))} and holds {', '.join(lots)}, and "
                "nobody says which of them is that: declare the groups of each"
            )
            yield Finding("plan.unknown_chemistry", message, key, {"lots": lots})


def _of_reagent(reagent: Reagent | None) -> set[str]:
    """Return the groups of a reagent that its number names, and that is it, pure."""
    if reagent is None or reagent.values.get("concentration") is not None:
        return set()
    return _tabled(cas=str(reagent.values.get("cas") or ""), is_solid=reagent.is_solid)


def _tabled(*, cas: str = "", inchikey: str = "", is_solid: bool = False) -> set[str]:
    for number, key, _, is_liquid, groups in SUBSTANCES:
        if (cas and cas == number) or (inchikey and inchikey == key):
            return set(groups.split()) if is_liquid or is_solid else set()
    return set()


def _strange(
    what: str, stated: Mapping[str, Collection[str]], words: Collection[str]
) -> Iterator[Finding]:
    for name, said in sorted(stated.items()):
        for word in said:
            if word not in words:
                message = f"{what} {name}: {word!r} is none of them{nearest(word, words)}"
                yield Finding("plan.unknown_group", message, name, {"allowed": sorted(words)})
