"""Steps as written: every property read, every name looked up, everything wrong told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from labweb.domain.recipes.xdl.file_format.attribute_values import ParameterName, Value
from labweb.domain.recipes.xdl.file_format.findings import Findings, nearest
from labweb.domain.recipes.xdl.file_format.names_in_scope import HARDWARE, REAGENT, Missed, Scope
from labweb.domain.recipes.xdl.file_format.read_head import read_attribute
from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, XdlStep
from labweb.domain.recipes.xdl.file_format.xml_tree import Attribute, XmlElement
from labweb.domain.recipes.xdl.tables.step_spec import COMPONENT, Property, StepSpec, StepTable
from labweb.domain.recipes.xdl.tables.step_spec import REAGENT as REAGENT_PROPERTIES
from labweb.domain.recipes.xdl.tables.step_table import RENAMED_VALUES, SECTIONS

_AMOUNT_SORTS = frozenset({"amount", "amount_or_all", "volume_or_all"})
_AMOUNTS = frozenset({"volume", "mass", "moles", "amount"})
_NEVER_PARAMETERS = frozenset({"vessel", "reagent", "reagents", "text", "pid", "port", "through"})
_TAKES_FLASKS = frozenset({"Transfer", "CMove", "FilterThrough", "FilterTo"})
"""Steps whose vessel may also be the flask of a reagent."""

_OF_USE = {
    "equiv_reference": Property(name="equiv_reference", sort="text"),
    "equiv_amount": Property(name="equiv_amount", sort="amount"),
    "queue": Property(name="queue", sort="text"),
    "comment": Property(name="comment", sort="text"),
}
"""What every use of a blueprint may say beside the ids it maps."""


@dataclass(slots=True)
class StepReader:
    """Reads the steps of one procedure."""

    table: StepTable
    blueprints: Mapping[str, Procedure]
    told: Findings
    missed: list[Missed] = field(default_factory=list)
    """Names that are not declared; a blueprint's are judged where it is used."""

    pids: set[str] = field(default_factory=set)

    def read(self, procedure: XmlElement, scope: Scope) -> tuple[XdlStep, ...]:
        """Read all steps, in sections or without."""
        steps: list[XdlStep] = []
        for child in procedure.elements:
            if child.tag in SECTIONS:
                self._refuse_attributes(child)
                steps += [s for e in child.elements if (s := self._step(e, scope, child.tag))]
            elif (step := self._step(child, scope, "")) is not None:
                steps.append(step)
        return tuple(steps)

    def _refuse_attributes(self, section: XmlElement) -> None:
        for attribute in section.attributes:
            message = f"{attribute.name!r} is not a valid attribute for {section.tag}"
            self.told.tell("xdl.unknown_property", message, attribute.place)

    def _step(self, element: XmlElement, scope: Scope, section: str) -> XdlStep | None:
        blueprint = self.blueprints.get(element.tag)
        spec = self.table.spec(element.tag)
        if blueprint is not None:
            return self._use(element, blueprint, scope, section)
        if spec is None:
            known = [*self.table.steps, *self.blueprints]
            hint = nearest(element.tag, known)
            self.told.tell(
                "xdl.unknown_step", f"<{element.tag}> is no step of XDL{hint}", element.place
            )
            return None
        loop = self._loop(element, spec, scope)
        variables = {variable: _kind_of(attribute, value) for variable, attribute, value in loop}
        values = self._values(element, spec, scope)
        inner = scope.inside(variables)
        if spec.name == "Async" and isinstance(values.get("pid"), str):
            self.pids.add(str(values["pid"]))
        children = self._children(element, spec, inner, section)
        step = XdlStep(
            name=spec.name,
            values=values,
            children=children,
            section=section,
            loop=loop,
            place=element.place,
        )
        self._check_repeat(step)
        return step

    def _children(
        self, element: XmlElement, spec: StepSpec, scope: Scope, section: str
    ) -> tuple[XdlStep, ...]:
        if element.elements and not spec.has_children:
            message = f"{spec.name} holds no steps"
            self.told.tell("xdl.unexpected_children", message, element.elements[0].place)
            return ()
        if spec.has_children and not element.elements:
            self.told.tell("xdl.no_children", f"{spec.name} holds no step", element.place)
        return tuple(s for e in element.elements if (s := self._step(e, scope, section)))

    def _values(self, element: XmlElement, spec: StepSpec, scope: Scope) -> dict[str, Value]:
        values: dict[str, Value] = {}
        written: set[str] = set()
        for written_as in element.attributes:
            if spec.name == "Repeat" and "." in written_as.name and not _is_old(written_as.name):
                continue
            wanted, attribute = self._property(written_as, spec)
            if wanted is None or not (attribute.value.strip() or wanted.is_required):
                # The reference writes an empty text for what is not given.
                continue
            if wanted.name in written:
                message = f"{wanted.name!r} of {spec.name} is given twice"
                self.told.tell("xdl.property_twice", message, attribute.place)
            written.add(wanted.name)
            value = self._value(attribute, wanted, spec.name, scope)
            if value is not None:
                values[wanted.name] = value
        self._check_complete(element, spec, written)
        return values

    def _property(self, attribute: Attribute, spec: StepSpec) -> tuple[Property | None, Attribute]:
        name = attribute.name.removeprefix("param.")
        value = attribute.value
        if name not in spec.properties and name in spec.renamed:
            changed = RENAMED_VALUES.get(name, {})
            value = changed.get(value.lower(), value)
            name = spec.renamed[name]
        wanted = spec.properties.get(name)
        if wanted is None:
            hint = nearest(name, spec.properties)
            message = f"{attribute.name!r} is not a valid attribute for {spec.name}{hint}"
            self.told.tell("xdl.unknown_property", message, attribute.place)
        return wanted, Attribute(attribute.name, value, attribute.place)

    def _value(self, attribute: Attribute, wanted: Property, of: str, scope: Scope) -> Value | None:
        text = attribute.value
        if wanted.sort not in _NEVER_PARAMETERS and (
            text in scope.parameters or _is_old(attribute.name)
        ):
            return self._parameter(attribute, wanted, of, scope)
        value = read_attribute(attribute, wanted, of, self.told)
        if wanted.sort == "vessel" and value is not None:
            is_flask = of in _TAKES_FLASKS and scope.has_reagent(text)
            if not scope.has_vessel(text) and not is_flask:
                self._miss(HARDWARE, text, wanted.name, attribute)
        elif wanted.sort in {"reagent", "reagents"} and value is not None:
            for name in value if isinstance(value, tuple) else (text,):
                if not scope.has_reagent(str(name)):
                    self._miss(REAGENT, str(name), wanted.name, attribute)
        elif wanted.name == "pid" and of == "Await" and text not in self.pids:
            message = f"no Async before this Await has the pid {text!r}"
            self.told.tell("xdl.unknown_pid", message, attribute.place)
        return value

    def _miss(self, kind: str, name: str, prop: str, attribute: Attribute) -> None:
        missed = Missed(kind=kind, name=name, property=prop, place=attribute.place)
        self.missed.append(missed)

    def _parameter(
        self, attribute: Attribute, wanted: Property, of: str, scope: Scope
    ) -> Value | None:
        parameter = scope.parameters.get(attribute.value)
        if parameter is None:
            message = f"{attribute.name} of {of}: there is no Parameter {attribute.value!r:.60}"
            self.told.tell("xdl.no_parameter_value", message, attribute.place)
            return None
        fits = parameter.sort == wanted.sort or (
            wanted.sort in _AMOUNT_SORTS and parameter.sort in _AMOUNTS
        )
        if not fits:
            self.told.tell(
                "xdl.parameter_type",
                f"{attribute.name} of {of} is a {wanted.sort}, and Parameter {parameter.id!r} "
                f"is a {parameter.sort}",
                attribute.place,
            )
        return ParameterName(parameter.id)

    def _check_complete(self, element: XmlElement, spec: StepSpec, written: set[str]) -> None:
        missing = [p.name for p in spec.properties.values() if p.is_required]
        for name in missing:
            if name not in written:
                message = f"{spec.name} needs {name!r}"
                self.told.tell("xdl.missing_property", message, element.place)
        for group in spec.one_of:
            if not written.intersection(group):
                message = f"{spec.name} needs one of {', '.join(group)}"
                self.told.tell("xdl.missing_property", message, element.place)
        for group in spec.at_most_one:
            both = [name for name in group if name in written]
            if len(both) > 1:
                message = f"{spec.name} has {' and '.join(both)}: which of them counts?"
                self.told.tell("xdl.two_amounts", message, element.place)

    def _loop(
        self, element: XmlElement, spec: StepSpec, scope: Scope
    ) -> tuple[tuple[str, str, str], ...]:
        if spec.name != "Repeat":
            return ()
        found: list[tuple[str, str, str]] = []
        kinds: dict[str, str] = {}
        for attribute in element.attributes:
            variable, dot, name = attribute.name.rpartition(".")
            if not dot or _is_old(attribute.name):
                continue
            kind = _kind_of(name, attribute.value)
            if not kind:
                message = f"{name!r} is no property of a reagent or of hardware to match by"
                self.told.tell("xdl.unknown_property", message, attribute.place)
                continue
            if kinds.setdefault(variable, kind) != kind:
                message = f"the loop variable {variable!r} cannot be a reagent and hardware"
                self.told.tell("xdl.loop_kind", message, attribute.place)
            if scope.has_any(variable):
                message = f"the loop variable {variable!r} has the name of something declared"
                self.told.tell("xdl.duplicate_id", message, attribute.place)
            found.append((variable, name, attribute.value))
        return tuple(found)

    def _check_repeat(self, step: XdlStep) -> None:
        if step.name != "Repeat":
            return
        specs = [self.table.spec(child.name) for child in step.children]
        ways = {
            "a count": "repeats" in step.values,
            "loop variables": bool(step.loop),
            "a Monitor": any(spec is not None and spec.is_monitor for spec in specs),
        }
        used = [way for way, is_used in ways.items() if is_used]
        if len(used) != 1:
            told = " and ".join(used) or "neither a count nor loop variables nor a Monitor"
            message = f"a Repeat ends by exactly one of three ways; this one has {told}"
            self.told.tell("xdl.repeat_end", message, step.place)

    def _use(
        self, element: XmlElement, blueprint: Procedure, scope: Scope, section: str
    ) -> XdlStep:
        mapping: dict[str, str] = {}
        values: dict[str, Value] = {}
        for attribute in element.attributes:
            name = attribute.name.removeprefix("param.")
            if attribute.name in _OF_USE:
                value = read_attribute(attribute, _OF_USE[name], blueprint.id, self.told)
                if value is not None:
                    values[name] = value
            elif name in mapping:
                message = f"{name!r} of {blueprint.id} is given twice"
                self.told.tell("xdl.property_twice", message, attribute.place)
            else:
                mapping[name] = attribute.value
                self._check_mapping(attribute, name, blueprint, scope)
        self._check_mapped(element, blueprint, mapping)
        if element.elements:
            message = f"{blueprint.id} is a blueprint and holds no steps here"
            self.told.tell("xdl.unexpected_children", message, element.elements[0].place)
        return XdlStep(
            name=blueprint.id, values=values, mapping=mapping, section=section, place=element.place
        )

    def _check_mapping(
        self, attribute: Attribute, name: str, blueprint: Procedure, scope: Scope
    ) -> None:
        text = attribute.value
        parameter = next((p for p in blueprint.parameters if p.id == name), None)
        if blueprint.component(name) is not None:
            if not scope.has_vessel(text):
                self._miss(HARDWARE, text, name, attribute)
        elif any(name in {r.id, r.name} for r in blueprint.reagents):
            if not scope.has_reagent(text):
                self._miss(REAGENT, text, name, attribute)
        elif parameter is not None:
            wanted = Property(name=name, sort=parameter.sort)
            self._value(attribute, wanted, blueprint.id, scope)
        else:
            message = f"{name!r} is no id of hardware, reagent or parameter of {blueprint.id}"
            self.told.tell("xdl.unknown_mapping", message, attribute.place)

    def _check_mapped(
        self, element: XmlElement, blueprint: Procedure, mapping: Mapping[str, str]
    ) -> None:
        place = element.place
        for component in blueprint.hardware:
            if component.id not in mapping:
                message = f"{blueprint.id} is used without a vessel for {component.id!r}"
                self.told.tell("xdl.vessel_not_declared", message, place)
        for reagent in blueprint.reagents:
            if not reagent.name and reagent.id not in mapping:
                message = f"{blueprint.id} is used without a reagent for {reagent.id!r}"
                self.told.tell("xdl.reagent_not_declared", message, place)
        for parameter in blueprint.parameters:
            if parameter.value is None and parameter.id not in mapping:
                message = f"{blueprint.id} is used without a value for {parameter.id!r}"
                self.told.tell("xdl.no_parameter_value", message, place)


def _is_old(name: str) -> bool:
    return name.startswith("param.")


def _kind_of(attribute: str, value: str) -> str:
    """Say what a loop variable runs over, "" when the clause matches nothing known."""
    if attribute == "kind":
        return value if value in {HARDWARE, REAGENT} else ""
    if attribute in REAGENT_PROPERTIES and attribute not in COMPONENT:
        return REAGENT
    return HARDWARE if attribute in COMPONENT else ""
