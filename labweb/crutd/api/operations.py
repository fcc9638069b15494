"""REST of operations by hand: checked and carried out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import ApiAnswer
from labweb.common.requests import body
from labweb.crutd import selectors, services
from labweb.crutd.answers import (
    EventRow,
    OperationFindings,
)
from labweb.crutd.api.events import event_rows
from labweb.crutd.selectors.archive import with_former_place
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.errors import DefinitionError, Finding
from labweb.resources import selectors as resource_selectors


class Act(msgspec.Struct, forbid_unknown_fields=True):
    """What a person did or is about to do by hand."""

    operation: operations.HandOperation
    note: Annotated[str, msgspec.Meta(max_length=2000)] = ""


class HandOperations(Endpoint):
    """Operations that people carry out by hand and tell of.

    A transfer between two edge hosts does not end here: `labweb.runs.api.custody` takes it.
    """

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Act}
    answers: ClassVar[Mapping[str, Mapping[int, type[ApiAnswer]]]] = {"post": {201: EventRow}}

    def post(self, request: Request) -> Response:
        """Check an operation under locks and write it down as done: all of it, or nothing."""
        act = body(request, Act)
        user = user_of(request)
        require_act(user, act.operation)
        row = self.carry_out(act, user)
        return Response(event_rows([row.events.get()])[0], status=201)

    def carry_out(self, act: Act, user: User) -> selectors.Transaction:
        """Do it; the floor above asks more of some operations."""
        return services.carry_out(
            act.operation, lab=resource_selectors.the_lab(), actor_id=user.pk, note=act.note
        )


class OperationCheck(Endpoint):
    """What speaks against an operation."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Act}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it calculates and writes nothing"}

    def post(self, request: Request) -> OperationFindings:
        """List every finding against an operation as things stand; change nothing."""
        act = body(request, Act)
        user = user_of(request)
        require_act(user, act.operation)
        return OperationFindings(findings=self.findings(act, user))

    def findings(self, act: Act, user: User) -> list[Finding]:
        """List them; the floor above asks more of some operations."""
        lab = resource_selectors.the_lab()
        return services.check_operation(act.operation, lab=lab, actor_id=user.pk)


def require_act(user: User, operation: operations.Operation) -> None:
    """Refuse who may not do this, or may not know of a resource it names."""
    if operations.is_told_by_server(operation):
        text = "the server itself writes down where a thing stood: leave from_id and pose out"
        raise DefinitionError(f"the request is not as described: {text}", code="http.body")
    wanted = Permission.RUN
    if isinstance(operation, operations.Correct):
        wanted = Permission.RESOLVE
    elif isinstance(operation, operations.Disconnect):
        wanted = Permission.ADMIT
    ids = set(operations.touched_ids(with_former_place(operation)))
    resource_selectors.require_seen(user, ids)
    resource_selectors.require(user, wanted, ids)
