"""One place where a LabError becomes an HTTP answer."""

from __future__ import annotations

import logging
from typing import Any

from django.core.exceptions import PermissionDenied
from django.http import Http404
from rest_framework import exceptions
from rest_framework.response import Response

from labweb.domain import errors

logger = logging.getLogger(__name__)

STATUS: list[tuple[type[errors.LabError], int]] = [
    (errors.NotFoundError, 404),
    (errors.PreconditionError, 412),
    (errors.LockedError, 423),
    (errors.RevisionError, 409),
    (errors.InterlockError, 409),
    (errors.GovernanceError, 403),
    (errors.StateError, 409),
    (errors.DefinitionError, 422),
    (errors.PlanningError, 422),
    (errors.UnreachableError, 503),
    (errors.DeviceTimeoutError, 504),
    (errors.DeviceError, 502),
    (errors.ReconcileError, 409),
]
"""First match wins, the narrow before the wide."""


def status_of(error: errors.LabError) -> int:
    """Return the HTTP status of a failure."""
    return next((code for kind, code in STATUS if isinstance(error, kind)), 500)


def handle(error: Exception, _context: dict[str, Any]) -> Response | None:
    """Render a failure; what is no known failure stays a 500 and is logged by Django."""
    if isinstance(error, errors.LabError):
        return Response(error.to_json(), status=status_of(error))
    if isinstance(error, Http404):
        error = exceptions.NotFound()
    if isinstance(error, PermissionDenied):
        error = exceptions.PermissionDenied()
    if isinstance(error, exceptions.APIException):
        body = {
            "code": f"http.{error.get_codes() if isinstance(error.detail, str) else 'invalid'}",
            "message": _text(error),
            "effect": "none",
            "context": {} if isinstance(error.detail, str) else {"fields": error.detail},
            "findings": [],
        }
        response = Response(body, status=error.status_code)
        wait = getattr(error, "wait", None)
        if wait is not None:
            response["Retry-After"] = str(int(wait))
        return response
    return None


def _text(error: exceptions.APIException) -> str:
    if isinstance(error.detail, str):
        return str(error.detail)
    return "the request is not as described; see context.fields"
