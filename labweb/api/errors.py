"""One place where a LabError becomes an HTTP answer."""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping
from typing import Any

from django.core.exceptions import PermissionDenied
from django.db import InterfaceError, OperationalError
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.views import defaults
from django.views.decorators.csrf import csrf_exempt
from kombu.exceptions import OperationalError as BrokerError
from redis.exceptions import ConnectionError as RedisAway
from redis.exceptions import TimeoutError as RedisSilent
from rest_framework import exceptions
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import disk
from labweb.domain import errors
from labweb.domain.disk_space import ADVICE, DiskRoomLevel

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

AWAY = (OperationalError, InterfaceError, RedisAway, RedisSilent, BrokerError)
"""Failures that a server beside us is the cause of; the same request may succeed later."""

_LONGEST_SHOWN = 200


def status_of(error: errors.LabError) -> int:
    """Return the HTTP status of a failure."""
    return next((code for kind, code in STATUS if isinstance(error, kind)), 500)


def handle(error: Exception, context: dict[str, Any]) -> Response:
    """Render a failure in the one shape; what nobody foresaw is logged and says no details."""
    _audit_refusal(error, context.get("request"))
    if isinstance(error, errors.LabError):
        return Response(error.to_json(), status=status_of(error))
    if isinstance(error, Http404):
        error = exceptions.NotFound()
    if isinstance(error, PermissionDenied):
        error = exceptions.PermissionDenied()
    if isinstance(error, exceptions.APIException):
        return _refused(error)
    request = context.get("request")
    method, path = getattr(request, "method", "") or "", getattr(request, "path", "")
    return Response(*_failed(error, method, path))


def _audit_refusal(error: Exception, request: Request | None) -> None:
    """Write down who asked for what they may not; a database that is away is not waited for."""
    is_refusal = isinstance(
        error, errors.GovernanceError | PermissionDenied | exceptions.PermissionDenied
    )
    if not is_refusal or request is None:
        return
    # Of the session: to ask who signed the request would refuse it once more.
    user = getattr(request._request, "user", None)  # noqa: SLF001 - DRF offers no other way
    if not isinstance(user, User):
        return
    code = error.code if isinstance(error, errors.LabError) else "http.permission_denied"
    try:
        account_services.write_refusal(
            user, method=request.method or "", path=request.path, code=code
        )
    except AWAY:
        logger.warning("a refusal at %s could not be written down", request.path)


@csrf_exempt
def no_such(request: HttpRequest) -> JsonResponse:
    """Answer for an address below `/api/` that is none, or whose id is none.

    To whatever is sent there: it does nothing, so that nobody's token is asked for first.
    """
    body = _body("http.not_found", f"there is nothing at {request.path[:_LONGEST_SHOWN]}")
    return JsonResponse(body, status=404)


def server_error(request: HttpRequest) -> HttpResponse:
    """Answer for what failed outside of a view; below `/api/` in the one shape."""
    if not request.path.startswith("/api/"):
        if is_short_of_room(sys.exception()):
            logger.error("%s failed for want of room on a disk", request.path)
            return HttpResponse(f"{_full_disk()}.\n", status=503, content_type="text/plain")
        return defaults.server_error(request)
    body, status = _failed(sys.exception(), request.method or "", request.path)
    return JsonResponse(body, status=status)


def _refused(error: exceptions.APIException) -> Response:
    is_text = isinstance(error.detail, str)
    name = str(error.get_codes()) if is_text else "invalid"
    code = name if name.startswith("http.") else f"http.{name}"
    body = _body(code, _text(error), context={} if is_text else {"fields": error.detail})
    response = Response(body, status=error.status_code)
    wait = getattr(error, "wait", None)
    if wait is not None:
        response["Retry-After"] = str(int(wait))
    return response


def _failed(error: BaseException | None, method: str, path: str) -> tuple[dict[str, Any], int]:
    """Log a failure that nobody foresaw; return what may be told of it, and the status."""
    logger.error("%s %s failed", method, path, exc_info=error)
    is_safe = method in {"GET", "HEAD", "OPTIONS"}
    effect = errors.Effect.NONE if is_safe else errors.Effect.UNKNOWN
    hint = "" if is_safe else "; send it again with the same key: it is carried out once"
    if is_short_of_room(error):
        return _body("http.disk_full", f"{_full_disk()}{hint}", effect=effect), 503
    if isinstance(error, AWAY) or disk.is_out_of_handles(error):
        message = f"the database or the broker does not answer{hint}"
        if disk.is_out_of_handles(error):
            message = f"the server may open no more files: close tabs, or try again later{hint}"
        return _body("http.unavailable", message, effect=effect), 503
    message = f"the server failed at this request; its log says why{hint}"
    return _body("http.internal", message, effect=effect), 500


def is_short_of_room(error: BaseException | None) -> bool:
    """Tell whether a failure comes of a full disk: it says so, or what is away lies on one."""
    return disk.is_about_disk(error) or (
        isinstance(error, AWAY) and disk.level() is DiskRoomLevel.FULL
    )


def _full_disk() -> str:
    """Say which disk it is, as far as anybody knows here, and what to do."""
    here = disk.server_disk()
    if here is not None and here.level(disk.floors()) is DiskRoomLevel.FULL:
        return f"{here.headline()}. {ADVICE} The server then goes on by itself"
    return "the disk of the database or the broker is full: free some space there"


def refusal(
    status: int, code: str, message: str, *, retry_after_s: int | None = None
) -> JsonResponse:
    """Return the answer to a request that was refused before anything was done for it."""
    answer = JsonResponse(_body(code, message), status=status)
    if retry_after_s is not None:
        answer["Retry-After"] = str(retry_after_s)
    return answer


def _body(
    code: str,
    message: str,
    *,
    effect: errors.Effect = errors.Effect.NONE,
    context: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    return {
        "code": code,
        "message": message,
        "effect": effect.value,
        "context": dict(context or {}),
        "findings": [],
    }


def _text(error: exceptions.APIException) -> str:
    if isinstance(error.detail, str):
        return str(error.detail)
    return "the request is not as described; see context.fields"
