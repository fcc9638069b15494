"""What people do to hosts: declare them lost, let them in again, take their key away."""

from __future__ import annotations

from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts.selectors import user_of
from labweb.common.requests import body
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.runs.api.runs import Reason


class HandOver(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a move to another host."""

    place_id: UUID
    note: str


class Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """Body of an act that takes no arguments."""


class HandOvers(APIView):
    """Move a vessel to a place of another host."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": HandOver}

    def post(self, request: Request, resource_id: UUID) -> Response:
        """Ask its host to let it go."""
        wanted = body(request, HandOver)
        made = services.hand_over(
            resource_id, wanted.place_id, actor=user_of(request), note=wanted.note
        )
        return Response({"id": str(made.id), "state": made.state}, status=201)


class Arrival(APIView):
    """A vessel in transit is where it was sent."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}

    def post(self, request: Request, custody_id: UUID) -> Response:
        """Tell its new host to take it over."""
        body(request, Nothing)
        made = services.confirm_arrival(custody_id, actor=user_of(request))
        return Response({"id": str(made.id), "state": made.state})


class HostAct(APIView):
    """Fence, revoke or readmit."""

    act = ""
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Reason}

    def post(self, request: Request, host_id: UUID) -> Response:
        """Carry out the act; say how the host stands then."""
        user, reason = user_of(request), body(request, Reason).reason
        if self.act == "fence":
            host = services.fence_host(host_id, actor=user, reason=reason)
        elif self.act == "revoke":
            host = services.revoke_host(host_id, actor=user, reason=reason)
        else:
            host = enrollment_services.readmit_host(host_id, actor=user, reason=reason)
        return Response({"id": str(host.id), "state": host.state})
