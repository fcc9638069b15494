"""The endpoints of the lab and its stop."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import ClassVar

import msgspec
from django.db import OperationalError
from psycopg.errors import DeadlockDetected, LockNotAvailable
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.requests import Nothing, body
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors, services
from labweb.runs.answers.lab import LabSummary
from labweb.runs.api.runs import Reason

logger = logging.getLogger(__name__)

_TRIES = 3


class LabView(Endpoint):
    """The lab and its stop."""

    def get(self, request: Request) -> LabSummary:
        """Return the lab."""
        user_of(request)
        return selectors.lab_summary(resource_selectors.the_lab())


class StopLab(Endpoint):
    """Software stop. It is never refused because a key is missing or was used before."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.SIMULATE}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}
    harmless: ClassVar[Mapping[str, str]] = {"post": "a lab that is stopped twice is stopped"}

    def post(self, request: Request) -> LabSummary:
        """Stop every device now and latch."""
        body(request, Nothing)
        _stop(user_of(request))
        return selectors.lab_summary(resource_selectors.the_lab())


def _stop(actor: User) -> None:
    """Stop the lab; a database that gave up this transaction for another one is asked again."""
    for _ in range(_TRIES - 1):
        try:
            services.stop_lab(actor=actor)
        except OperationalError as error:
            if not isinstance(error.__cause__, DeadlockDetected | LockNotAvailable):
                raise
            logger.warning("the stop of the lab is tried again: %s", error)
        else:
            return
    services.stop_lab(actor=actor)


class ResetLab(Endpoint):
    """Release after a stop."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Reason}

    def post(self, request: Request) -> LabSummary:
        """Release the latch; starts nothing."""
        services.reset_lab(actor=user_of(request), reason=body(request, Reason).reason)
        return selectors.lab_summary(resource_selectors.the_lab())
