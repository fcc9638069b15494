"""The endpoints of recipes: opened on a rig, advised on, kept as a workflow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.requests import body
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.recipes.recipe_preview import PreviewAsked
from labweb.resources import selectors as resource_selectors
from labweb.workflows import services
from labweb.workflows.answers import KeptRecipe, RecipeAdvice, RecipeOpening
from labweb.workflows.api.workflows import version_row


class Opened(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Body of an opening. Files are base64: their bytes are what is hashed and read."""

    name: str
    recipe: bytes
    graph: bytes | None = None
    """None: the lab itself, as it is now."""

    bind: dict[str, str] = {}
    holds: dict[str, dict[str, str]] = {}
    blueprints: list[bytes] = []
    declared: bytes = b""
    """What is stated beside the recipe, `labweb.declared/1`; empty: nothing."""

    rinse: list[str] = []
    primes: bool = False
    parameters: dict[str, str] = {}
    equiv_reference: str = ""
    equiv_amount: str = ""

    def asked(self) -> PreviewAsked:
        """Return it for the domain."""
        return PreviewAsked(
            name=self.name,
            recipe=self.recipe,
            graph=self.graph or b"",
            bind=self.bind,
            holds=self.holds,
            blueprints=tuple(self.blueprints),
            declared=self.declared,
            rinse=tuple(self.rinse),
            primes=self.primes,
            parameters=self.parameters,
            equiv_reference=self.equiv_reference,
            equiv_amount=self.equiv_amount,
        )


class Kept(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Body of a keeping."""

    name: str
    """Of the workflow."""

    recipe: bytes
    file: str = "recipe"
    """Name of the recipe's file, for the note of the version."""

    bind: dict[str, str] = {}
    """Vessel or reagent of the recipe → key of the lab."""

    holds: dict[str, dict[str, str]] = {}
    blueprints: list[bytes] = []
    declared: bytes = b""
    rinse: list[str] = []
    primes: bool = False
    parameters: dict[str, str] = {}
    equiv_reference: str = ""
    equiv_amount: str = ""


class OpenRecipe(Endpoint):
    """A recipe on a rig."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Opened}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it calculates and writes nothing"}

    def post(self, request: Request) -> RecipeOpening:
        """Read, bind, compile and prove a recipe; findings are an answer, no failure."""
        return msgspec.convert(_ask(request, services.open_recipe), RecipeOpening)


class AdviseRecipe(Endpoint):
    """What to change in a rig for a recipe."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Opened}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it calculates and writes nothing"}

    def post(self, request: Request) -> RecipeAdvice:
        """Return the fewest changes with which the recipe compiles, and the changed graph."""
        return msgspec.convert(_ask(request, services.advise_on), RecipeAdvice)


class KeepRecipe(Endpoint):
    """A recipe as a workflow."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Kept}
    statuses: ClassVar[dict[str, int]] = {"post": 201}

    def prepare(self, request: Request, *_args: object, **_kwargs: object) -> None:
        """Read the recipe in its process, before a transaction is open."""
        told = body(request, Kept)
        asked = PreviewAsked(
            name=told.file,
            recipe=told.recipe,
            bind=told.bind,
            holds=told.holds,
            blueprints=tuple(told.blueprints),
            declared=told.declared,
            rinse=tuple(told.rinse),
            primes=told.primes,
            parameters=told.parameters,
            equiv_reference=told.equiv_reference,
            equiv_amount=told.equiv_amount,
        )
        lab, actor = resource_selectors.the_lab(), user_of(request)
        self.read = services.read_recipe(lab, asked, name=told.name, actor=actor)

    def post(self, request: Request) -> KeptRecipe:
        """Keep a recipe as a workflow with version 1, or say what a workflow cannot say."""
        name, lab = body(request, Kept).name, resource_selectors.the_lab()
        version = services.keep_recipe(lab, self.read, name=name, actor=user_of(request))
        return KeptRecipe(workflow_id=version.workflow_id, version=version_row(version))


def _ask(request: Request, act: Any) -> dict[str, Any]:  # noqa: ANN401 - one of two services
    told = body(request, Opened)
    lab = resource_selectors.the_lab()
    found: dict[str, Any] = act(
        lab, told.asked(), on_lab=told.graph is None, actor=user_of(request)
    )
    return found
