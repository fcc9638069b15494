"""What a recipe declares before its steps: hardware, reagents, parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import Value, read_amount, read_value
from labweb.domain.recipes.xdl.file_format.findings import Findings, nearest
from labweb.domain.recipes.xdl.file_format.recipe_model import (
    Component,
    Procedure,
    Reagent,
    XdlParameter,
)
from labweb.domain.recipes.xdl.file_format.xml_tree import Attribute, XmlElement
from labweb.domain.recipes.xdl.tables.step_spec import (
    COMPONENT,
    METADATA,
    PARAMETER,
    REAGENT,
    Property,
)
from labweb.domain.recipes.xdl.tables.step_table import EARLY_COMPONENTS, PARAMETER_TYPES

_HABITS = (
    *("aqueous_cleaning_solvent", "auto_clean", "filter_dead_volume_method"),
    "organic_cleaning_solvent",
)
_SECTIONS = ("Metadata", "Hardware", "Parameters", "Reagents", "Procedure")


def read_head(element: XmlElement, told: Findings, *, is_blueprint: bool) -> Procedure:
    """Read everything of a Synthesis or Blueprint but its steps; tell what is wrong."""
    sections = _sections(element, told, is_blueprint=is_blueprint)
    if "Metadata" in sections:
        _check_attributes(sections["Metadata"], METADATA, told)
    hardware = [_component(e, told) for e in _entries(sections.get("Hardware"))]
    reagents = [
        _reagent(e, told, is_blueprint=is_blueprint) for e in _entries(sections.get("Reagents"))
    ]
    parameters = [_parameter(e, told) for e in _entries(sections.get("Parameters"))]
    procedure = Procedure(
        id=element.text_of("id"),
        hardware=tuple(c for c in hardware if c is not None),
        reagents=tuple(r for r in reagents if r is not None),
        parameters=tuple(p for p in parameters if p is not None),
        base_scale=_base_scale(sections.get("Procedure"), told, is_blueprint=is_blueprint),
        graph_sha256=element.text_of("graph_sha256"),
        habits=tuple(n for n in _HABITS if element.text_of(n).lower() not in ("", "false")),
        place=element.place,
    )
    _check_unique(procedure, told)
    _check_references(procedure, told)
    return procedure


def read_attribute(attribute: Attribute, wanted: Property, of: str, told: Findings) -> Value | None:
    """Read one attribute; None when it was refused and told."""
    try:
        return read_value(attribute.value, wanted)
    except UnitError as error:
        message = f"{attribute.name} of {of}: {error.message}"
        told.tell(error.code, message, attribute.place)
        return None


def _entries(section: XmlElement | None) -> tuple[XmlElement, ...]:
    return () if section is None else section.elements


def _sections(element: XmlElement, told: Findings, *, is_blueprint: bool) -> dict[str, XmlElement]:
    found: dict[str, XmlElement] = {}
    for child in element.elements:
        if child.tag not in _SECTIONS:
            hint = nearest(child.tag, _SECTIONS)
            told.tell(
                "xdl.unknown_section", f"<{child.tag}> is no section of XDL{hint}", child.place
            )
        elif child.tag in found:
            told.tell("xdl.section_twice", f"<{child.tag}> stands twice", child.place)
        else:
            found[child.tag] = child
    needed = ("Procedure",) if is_blueprint else ("Hardware", "Reagents", "Procedure")
    for name in needed:
        if name not in found:
            told.tell(
                "xdl.missing_section", f"<{element.tag}> has no <{name}> section", element.place
            )
    return found


def _check_attributes(
    element: XmlElement, known: Mapping[str, Property], told: Findings
) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for attribute in element.attributes:
        wanted = known.get(attribute.name)
        if wanted is None:
            hint = nearest(attribute.name, known)
            message = f"{attribute.name!r} is not a valid attribute for {element.tag}{hint}"
            told.tell("xdl.unknown_property", message, attribute.place)
            continue
        if not attribute.value.strip() and not wanted.is_required:
            continue
        value = read_attribute(attribute, wanted, element.tag, told)
        if value is not None:
            values[attribute.name] = value
    for wanted in known.values():
        if wanted.is_required and element.attribute(wanted.name) is None:
            message = f"{element.tag} needs {wanted.name!r}"
            told.tell("xdl.missing_property", message, element.place)
    return values


def _component(element: XmlElement, told: Findings) -> Component | None:
    early = EARLY_COMPONENTS.get(element.tag)
    if element.tag != "Component" and early is None:
        message = f"<{element.tag}> is no piece of hardware that XDL knows: write <Component>"
        told.tell("xdl.unknown_component", message, element.place)
        return None
    known = COMPONENT if early is None else {k: v for k, v in COMPONENT.items() if k != "type"}
    _check_attributes(element, known, told)
    name = element.text_of("id")
    if not name:
        return None
    return Component(
        id=name,
        type=early or element.text_of("type"),
        chemical=element.text_of("chemical"),
        place=element.place,
    )


def _reagent(element: XmlElement, told: Findings, *, is_blueprint: bool) -> Reagent | None:
    if element.tag != "Reagent":
        message = f"<{element.tag}> does not belong into <Reagents>"
        told.tell("xdl.unknown_section", message, element.place)
        return None
    values = _check_attributes(element, REAGENT, told)
    name, own_id = element.text_of("name"), element.text_of("id")
    if not name and not own_id:
        told.tell("xdl.missing_property", "Reagent needs 'name' or 'id'", element.place)
        return None
    return Reagent(
        id=own_id or name,
        # Before 0.4 a reagent had an id alone, which named the substance.
        name=name or ("" if is_blueprint else own_id),
        values=values,
        place=element.place,
    )


def _parameter(element: XmlElement, told: Findings) -> XdlParameter | None:
    if element.tag != "Parameter":
        message = f"<{element.tag}> does not belong into <Parameters>"
        told.tell("xdl.unknown_section", message, element.place)
        return None
    _check_attributes(element, PARAMETER, told)
    name, kind = element.text_of("id"), element.text_of("type")
    if not name or not kind:
        return None
    sort = PARAMETER_TYPES.get(kind)
    if sort is None:
        message = f"{kind!r} is no type of a Parameter; there are {', '.join(PARAMETER_TYPES)}"
        told.tell("xdl.unknown_choice", message, element.place)
        return None
    read = {}
    for role in ("value", "min", "max"):
        attribute = element.attribute(role)
        if attribute is not None:
            wanted = Property(name=role, sort=sort)
            read[role] = read_attribute(attribute, wanted, f"Parameter {name!r}", told)
    return XdlParameter(
        id=name,
        sort=sort,
        value=read.get("value"),
        least=read.get("min"),
        most=read.get("max"),
        place=element.place,
    )


def _base_scale(
    procedure: XmlElement | None, told: Findings, *, is_blueprint: bool
) -> Value | None:
    if procedure is None:
        return None
    scale: Value | None = None
    for attribute in procedure.attributes:
        if attribute.name != "base_scale" or not is_blueprint:
            message = f"{attribute.name!r} is not a valid attribute for Procedure"
            told.tell("xdl.unknown_property", message, attribute.place)
            continue
        try:
            found = read_amount(attribute.value)
        except UnitError as error:
            told.tell(error.code, f"base_scale: {error.message}", attribute.place)
            continue
        if found.sort != "moles" or not found.is_per_equivalent or not found.exact:
            message = "base_scale is an amount of substance per equivalent, such as 0.05 mol/eq"
            told.tell("xdl.bad_value", message, attribute.place)
        else:
            scale = found
    return scale


def _declared(procedure: Procedure) -> list[Component | Reagent | XdlParameter]:
    return [*procedure.hardware, *procedure.reagents, *procedure.parameters]


def _check_unique(procedure: Procedure, told: Findings) -> None:
    declared = _declared(procedure)
    count = Counter(entry.id for entry in declared)
    seen: set[str] = set()
    for entry in declared:
        if count[entry.id] > 1 and entry.id in seen and not _is_repeated(entry, procedure):
            message = f"the id {entry.id!r} is given to two things; each has its own"
            told.tell("xdl.duplicate_id", message, entry.place)
        seen.add(entry.id)
    _check_names(procedure, told)


def _check_names(procedure: Procedure, told: Findings) -> None:
    """Tell of two reagents of one name: steps and flasks that say it could mean either."""
    first: dict[str, Reagent] = {}
    for reagent in procedure.reagents:
        for name in sorted({reagent.id, reagent.name} - {""}):
            other = first.setdefault(name, reagent)
            if other.id != reagent.id:
                message = (
                    f"the reagents {other.id!r} at {other.place} and {reagent.id!r} at "
                    f"{reagent.place} are both called {name!r}: give each a name of its own"
                )
                told.tell("xdl.duplicate_name", message, reagent.place, first=str(other.place))


def _is_repeated(entry: Component | Reagent | XdlParameter, procedure: Procedure) -> bool:
    """Tell whether all that have this id say the same of the same sort: nothing is left open."""
    return all(other == entry for other in _declared(procedure) if other.id == entry.id)


def _check_references(procedure: Procedure, told: Findings) -> None:
    for reagent in procedure.reagents:
        for key in ("clean_with", "last_minute_addition"):
            other = reagent.values.get(key)
            if isinstance(other, str) and procedure.reagent(other) is None:
                message = f"{key} of {reagent.id!r} names {other!r}, which is not declared"
                told.tell("xdl.reagent_not_declared", message, reagent.place)
