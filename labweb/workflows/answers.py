"""What the endpoints of workflows, the palette and recipes answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer
from labweb.domain.enrollment.driver_spec import Recovery
from labweb.domain.errors import Finding
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.workflows.unit_operations.unit_operation import StepPort


class StepChoice(ApiAnswer):
    """A unit operation that can be put into a workflow."""

    kind: str
    label: str
    help: str
    clauses: list[str]
    """Its sentence, with names of parameters in braces; one is left out with its parameter."""

    inputs: list[StepPort]
    outputs: list[StepPort]
    params: dict[str, Any]
    """JSON Schema of its parameters."""


class DeviceAction(ApiAnswer):
    """What a device does when it is told to."""

    name: str
    label: str
    doc: str
    schema: dict[str, Any]
    """JSON Schema of its arguments."""

    hazards: list[str]
    recovery: Recovery


class PaletteDevice(ApiAnswer):
    """A device whose actions can be put into a workflow."""

    id: UUID
    name: str
    role: str
    roles: list[str]
    """All that it can be asked for as, its own role among them."""

    state: str
    actions: list[DeviceAction]


class UnitTable(ApiAnswer):
    """The units in which a quantity may be written."""

    canonical: str
    suffix: str
    units: list[str]
    spellings: dict[str, str]
    """Another spelling → the unit that it means."""


class StepPalette(ApiAnswer):
    """What can be put into a workflow."""

    steps: list[StepChoice]
    devices: list[PaletteDevice]
    units: dict[str, UnitTable]
    """By quantity."""


class DraftSaved(ApiAnswer):
    """The revision that a draft has now."""

    revision: int


class VersionRow(ApiAnswer):
    """A version of a workflow without its document."""

    id: UUID
    number: int
    note: str
    author: str | None
    at: datetime


class VersionList(ApiAnswer):
    """A page of versions, the newest first."""

    versions: list[VersionRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class VersionDetail(VersionRow):
    """A version of a workflow with its document."""

    document: dict[str, Any]
    """As `labweb.workflow/1` says it."""


class RecipeParameter(ApiAnswer):
    """A value that a recipe leaves to whoever uses it; texts with units, empty for none."""

    id: str
    sort: str
    unit: str
    value: str
    least: str
    most: str


class RecipeSummary(ApiAnswer):
    """What a recipe is."""

    name: str
    version: str
    sha256: str
    is_compiled: bool
    syntheses_count: int
    steps_count: int
    parameters: list[RecipeParameter]
    cleans_with: list[str]


class RigContent(ApiAnswer):
    """What the graph says is in a vessel."""

    name: str
    volume_ul: float


class RigNode(ApiAnswer):
    """One thing of a rig."""

    key: str
    kind: str
    role: str
    sort: str | None
    """Which sort of vessel it is; null: it is none."""

    chemical: str
    holds: list[RigContent]


class RigTube(ApiAnswer):
    """One tube of a rig."""

    key: str
    source: str
    source_port: str
    target: str
    target_port: str
    medium: Medium


class RigPicture(ApiAnswer):
    """A graph of a rig as it was read."""

    format: str
    sha256: str
    nodes: list[RigNode]
    tubes: list[RigTube]
    defects: list[Finding]


class RoleBinding(ApiAnswer):
    """What stands on the rig for a vessel or a reagent of the recipe."""

    role: str
    what: Literal["vessel", "reagent"]
    told: str
    keys: list[str]
    choices: list[str]
    alike: list[str]
    """Vessels whose label only looks like it: never taken by themselves."""

    is_by_hand: bool
    is_stated: bool
    """By the file that is stated beside the recipe."""


class RecipeFinding(ApiAnswer):
    """What is wrong with a recipe on a rig."""

    code: str
    message: str
    subject: str
    context: dict[str, Any]
    about: Literal["recipe", "graph", "rig", "wish", "declared", "workflow"]
    """The recipe, the graph, both together, what was asked, what is stated, or the workflow."""


class RecipeOpening(ApiAnswer):
    """A recipe opened on a rig."""

    recipe: RecipeSummary | None
    """Null: it cannot be read."""

    rig: RigPicture | None
    """Null: there is no graph, or none that can be read."""

    bindings: list[RoleBinding]
    findings: list[RecipeFinding]
    plan: dict[str, Any] | None
    """As `labweb.plan/1` says it, each step with its route; null unless it is proved."""

    is_proved: bool | None
    """False: a plan was made and refuted; null: there was none to prove."""

    document: dict[str, Any] | None
    """The workflow of this lab that does the same; null on another rig, or where there is none."""


class RigChange(ApiAnswer):
    """One change of a rig."""

    change: str
    text: str
    adds: list[str]
    """Keys of what comes to the rig."""


class RecipeAdvice(ApiAnswer):
    """What to change in a rig so that a recipe compiles, or why nothing helps."""

    ok: bool
    """Whether there is an advice: then the changes and the graph are there, else the findings."""

    changes: list[RigChange] | UnsetType = UNSET
    graph_sha256: str | UnsetType = UNSET
    graph: str | UnsetType = UNSET
    """With the changes."""

    findings: list[Finding] | UnsetType = UNSET


class KeptRecipe(ApiAnswer):
    """A recipe that was kept as a workflow."""

    workflow_id: UUID
    version: VersionRow
