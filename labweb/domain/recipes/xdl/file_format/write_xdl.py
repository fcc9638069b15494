"""Writes recipes: the file as it was, or the same recipe in another version of XDL."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.read_xdl import refusal
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.xdl_json import render_json
from labweb.domain.recipes.xdl.file_format.xml_tree import (
    Attribute,
    Instruction,
    Node,
    XmlDocument,
    XmlElement,
    render_markup,
)
from labweb.domain.recipes.xdl.tables.step_spec import STEPS
from labweb.domain.recipes.xdl.tables.step_table import (
    EARLY_COMPONENTS,
    REAGENT_SINCE_1,
    RENAMED_VALUES,
    SINCE,
)

VERSIONS = ("0.3", "0.4", "0.5", "1.0", "2.0")
"""Versions that are written."""


def render_xdl(recipe: Recipe) -> str:
    """Write a recipe as it was read, comments and all, in the layout of this writer."""
    return render_markup(recipe.document)


def render_as(recipe: Recipe, version: str, *, as_json: bool = False) -> str:
    """Write a recipe in one version of XDL. Nothing of it is lost on the way.

    Args:
        recipe: As it was read.
        version: One of `VERSIONS`.
        as_json: Write the JSON form of it.

    Raises:
        ProtocolError: The recipe says something that version cannot say; `findings` list all.
    """
    if recipe.is_compiled:
        raise _compiled(recipe)
    was_early = recipe.document.root.tag == "Synthesis"
    document = _Rewriter(version, was_early=was_early).document(recipe.document)
    return render_json(document) if as_json else render_markup(document)


def _compiled(recipe: Recipe) -> ProtocolError:
    told = Findings()
    for synthesis in recipe.syntheses:
        if synthesis.graph_sha256:
            message = (
                "this is a compiled recipe (.xdlexe), made for the graph with the SHA-256 "
                f"{synthesis.graph_sha256:.64} and for no other: take the recipe it was made from"
            )
            told.tell("xdl.compiled", message, synthesis.place)
    return refusal(told.all)


def check_graph(recipe: Recipe, graph_sha256: str) -> None:
    """Refuse a compiled recipe for any graph but its own.

    Raises:
        ProtocolError: `xdl.other_graph`.
    """
    told = Findings()
    for synthesis in recipe.syntheses:
        if synthesis.graph_sha256 not in {"", graph_sha256}:
            message = f"the recipe was compiled for the graph {synthesis.graph_sha256:.64}"
            told.tell("xdl.other_graph", message, synthesis.place)
    if told.all:
        raise refusal(told.all)


@dataclass(frozen=True, slots=True)
class _Rewriter:
    """Says the same in the words of one version."""

    version: str
    was_early: bool = False
    """The file is of a version before 1.0, in which a reagent has one of `id` and `name`."""

    @property
    def _is_early(self) -> bool:
        return self.version.startswith("0.")

    def document(self, document: XmlDocument) -> XmlDocument:
        told = Findings()
        root = self._element(document.root, told, is_role=False)
        if self._is_early and root.tag == "XDL":
            tops = root.elements
            if len(tops) == 1 and len(root.children) == 1:
                root = tops[0]
        elif not self._is_early and root.tag == "Synthesis":
            root = XmlElement("XDL", (), (root,))
        if told.all:
            raise refusal(told.all)
        kept = [n for n in document.before if not _is_version(n)]
        mark = Instruction("xdl", f'version="{_full(self.version)}"')
        return XmlDocument(root, (mark, *kept), document.after)

    def _element(self, element: XmlElement, told: Findings, *, is_role: bool) -> XmlElement:
        tag, attributes = element.tag, element.attributes
        for reason in self._newer(element):
            message = f"XDL {self.version} has no {reason}"
            told.tell("xdl.not_in_version", message, element.place)
        if tag == "Reagent":
            attributes = self._reagent(element, is_role=is_role)
        elif tag in EARLY_COMPONENTS and STEPS.spec(tag) is None:
            attributes = (*attributes, Attribute("type", EARLY_COMPONENTS[tag]))
            tag = "Component"
        elif (spec := STEPS.spec(tag)) is not None:
            attributes = tuple(_renamed(a, spec.renamed, set(spec.properties)) for a in attributes)
        is_role = is_role or tag == "Blueprint"
        children = tuple(
            self._child(element, child, told, is_role=is_role)
            if isinstance(child, XmlElement)
            else child
            for child in element.children
        )
        return XmlElement(tag, attributes, children, element.place)

    def _child(
        self, parent: XmlElement, child: XmlElement, told: Findings, *, is_role: bool
    ) -> XmlElement:
        # In 2019 <Filter> named hardware, and since then it is a step.
        if parent.tag == "Hardware" and child.tag in EARLY_COMPONENTS:
            mark = Attribute("type", EARLY_COMPONENTS[child.tag])
            return XmlElement("Component", (*child.attributes, mark), (), child.place)
        return self._element(child, told, is_role=is_role)

    def _reagent(self, element: XmlElement, *, is_role: bool) -> tuple[Attribute, ...]:
        name, own_id = element.text_of("name"), element.text_of("id")
        rest = tuple(a for a in element.attributes if a.name not in {"id", "name"})
        if self.version in {"0.3", "0.4"}:
            return (Attribute("id", own_id or name), *rest)
        if self.version == "0.5":
            return (Attribute("name", own_id or name), *rest)
        if not name and not is_role:
            # Before 0.4 the id named the substance; since then a name does.
            return (Attribute("name", own_id), *element.attributes)
        if not own_id and self.was_early:
            place = [a.name for a in element.attributes].index("name") + 1
            attributes = element.attributes
            return (*attributes[:place], Attribute("id", name), *attributes[place:])
        return element.attributes

    def _newer(self, element: XmlElement) -> Iterator[str]:
        names = {a.name for a in element.attributes}
        if self._is_early:
            yield from self._newer_than_early(element, names)
        if self.version != "2.0" and "queue" in names:
            yield "queues"
        if element.tag in SINCE:
            since, properties = SINCE[element.tag]
            if VERSIONS.index(since) > VERSIONS.index(self.version):
                if not properties:
                    yield f"step {element.tag}"
                for name in sorted(names.intersection(properties.split())):
                    yield f"{name} of {element.tag}"

    def _newer_than_early(self, element: XmlElement, names: set[str]) -> Iterator[str]:
        if element.tag in {"Blueprint", "Parameters"}:
            yield f"<{element.tag}>"
        if element.tag == "Repeat" and any("." in name for name in names):
            yield "loop variables"
        if any(name.startswith("param.") for name in names):
            yield "parameters"
        if element.tag == "XDL" and len(element.elements) > 1:
            yield "more than one top element"
        if element.tag == "Reagent":
            if {"id", "name"} <= names and element.text_of("id") != element.text_of("name"):
                yield "reagent whose id is not its name"
            for name in sorted(names & REAGENT_SINCE_1):
                yield f"{name} of a reagent"


def _renamed(attribute: Attribute, renamed: dict[str, str] | object, known: set[str]) -> Attribute:
    if attribute.name in known or not isinstance(renamed, dict) or attribute.name not in renamed:
        return attribute
    values = RENAMED_VALUES.get(attribute.name, {})
    value = values.get(attribute.value.lower(), attribute.value)
    return Attribute(renamed[attribute.name], value, attribute.place)


def _is_version(node: Node) -> bool:
    return isinstance(node, Instruction) and node.target == "xdl"


def _full(version: str) -> str:
    return f"{version}.0" if version.count(".") == 1 else version
