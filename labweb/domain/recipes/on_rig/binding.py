"""Which vessel of the rig each vessel and reagent of a recipe is: never by a name that is alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal

from labweb.domain.errors import Finding
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort
from labweb.domain.recipes.on_rig.labels import LISTED, alike, held
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation
from labweb.domain.recipes.xdl.file_format.findings import Findings, nearest
from labweb.domain.recipes.xdl.file_format.recipe_model import Component, Procedure, Reagent
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace

_VESSEL_FIELDS = ("vessel", "source", "target", "lower_to", "upper_to")
_REAGENT_FIELDS = {
    BasicKind.ADD_LIQUID: "reagent",
    BasicKind.ADJUST: "reagent",
    BasicKind.RINSE_LINES: "solvent",
}
_KINDS = {
    "reactor": VesselSort.REACTOR,
    "filter": VesselSort.FILTER,
    "separator": VesselSort.SEPARATOR,
    "rotavap": VesselSort.ROTAVAP,
    "ikarv10": VesselSort.ROTAVAP,
    "centrifuge": VesselSort.CENTRIFUGE,
    "waste": VesselSort.WASTE,
    "flask": VesselSort.FLASK,
    "bufferflask": VesselSort.FLASK,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RigBinding:
    """What stands for what."""

    vessels: Mapping[str, str]
    """Id of the recipe → id of the graph."""

    reagents: Mapping[str, tuple[str, ...]]
    """Reagent → the flasks of the graph that it can be taken from."""

    fillings: Mapping[str, str] = field(default_factory=dict)
    """Filling that somebody chose a cartridge for → the cartridge."""

    notes: tuple[str, ...] = ()

    def flasks(self) -> frozenset[str]:
        """Return every flask that some reagent is taken from."""
        return frozenset(key for keys in self.reagents.values() for key in keys)


@dataclass(slots=True)
class _Use:
    """What the recipe does with a vessel."""

    place: FilePlace = NOWHERE
    is_stirred: bool = False
    temperatures: list[Decimal] = field(default_factory=list)


def bind(
    procedure: Procedure,
    operations: Iterable[BasicOperation],
    equipment: Equipment,
    given: Mapping[str, str],
    told: Findings,
    rinse: Iterable[str] = (),
) -> RigBinding:
    """Bind every vessel and liquid reagent that the recipe uses; tell all that cannot be.

    A vessel is the one of the same id and sort, the one that `given` names, or the only one of
    its sort that can do what is asked of it. A reagent is in the flasks that hold exactly it, and
    so is what lines are rinsed with, which the recipe need not declare.
    """
    operations = list(operations)
    _check_given(procedure, equipment, given, told)
    uses = _uses(operations)
    binder = _Binder(procedure, equipment, given, told)
    reagents = binder.reagents(operations, uses, rinse)
    vessels = binder.vessels({name: use for name, use in uses.items() if name not in reagents})
    binder.check_apart(reagents, vessels, uses)
    fillings = {name: key for name, key in given.items() if key in equipment.cartridges}
    notes = tuple(binder.notes)
    return RigBinding(vessels=vessels, reagents=reagents, fillings=fillings, notes=notes)


def _uses(operations: Iterable[BasicOperation]) -> dict[str, _Use]:
    uses: dict[str, _Use] = {}
    for operation in operations:
        for name in _VESSEL_FIELDS:
            value = operation.fields.get(name)
            if not isinstance(value, str) or value.startswith("@"):
                continue
            use = uses.setdefault(value, _Use(place=operation.place))
            use.is_stirred |= operation.kind is BasicKind.START_STIR
            temperature = operation.fields.get("temperature_c")
            if isinstance(temperature, Decimal):
                use.temperatures.append(temperature)
    return uses


def _check_given(
    procedure: Procedure, equipment: Equipment, given: Mapping[str, str], told: Findings
) -> None:
    names = {c.id for c in procedure.hardware} | {r.id for r in procedure.reagents}
    for name, key in given.items():
        if name not in names:
            hint = nearest(name, names)
            told.all.append(
                Finding("plan.unknown_role", f"the recipe declares no {name!r}{hint}", name)
            )
        if key not in equipment.elements:
            hint = nearest(key, equipment.elements)
            message = f"{name} is bound to {key!r}, which is not in the graph{hint}"
            told.all.append(Finding("plan.unknown_vessel", message, key))


class _Binder:
    def __init__(
        self,
        procedure: Procedure,
        equipment: Equipment,
        given: Mapping[str, str],
        told: Findings,
    ) -> None:
        self._procedure = procedure
        self._equipment = equipment
        self._given = given
        self._told = told
        self.notes: list[str] = []

    def reagents(
        self, operations: Iterable[BasicOperation], uses: Mapping[str, _Use], rinse: Iterable[str]
    ) -> dict[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = {}
        wanted = self._wanted(operations, uses, rinse)
        for name, place in wanted.items():
            known = self._procedure.reagent(name)
            keys = self._flasks(Reagent(id=name, name=name) if known is None else known)
            if keys:
                found[name] = keys
                self._say_where(name, keys)
                self._say_label(name, keys[0], {name} if known is None else {known.id, known.name})
            elif name in self._given:
                self._refuse_given(name, place)
            else:
                self._miss(name, place)
        self._check_shared(found, wanted)
        return found

    def _check_shared(
        self, found: Mapping[str, tuple[str, ...]], wanted: Mapping[str, FilePlace]
    ) -> None:
        """Tell which reagents would come out of one flask: that holds one of them at most."""
        for key in sorted({key for keys in found.values() for key in keys}):
            names = [name for name, keys in found.items() if key in keys]
            if len(names) > 1:
                held = sorted(self._holds(key))
                says = f"says that it holds {', '.join(held)}" if held else "says nothing"
                message = (
                    f"{' and '.join(repr(name) for name in names)} would come out of {key}, which "
                    f"{says}: a flask holds one reagent, so bind each to a flask of its own"
                )
                facts = {"vessel": key, "reagents": names, "holds": held}
                self._told.tell("plan.shared_flask", message, wanted[names[-1]], **facts)

    def _wanted(
        self, operations: Iterable[BasicOperation], uses: Mapping[str, _Use], rinse: Iterable[str]
    ) -> dict[str, FilePlace]:
        wanted: dict[str, FilePlace] = {}
        for operation in operations:
            name = operation.fields.get(_REAGENT_FIELDS.get(operation.kind, ""))
            if isinstance(name, str):
                wanted.setdefault(name, operation.place)
        for name, use in uses.items():
            is_reagent = any(r.id == name for r in self._procedure.reagents)
            if is_reagent and name not in self._equipment.vessels:
                wanted.setdefault(name, use.place)
        for reagent in self._procedure.reagents:
            if reagent.values.get("use_for_cleaning") is not True:
                continue
            if reagent.id in self._given or self._flasks(reagent):
                wanted.setdefault(reagent.id, reagent.place)
            elif reagent.id not in wanted:
                self.notes.append(
                    f"no flask of the rig holds {reagent.id}, which the recipe cleans with: no "
                    "line is rinsed with it"
                )
        for name in rinse:
            wanted.setdefault(name, self._procedure.place)
        return wanted

    def _say_where(self, name: str, keys: tuple[str, ...]) -> None:
        if len(keys) > 1:
            listed = ", ".join(keys[:LISTED])
            self.notes.append(
                f"{name} is in {listed}: each vessel gets it from the one with the shortest way, "
                "unless one is chosen by hand"
            )

    def _say_label(self, name: str, key: str, own: set[str]) -> None:
        """Note what a vessel that was chosen by hand says of itself, where it says another."""
        other = sorted(self._holds(key) - own)
        if name in self._given and other:
            self.notes.append(
                f"{name} is {key}, as chosen by hand: the label or contents of {key} say "
                f"{', '.join(other)}"
            )

    def _refuse_given(self, name: str, place: FilePlace) -> None:
        """Tell that what was chosen by hand for something that holds liquid holds none."""
        key = self._given[name]
        if key in self._equipment.elements:
            kind = self._equipment.elements[key].kind
            message = f"{name} is bound to {key} ({kind}), which is no vessel: bind one for liquid"
            self._told.tell("plan.not_a_vessel", message, place, vessel=key)

    def _miss(self, name: str, place: FilePlace) -> None:
        """Tell that a reagent is nowhere, and what is there that looks like it."""
        mixed = [key for key in self._flask_keys() if {name} < self._holds(key)]
        if mixed:
            held = " and ".join(sorted(self._holds(mixed[0])))
            message = (
                f"{mixed[0]} holds {held}, and {name!r} is needed by itself: name a flask of it"
            )
            self._told.tell("plan.mixed_flask", message, place, vessel=mixed[0], reagent=name)
            return
        looks = alike(name, self._equipment)
        if looks:
            hint = "; ".join(f"{key} holds {label!r}" for key, label in looks.items())
            what = f"{hint}: choose it by hand if it is the same"
        else:
            what = "name the flask in the graph, or choose one by hand"
        message = f"no flask of the rig holds {name!r}: {what}"
        facts: dict[str, object] = {"reagent": name, "alike": list(looks)}
        if any(label.casefold() == name.casefold() for label in looks.values()):
            facts["differs_in_case_alone"] = True
        self._told.tell("plan.no_reagent", message, place, **facts)

    def _flasks(self, reagent: Reagent) -> tuple[str, ...]:
        if reagent.id in self._given:
            key = self._given[reagent.id]
            return (key,) if key in self._equipment.vessels else ()
        names = {reagent.id, reagent.name}
        return tuple(key for key in self._flask_keys() if set() < self._holds(key) <= names)

    def _flask_keys(self) -> list[str]:
        vessels = self._equipment.vessels.items()
        return [key for key, sort in vessels if sort in (VesselSort.FLASK, VesselSort.PLAIN)]

    def _holds(self, key: str) -> set[str]:
        return held(self._equipment, key)

    def vessels(self, uses: Mapping[str, _Use]) -> dict[str, str]:
        found: dict[str, str] = {}
        open_: dict[str, list[str]] = {}
        for name, use in uses.items():
            component = self._procedure.component(name)
            key = self._given.get(name, name)
            if key in self._equipment.vessels:
                if self._fits(component, key, use):
                    found[name] = key
                    self._say_label(name, key, {component.chemical} if component else set())
            elif name in self._given:
                self._refuse_given(name, use.place)
            else:
                open_[name] = self._candidates(component, use, name)
        self._assign(open_, found, uses)
        self._say_shared(found)
        return found

    def check_apart(
        self,
        reagents: Mapping[str, tuple[str, ...]],
        vessels: Mapping[str, str],
        uses: Mapping[str, _Use],
    ) -> None:
        """Tell which vessels of the recipe are the flask that a reagent comes out of."""
        flasks = {key: name for name, keys in reagents.items() for key in keys}
        for name, key in vessels.items():
            if key in flasks:
                message = (
                    f"the vessel {name!r} would be {key}, which {flasks[key]!r} comes out of: a "
                    "flask of a reagent holds that alone, so bind one of them to another vessel"
                )
                facts = {
                    "vessel": key,
                    "reagents": [flasks[key]],
                    "holds": sorted(self._holds(key)),
                }
                self._told.tell("plan.shared_flask", message, uses[name].place, **facts)

    def _say_shared(self, found: Mapping[str, str]) -> None:
        for key in sorted({*found.values()}):
            names = [name for name, own in found.items() if own == key]
            if len(names) > 1:
                self.notes.append(f"{' and '.join(names)} are one vessel of the rig, {key}")

    def _fits(self, component: Component | None, key: str, use: _Use) -> bool:
        kind, sort = _kind(component), self._equipment.sort(key)
        if may_be(component, sort):
            return True
        message = f"{component.id if component else key} is a {kind} and {key} a {sort}"
        self._told.tell("plan.wrong_kind", message, use.place)
        return False

    def _candidates(self, component: Component | None, use: _Use, name: str) -> list[str]:
        kind = _kind(component)
        if kind is None:
            message = (
                f"the rig has no vessel {name!r}{nearest(name, self._equipment.vessels)}, and the "
                "recipe does not say what sort it is"
            )
            self._told.tell("plan.no_vessel", message, use.place)
            return []
        of_kind = [
            key
            for key, sort in self._equipment.vessels.items()
            if sort is kind and not self._is_full(key) and key not in self._named()
            if not self._equipment.is_receiver(key)
        ]
        able = [key for key in of_kind if self._is_able(key, use)]
        if not of_kind:
            message = f"the rig has no {kind} for {name!r}; choose another by hand"
            self._told.tell("plan.no_vessel", message, use.place, role=name, sort=str(kind))
        return able or of_kind

    def _is_full(self, key: str) -> bool:
        """Tell whether it is labelled, or a flask that holds something: no empty vessel."""
        if self._equipment.sort(key) in (VesselSort.FLASK, VesselSort.PLAIN):
            return bool(held(self._equipment, key))
        return bool(self._equipment.chemical(key))

    def _named(self) -> set[str]:
        return {*self._given.values(), *(c.id for c in self._procedure.hardware)}

    def _is_able(self, key: str, use: _Use) -> bool:
        if use.is_stirred and not self._equipment.stirrer(key):
            return False
        near = self._equipment.thermostats(key)
        return all(any(t.covers(temp) for t in near) for temp in use.temperatures)

    def _assign(
        self, open_: dict[str, list[str]], found: dict[str, str], uses: Mapping[str, _Use]
    ) -> None:
        """Give each open vessel the only one that is left for it, as long as there is one."""
        while True:
            taken = set(found.values())
            left = {n: [k for k in keys if k not in taken] for n, keys in open_.items()}
            forced = next((n for n, keys in left.items() if len(keys) == 1 and n not in found), "")
            if not forced:
                break
            found[forced] = left[forced][0]
            sort = self._equipment.sort(found[forced])
            self.notes.append(
                f"{forced} is {found[forced]}, the only {sort} of the rig that it can be"
            )
        for name, keys in left.items():
            if name in found or not open_[name]:
                continue
            listed = ", ".join(keys[:LISTED])
            message = (
                f"{name!r} may be any of {listed}: choose one by hand"
                if keys
                else f"every vessel that {name!r} could be is another of the recipe's"
            )
            facts = {"role": name, "sort": str(_kind(self._procedure.component(name)))}
            self._told.tell(
                "plan.vessel_ambiguous" if keys else "plan.no_vessel",
                message,
                uses[name].place,
                **facts,
            )


def may_be(component: Component | None, sort: VesselSort) -> bool:
    """Tell whether a vessel of a sort can be what a recipe declares; None: it declares nothing."""
    kind = _kind(component)
    if kind is None or kind == sort or VesselSort.PLAIN in (kind, sort):
        return True
    # A flask is what holds liquid: a recipe may call any vessel one.
    return kind is VesselSort.FLASK or (kind is VesselSort.REACTOR and sort is VesselSort.FLASK)


def _kind(component: Component | None) -> VesselSort | None:
    if component is None:
        return None
    return _KINDS.get(component.type.lower().replace("_", "").removeprefix("chemputer"))
