"""Recipes: opened on a rig by another process, and kept as a workflow when a person says so."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from threading import BoundedSemaphore, Condition
from typing import Any

import msgspec
from django.conf import settings
from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.common.limits.concurrency import give_back_connection
from labweb.crutd.selectors.lab_export import lab_file_of
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, Finding, LockedError, ProtocolError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.rig.lab_as_rig import render_graph
from labweb.domain.recipes.agreement.contents import render_proved
from labweb.domain.recipes.compile_recipe_file import digest
from labweb.domain.recipes.recipe_preview import PreviewAsked
from labweb.domain.resources.resource_tree import Tree
from labweb.domain.workflows.workflow_file import parse_workflow, render_workflow, resolve_keys
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.workflows.models import WorkflowVersion
from labweb.workflows.services.workflow_versions import (
    create_workflow,
    require_drawing,
    save_version,
)

MOST_S = 180.0
"""Longest time to wait for an answer; the process itself has less of the processor."""

LONGEST_FILE = 200
"""Most of a file's name that a version notes: the digest after it stays whole."""

WAIT_S = 30.0
_AT_ONCE = BoundedSemaphore(2)
"""Recipes that one server compiles side by side."""

_asking: set[object] = set()
"""Whose recipe is being compiled, or waits for its place: one of each person."""

_told = Condition()


def open_recipe(lab: Lab, asked: PreviewAsked, *, on_lab: bool, actor: User) -> dict[str, Any]:
    """Read a recipe, bind it to a graph, compile it and have the plan proved.

    Args:
        lab: The lab; its own graph is taken when `on_lab`.
        asked: The recipe, and a graph unless `on_lab`.
        on_lab: Compile against the lab as it is now.
        actor: Who asks.

    Raises:
        ForbiddenError: The actor may not draw, or may not see the whole lab.
        DefinitionError: `recipe.too_much`, when it takes more time or memory than a recipe may.
        LockedError: `recipe.busy`.

    Returns:
        As `opening.open_recipe`; on the lab, `document` names its resources.

    Effect:
        None. Nothing is stored.
    """
    require_drawing(lab, actor)
    if not on_lab:
        return _run("open", asked, actor)
    lab_file = _lab_file(lab, actor)
    asked = replace(asked, graph=render_graph(lab_file), is_of_lab=True)
    found = _run("open", asked, actor)
    if found["document"] is None:
        return found
    try:
        found["document"] = _resolved(found["document"], lab_file.tree)
    except ProtocolError as error:
        found["document"] = None
        found["findings"] += [one.to_json() | {"about": "workflow"} for one in error.findings]
    return found


def advise_on(lab: Lab, asked: PreviewAsked, *, on_lab: bool, actor: User) -> dict[str, Any]:
    """Return what to change in a graph so that a recipe compiles on it, or why nothing helps.

    Raises:
        As `open_recipe`; and LabError when recipe or graph cannot be read.

    Effect:
        None. The graph of the lab stays as it is.
    """
    return _run("advise", _with_graph(lab, asked, on_lab=on_lab, actor=actor), actor)


@dataclass(frozen=True, slots=True)
class ReadRecipe:
    """A recipe that was read to be kept."""

    document: dict[str, Any]
    proved: dict[str, Any]
    note: str


def read_recipe(lab: Lab, asked: PreviewAsked, *, name: str, actor: User) -> ReadRecipe:
    """Read a recipe as a workflow of the lab; it may take minutes, and stores nothing.

    Raises:
        ProtocolError: A workflow cannot say all of it, a vessel is bound to no resource of the
            lab, or `recipe.differs`: the run would not do what is proved; `findings` list what.
        InfeasibleError: The lab as it is now cannot do it.
        DefinitionError: The name, or `recipe.too_much`.
        ForbiddenError: The actor may not draw here, or may not see the whole lab.
        LockedError: `recipe.busy`.
    """
    lab_file = _lab_file(lab, actor)
    graph = render_graph(lab_file)
    found = _run("workflow", replace(asked, name=name.strip() or asked.name, graph=graph), actor)
    document = _resolved(found["document"], lab_file.tree)
    proved = render_proved(found["proved"], lab_file)
    note = f"from {asked.name[:LONGEST_FILE]}, SHA-256 {digest(asked.recipe)}"
    return ReadRecipe(document, proved, note)


def _resolved(document: dict[str, Any], tree: Tree) -> dict[str, Any]:
    return render_workflow(resolve_keys(parse_workflow(document), tree))


@atomic
def keep_recipe(lab: Lab, read: ReadRecipe, *, name: str, actor: User) -> WorkflowVersion:
    """Keep a recipe that was read as a workflow with its first version.

    Raises:
        DefinitionError: The name.
        ForbiddenError: The actor may not draw here.
    """
    row = create_workflow(lab, name=name, document=read.document, actor=actor)
    return save_version(row.id, note=read.note, actor=actor, proved=read.proved)


def _with_graph(lab: Lab, asked: PreviewAsked, *, on_lab: bool, actor: User) -> PreviewAsked:
    require_drawing(lab, actor)
    return replace(asked, graph=render_graph(_lab_file(lab, actor))) if on_lab else asked


def _lab_file(lab: Lab, actor: User) -> LabFile:
    """Return the whole lab as it is now, for who may draw and may see all of it."""
    require_drawing(lab, actor)
    resource_selectors.require(actor, Permission.VIEW, [resource_selectors.root_of(lab).id])
    return lab_file_of(lab)


@contextmanager
def _place_for(actor: User) -> Iterator[None]:
    """Wait for a place, of which one person has one at a time: the other stays for others.

    Raises:
        LockedError: `recipe.busy`.
    """
    with _told:
        if not _told.wait_for(lambda: actor.pk not in _asking, WAIT_S):
            text = "another recipe of yours is still being compiled: wait for it"
            raise LockedError(text, code="recipe.busy")
        _asking.add(actor.pk)
    try:
        if not _AT_ONCE.acquire(timeout=WAIT_S):
            raise LockedError("other recipes are being compiled: try again", code="recipe.busy")
        try:
            yield
        finally:
            _AT_ONCE.release()
    finally:
        with _told:
            _asking.discard(actor.pk)
            _told.notify_all()


def _run(act: str, asked: PreviewAsked, actor: User) -> dict[str, Any]:
    give_back_connection()
    with _place_for(actor):
        raw = _answer(act, msgspec.json.encode(asked))
    told: dict[str, Any] = msgspec.json.decode(raw)
    if "error" in told:
        error = told["error"]
        raise ProtocolError(
            error["message"],
            code=error["code"],
            context=error["context"],
            findings=[Finding(**finding) for finding in error["findings"]],
        )
    found: dict[str, Any] = told["answer"]
    return found


def _answer(act: str, request: bytes) -> bytes:
    # Neither secrets nor addresses of this server.
    environment = {"PATH": os.environ.get("PATH", ""), "LANG": "C.UTF-8", "TZ": "UTC"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "labweb.common.recipes", act],
            cwd=settings.ROOT,
            env=environment,
            input=request,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=False,
            timeout=MOST_S,
        )
    except subprocess.TimeoutExpired as error:
        raise _too_much(f"took more than {MOST_S:g} s") from error
    if done.returncode != 0:
        raise _too_much("takes more time or memory than a recipe may")
    return done.stdout


def _too_much(what: str) -> DefinitionError:
    return DefinitionError(f"this recipe on this graph {what}", code="recipe.too_much")
