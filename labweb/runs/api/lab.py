"""The endpoints of the lab and its stop."""

from __future__ import annotations

from typing import ClassVar

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.requests import body
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors, services
from labweb.runs.api.runs import Reason


class LabView(Endpoint):
    """The lab and its stop."""

    def get(self, request: Request) -> Response:
        """Return the lab."""
        user_of(request)
        return Response(selectors.lab_summary(resource_selectors.the_lab()))


class Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """Body of an act that takes no arguments."""


class StopLab(Endpoint):
    """Software stop."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}

    def post(self, request: Request) -> Response:
        """Stop every device now and latch."""
        body(request, Nothing)
        services.stop_lab(actor=user_of(request))
        return Response(selectors.lab_summary(resource_selectors.the_lab()))


class ResetLab(Endpoint):
    """Release after a stop."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Reason}

    def post(self, request: Request) -> Response:
        """Release the latch; starts nothing."""
        services.reset_lab(actor=user_of(request), reason=body(request, Reason).reason)
        return Response(selectors.lab_summary(resource_selectors.the_lab()))
