"""REST of machines that ask to become edge hosts."""

from __future__ import annotations

from typing import Any, ClassVar
from uuid import UUID

import msgspec
from django.conf import settings
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import KeyedRef, NamedRef
from labweb.common.lists import HISTORY
from labweb.common.requests import body
from labweb.domain.enrollment.host_join import USUAL_TOKEN_S
from labweb.enrollment import selectors, services
from labweb.enrollment.answers import (
    JoinAdmission,
    JoinRequestList,
    JoinRequestRow,
    JoinRequestState,
    JoinTokenList,
    JoinTokenMade,
    JoinTokenRow,
    JoinTokenState,
)
from labweb.enrollment.models import JoinRequest, JoinToken
from labweb.resources import selectors as resource_selectors


class TokenWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a wish for a token."""

    name: str = ""
    minutes: float = USUAL_TOKEN_S / 60


class Typed(msgspec.Struct, forbid_unknown_fields=True):
    """Body of an admission: the code as the machine shows it, and what was checked."""

    code: str
    reason: str


class Said(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a rejection."""

    reason: str


class ForAdmission(Endpoint):
    """What only who admits hosts to the lab may ask about, whatever there is of it."""

    def initial(self, request: Request, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - DRF's shape
        """Refuse who may not, before anything is looked for."""
        super().initial(request, *args, **kwargs)
        services.require_admission(user_of(request), resource_selectors.the_lab())


class JoinTokens(ForAdmission):
    """Join tokens of the lab."""

    bodies = {"post": TokenWish}
    queries = HISTORY.parameters
    statuses: ClassVar = {"post": 201}

    def get(self, request: Request) -> JoinTokenList:
        """List the tokens, without their secrets, which nobody has."""
        rows = selectors.tokens_of(resource_selectors.the_lab())
        found, following = HISTORY.of_rows(request, rows, "-created_at", "-id")
        return JoinTokenList(tokens=[_token(row) for row in found], next=following)

    def post(self, request: Request) -> JoinTokenMade:
        """Make a token; this answer alone holds it."""
        wish = body(request, TokenWish)
        made = services.make_token(
            resource_selectors.the_lab(),
            actor=user_of(request),
            name=wish.name,
            lifetime_s=wish.minutes * 60,
        )
        command = services.join_command(made.text)
        return JoinTokenMade(**asdict(_token(made.row)), token=made.text, command=command)


class JoinTokenDetail(ForAdmission):
    """One token."""

    def delete(self, request: Request, token_id: UUID) -> JoinTokenRow:
        """Take a token back that nobody has used."""
        return _token(services.withdraw_token(token_id, actor=user_of(request)))


class JoinRequests(ForAdmission):
    """Machines that asked."""

    queries = HISTORY.parameters

    def get(self, request: Request) -> JoinRequestList:
        """List the machines that asked, the newest first; not their codes, which they show."""
        rows = selectors.requests_of(resource_selectors.the_lab())
        found, following = HISTORY.of_rows(request, rows, "-asked_at", "-id")
        return JoinRequestList(
            requests=[_request(row) for row in found],
            door=settings.EDGE_ADDRESS,
            next=following,
        )


class Admission(ForAdmission):
    """Yes to one machine."""

    signs = frozenset({"post"})
    bodies = {"post": Typed}

    def post(self, request: Request, join_id: UUID) -> JoinAdmission:
        """Make it a host, if the code is the one that it shows."""
        said, actor = body(request, Typed), user_of(request)
        host = services.admit_request(join_id, typed=said.code, reason=said.reason, actor=actor)
        return JoinAdmission(host=KeyedRef(id=host.id, key=host.key, name=host.name))


class Rejection(ForAdmission):
    """No to one machine."""

    bodies = {"post": Said}

    def post(self, request: Request, join_id: UUID) -> JoinRequestRow:
        """Send it away; its key never asks again."""
        reason, actor = body(request, Said).reason, user_of(request)
        return _request(services.reject_request(join_id, reason=reason, actor=actor))


def _token(row: JoinToken) -> JoinTokenRow:
    return JoinTokenRow(
        id=row.id,
        name=row.name,
        created_at=row.created_at,
        expires_at=row.expires_at,
        used_at=row.used_at,
        withdrawn_at=row.withdrawn_at,
        state=msgspec.convert(selectors.token_state(row), JoinTokenState),
    )


def _request(row: JoinRequest) -> JoinRequestRow:
    known = row.known_host
    state = "expired" if selectors.is_stale(row) else row.state
    return JoinRequestRow(
        id=row.id,
        name=row.name,
        address=row.address,
        facts=row.facts,
        asked_at=row.asked_at,
        state=msgspec.convert(str(state), JoinRequestState),
        reason=row.reason,
        host_id=row.host_id,
        claims_to_be=None if known is None else NamedRef(id=known.id, name=known.name),
    )
