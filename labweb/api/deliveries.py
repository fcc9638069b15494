"""The door for deliveries that a laboratory information system (LIMS) sends."""

from __future__ import annotations

import hashlib
import hmac
import re
import time
from typing import ClassVar

import msgspec
from django.conf import settings
from drf_spectacular.extensions import OpenApiAuthenticationExtension
from rest_framework.authentication import BaseAuthentication
from rest_framework.exceptions import NotAuthenticated
from rest_framework.request import Request

from labweb.accounts import selectors as account_selectors
from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.api.answers.deliveries import DeliveredLot, DeliveredLots
from labweb.api.json_bodies import MAX_BODY_BYTES, StrictJSONParser, TooLargeError
from labweb.common.requests import body
from labweb.crutd import services as crutd_services
from labweb.domain.crutd.delivery_table import read_deliveries
from labweb.domain.errors import ForbiddenError
from labweb.resources import selectors as resource_selectors

WINDOW_S = 300
"""How far the clock of the other system may be off, and how long a signature lasts."""

SHORTEST_SECRET = 32

_SIGNATURE = re.compile(r"t=(?P<at>\d{1,12}),v1=(?P<mac>[0-9a-f]{64})")


class Delivered(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a delivery: rows with the columns of a table of lots."""

    lots: list[dict[str, str]]


class SignedDelivery(BaseAuthentication):
    """Whoever signs with the shared secret acts in the name of its user."""

    def authenticate(self, request: Request) -> tuple[User, None]:
        """Return the user of the other system.

        Raises:
            NotAuthenticated: There is no signature.
            ForbiddenError: `lims.bad_signature`, `lims.no_user`.
        """
        _check_signature(request.headers.get("X-Labweb-Signature", ""), _raw(request))
        return _actor(), None


class DescribedSigned(OpenApiAuthenticationExtension):  # type: ignore[no-untyped-call] # the library registers it
    """How the signature stands in the description of the interface."""

    target_class = SignedDelivery
    name = "lims"

    def get_security_definition(self, auto_schema: object) -> dict[str, str]:
        """Return the header that carries it."""
        del auto_schema
        return {"type": "apiKey", "in": "header", "name": "X-Labweb-Signature"}


class OfAnyType(StrictJSONParser):
    """Reads JSON however the other system calls it."""

    media_type = "*/*"


class Deliveries(Endpoint):
    """Deliveries from another system."""

    # No session: the signature alone says who asks.
    authentication_classes = (SignedDelivery,)
    parser_classes = (OfAnyType,)
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Delivered}
    statuses: ClassVar = {"post": 201}

    def post(self, request: Request) -> DeliveredLots:
        """Receive every lot of a signed request, or none."""
        deliveries = read_deliveries(body(request, Delivered).lots)
        lots = crutd_services.receive_deliveries(
            deliveries,
            lab=resource_selectors.the_lab(),
            actor=user_of(request),
            source={"file": "a request", "sha256": hashlib.sha256(_raw(request)).hexdigest()},
        )
        pairs = zip(lots, deliveries, strict=True)
        return DeliveredLots(lots=[DeliveredLot(id=lot, key=one.lot) for lot, one in pairs])


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
