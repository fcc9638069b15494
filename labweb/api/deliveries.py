"""The door for deliveries that a laboratory information system (LIMS) sends."""

from __future__ import annotations

import hashlib
import hmac
import io
import re
import time
from typing import ClassVar

import msgspec
from django.conf import settings
from rest_framework.exceptions import NotAuthenticated
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.api.parsers import MAX_BODY_BYTES, StrictJSONParser, TooLargeError
from labweb.crutd import services as crutd_services
from labweb.domain.crutd.deliveries import read_deliveries
from labweb.domain.errors import DefinitionError, ForbiddenError
from labweb.resources import selectors as resource_selectors

WINDOW_S = 300
"""How far the clock of the other system may be off, and how long a signature lasts."""

SHORTEST_SECRET = 32

_SIGNATURE = re.compile(r"t=(?P<at>\d{1,12}),v1=(?P<mac>[0-9a-f]{64})")


class Delivered(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a delivery: rows with the columns of a table of lots."""

    lots: list[dict[str, str]]


class Deliveries(APIView):
    """Deliveries from another system."""

    # No session: the signature alone says who asks.
    authentication_classes = ()
    permission_classes = ()
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Delivered}

    def post(self, request: Request) -> Response:
        """Receive every lot of a signed request, or none."""
        raw = _raw(request)
        _check_signature(request.headers.get("X-Labweb-Signature", ""), raw)
        actor = _actor()
        plain = StrictJSONParser().parse(io.BytesIO(raw))
        try:
            told = msgspec.convert(plain, Delivered).lots
        except msgspec.ValidationError as error:
            what = f"the request is not as described: {error}"
            raise DefinitionError(what, code="http.body") from error
        deliveries = read_deliveries(told)
        lots = crutd_services.receive_deliveries(
            deliveries,
            lab=resource_selectors.the_lab(),
            actor=actor,
            source={"file": "a request", "sha256": hashlib.sha256(raw).hexdigest()},
        )
        pairs = zip(lots, deliveries, strict=True)
        answer = [{"id": str(lot), "key": one.lot} for lot, one in pairs]
        return Response({"lots": answer}, status=201)


def _raw(request: Request) -> bytes:
    length = request.META.get("CONTENT_LENGTH") or "0"
    if not length.isascii() or not length.isdigit() or int(length) > MAX_BODY_BYTES:
        raise TooLargeError
    # The signature is over the bytes as they came.
    return bytes(request._request.body)  # noqa: SLF001 - DRF gives no other way to them


def _check_signature(told: str, raw: bytes) -> None:
    """See to it that the body was signed with the shared secret a moment ago.

    Raises:
        NotAuthenticated: There is no signature, or no secret to hold it against.
        ForbiddenError: `lims.bad_signature`.
    """
    secret: str = settings.LIMS_SECRET
    if not told or len(secret) < SHORTEST_SECRET or not settings.LIMS_USER:
        raise NotAuthenticated
    found = _SIGNATURE.fullmatch(told)
    if found is None:
        raise ForbiddenError("the signature is not like t=…,v1=…", code="lims.bad_signature")
    message = found["at"].encode() + b"." + raw
    mac = hmac.new(secret.encode(), message, hashlib.sha256).hexdigest()
    is_near = abs(time.time() - int(found["at"])) <= WINDOW_S
    if not hmac.compare_digest(mac, found["mac"]) or not is_near:
        raise ForbiddenError(
            "the request is not signed with the shared secret, or not now",
            code="lims.bad_signature",
        )


def _actor() -> User:
    user = account_selectors.find_user(settings.LIMS_USER)
    if user is None or not user.is_active:
        raise ForbiddenError(f"there is no user {settings.LIMS_USER!r}", code="lims.no_user")
    return user
