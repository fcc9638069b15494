"""What people do to hosts: declare them lost, let them in again, take their key away."""

from __future__ import annotations

from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.requests import body
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.fleet.answers.hosts import HostStanding
from labweb.fleet.services import fencing
from labweb.resources import selectors as resource_selectors
from labweb.runs.api.runs import Reason


class HostReason(Reason):
    """Why; and for a revocation, whether it is known that the host has work."""

    with_work: bool = False


class HostAct(Endpoint):
    """Fence, revoke or readmit."""

    signs = frozenset({"post"})
    act = ""
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": HostReason}

    def post(self, request: Request, host_id: UUID) -> HostStanding:
        """Carry out the act; say how the host stands then."""
        user, said = user_of(request), body(request, HostReason)
        reason = said.reason
        enrollment_selectors.visible_host(resource_selectors.the_lab(), host_id, user)
        if self.act == "fence":
            host = fencing.fence_host(host_id, actor=user, reason=reason)
        elif self.act == "revoke":
            host = fencing.revoke_host(host_id, actor=user, reason=reason, with_work=said.with_work)
        else:
            host = enrollment_services.readmit_host(host_id, actor=user, reason=reason)
        return HostStanding(id=host.id, state=SessionState(host.state))
