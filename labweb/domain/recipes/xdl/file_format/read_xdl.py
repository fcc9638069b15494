"""Reads XDL of every version, whole or not at all: everything wrong is listed at once.

Shapes:
    `<Synthesis>` or `<XDL>` with blueprints and one or more syntheses. Names are looked up where
    they are used; inside a blueprint, the names that a use maps count too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.recipes.xdl.file_format.findings import Findings, nearest
from labweb.domain.recipes.xdl.file_format.names_in_scope import HARDWARE, Missed, scope_of
from labweb.domain.recipes.xdl.file_format.read_head import read_head
from labweb.domain.recipes.xdl.file_format.read_steps import StepReader
from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, Recipe, XdlStep
from labweb.domain.recipes.xdl.file_format.xml_tree import (
    Instruction,
    XmlDocument,
    XmlElement,
    parse_markup,
)
from labweb.domain.recipes.xdl.tables.step_spec import STEPS, SYNTHESIS, StepTable

_VERSION = re.compile(r"version\s*=\s*[\"']([^\"']{1,20})[\"']")
_KNOWN_VERSION = re.compile(r"(?:0\.[1-5](?:\.[0-9]{1,3})?|1(?:\.[0-9]{1,3}){0,2}|2(?:\.0){0,2})")


def read_xdl(
    raw: bytes,
    *,
    table: StepTable = STEPS,
    rig_vessels: frozenset[str] = frozenset(),
    library: Sequence[XmlDocument] = (),
) -> Recipe:
    """Read an XDL file.

    Args:
        raw: The file.
        table: Steps to know; more than the standard's when a platform adds its own.
        rig_vessels: Ids of vessels of a rig that steps may name without declaring them.
        library: Files whose blueprints the recipe may use.

    Raises:
        ProtocolError: The file is no XDL, or says something XDL does not; `findings` list
            everything, each with line and column. Nothing is guessed or dropped.
    """
    recipe, findings = check_document(
        parse_markup(raw), table=table, rig_vessels=rig_vessels, library=library
    )
    if findings:
        raise refusal(findings)
    return recipe


def refusal(findings: list[Finding], what: str = "recipe") -> ProtocolError:
    """Build the error of a recipe with findings."""
    count = len(findings)
    more = f" (and {count - 1} more)" if count > 1 else ""
    first = findings[0]
    message = f"the {what} is refused: {first.message}, at {first.subject}{more}"
    return ProtocolError(message, code=first.code, findings=findings)


def check_document(
    document: XmlDocument,
    *,
    table: StepTable = STEPS,
    rig_vessels: frozenset[str] = frozenset(),
    library: Sequence[XmlDocument] = (),
) -> tuple[Recipe, list[Finding]]:
    """Read a tree as a recipe, and list everything that is wrong with it."""
    told = Findings()
    version = _version(document, told)
    syntheses, blueprints = _tops(document.root, told)
    for other in library:
        for child in other.root.elements:
            if child.tag == "Blueprint":
                _take_blueprint(child, blueprints, told)
    heads = {
        name: read_head(element, told, is_blueprint=True) for name, element in blueprints.items()
    }
    reader = _Bodies(table, heads, told, rig_vessels)
    bodies = {name: reader.blueprint(blueprints[name], head) for name, head in heads.items()}
    read = [reader.synthesis(element) for element in syntheses]
    reader.judge_blueprints(bodies, read)
    recipe = Recipe(document=document, version=version, syntheses=tuple(read), blueprints=bodies)
    return recipe, sorted(told.all, key=_order)


def _order(finding: Finding) -> tuple[int, int]:
    return finding.context.get("line", 0), finding.context.get("column", 0)


def check_available(recipe: Recipe, available: frozenset[str]) -> list[Finding]:
    """List the declared hardware that a laboratory does not have, by id."""
    told = Findings()
    for synthesis in recipe.syntheses:
        for component in synthesis.hardware:
            if component.id not in available:
                message = (
                    f"the laboratory has no {component.id!r}{nearest(component.id, available)}"
                )
                told.tell("xdl.vessel_not_available", message, component.place)
    return told.all


def _version(document: XmlDocument, told: Findings) -> str:
    for node in document.before:
        if isinstance(node, Instruction) and node.target == "xdl":
            match = _VERSION.search(node.text)
            version = match[1] if match else ""
            if not _KNOWN_VERSION.fullmatch(version):
                message = f"XDL of version {version!r} is not read; 0.1 to 2.0 are"
                told.tell("xdl.unknown_version", message, document.root.place)
            return version
    return ""


def _tops(root: XmlElement, told: Findings) -> tuple[list[XmlElement], dict[str, XmlElement]]:
    if root.tag == "Synthesis":
        return [root], {}
    if root.tag != "XDL":
        told.tell("xdl.root", f"the root is <{root.tag}>, not <XDL> or <Synthesis>", root.place)
        return [], {}
    syntheses: list[XmlElement] = []
    blueprints: dict[str, XmlElement] = {}
    for child in root.elements:
        if child.tag == "Synthesis":
            syntheses.append(child)
        elif child.tag == "Blueprint":
            _take_blueprint(child, blueprints, told)
        else:
            hint = nearest(child.tag, ("Synthesis", "Blueprint"))
            message = f"<{child.tag}> does not belong into <XDL>{hint}"
            told.tell("xdl.unknown_section", message, child.place)
    for attribute in root.attributes:
        message = f"{attribute.name!r} is not a valid attribute for XDL"
        told.tell("xdl.unknown_property", message, attribute.place)
    if not syntheses:
        told.tell("xdl.missing_section", "the file holds no <Synthesis>", root.place)
    return syntheses, blueprints


def _take_blueprint(element: XmlElement, found: dict[str, XmlElement], told: Findings) -> None:
    name = element.text_of("id")
    for attribute in element.attributes:
        if attribute.name not in {"id", "comment"}:
            message = f"{attribute.name!r} is not a valid attribute for Blueprint"
            told.tell("xdl.unknown_property", message, attribute.place)
    if not name:
        told.tell("xdl.missing_property", "Blueprint needs 'id'", element.place)
    elif STEPS.spec(name) is not None:
        message = f"the blueprint {name!r} has the name of a step"
        told.tell("xdl.duplicate_id", message, element.place)
    elif name in found:
        message = f"there are two blueprints {name!r}"
        told.tell("xdl.duplicate_id", message, element.place)
    else:
        found[name] = element


class _Bodies:
    """Reads the steps of syntheses and blueprints."""

    def __init__(
        self,
        table: StepTable,
        heads: Mapping[str, Procedure],
        told: Findings,
        rig_vessels: frozenset[str],
    ) -> None:
        self._table = table
        self._heads = heads
        self._told = told
        self._rig_vessels = rig_vessels
        self._missed: dict[str, list[Missed]] = {}

    def blueprint(self, element: XmlElement, head: Procedure) -> Procedure:
        steps, self._missed[head.id] = self._steps(element, head)
        return replace(head, steps=steps)

    def synthesis(self, element: XmlElement) -> Procedure:
        head = read_head(element, self._told, is_blueprint=False)
        for attribute in element.attributes:
            if attribute.name not in SYNTHESIS:
                hint = nearest(attribute.name, SYNTHESIS)
                message = f"{attribute.name!r} is not a valid attribute for Synthesis{hint}"
                self._told.tell("xdl.unknown_property", message, attribute.place)
        if head.graph_sha256:
            # A compiled recipe is bound to one graph; its steps are that compiler's own.
            return head
        steps, missed = self._steps(element, head)
        for miss in missed:
            self._tell(miss)
        return replace(head, steps=steps)

    def _steps(
        self, element: XmlElement, head: Procedure
    ) -> tuple[tuple[XdlStep, ...], list[Missed]]:
        procedure = next((e for e in element.elements if e.tag == "Procedure"), None)
        if procedure is None:
            return (), []
        reader = StepReader(self._table, self._heads, self._told)
        scope = scope_of(head, self._rig_vessels)
        return reader.read(procedure, scope), reader.missed

    def judge_blueprints(
        self, blueprints: Mapping[str, Procedure], syntheses: list[Procedure]
    ) -> None:
        """Tell the names in blueprints that neither they nor a use of them knows."""
        uses: list[_Use] = [(None, step) for p in syntheses for step in _all_steps(p.steps)]
        uses += [(b, step) for b in blueprints.values() for step in _all_steps(b.steps)]
        for name, missed in self._missed.items():
            mapped = [
                _meant(step, inside, uses, frozenset())
                for inside, step in uses
                if step.name == name
            ]
            for miss in missed:
                if not mapped or any(miss.name not in known for known in mapped):
                    self._tell(miss)
        self._tell_circles(blueprints)

    def _tell_circles(self, blueprints: Mapping[str, Procedure]) -> None:
        for name, blueprint in blueprints.items():
            reached, waiting = set(), [blueprint]
            while waiting:
                for step in _all_steps(waiting.pop().steps):
                    if step.name in blueprints and step.name not in reached:
                        reached.add(step.name)
                        waiting.append(blueprints[step.name])
            if name in reached:
                message = f"the blueprint {name!r} uses itself"
                self._told.tell("xdl.blueprint_circle", message, blueprint.place)

    def _tell(self, miss: Missed) -> None:
        if miss.kind == HARDWARE:
            message = (
                f'"{miss.name}" used as {miss.property} in procedure but not declared in '
                "<Hardware> section of XDL"
            )
            self._told.tell("xdl.vessel_not_declared", message, miss.place)
        else:
            message = (
                f'"{miss.name}" used as {miss.property} in procedure but not declared in '
                "<Reagents> section of XDL"
            )
            self._told.tell("xdl.reagent_not_declared", message, miss.place)


_Use = tuple[Procedure | None, XdlStep]


def _meant(
    step: XdlStep, inside: Procedure | None, uses: Sequence[_Use], seen: frozenset[str]
) -> set[str]:
    """List what a use maps, and what that stands for where the use is itself inside a blueprint."""
    names = set(step.mapping.values())
    if inside is None or inside.id in seen:
        return names
    outer = [
        {use.mapping.get(name, name) for name in names}
        | (_meant(use, around, uses, seen | {inside.id}) - set(use.mapping.values()))
        for around, use in uses
        if use.name == inside.id
    ]
    return names | (set.intersection(*outer) if outer else set())


def _all_steps(steps: tuple[XdlStep, ...]) -> list[XdlStep]:
    found: list[XdlStep] = []
    for step in steps:
        found += [step, *_all_steps(step.children)]
    return found
