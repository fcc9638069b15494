"""REST of samples."""

from __future__ import annotations

import time
from uuid import UUID

from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts.selectors import user_of
from labweb.common.requests import seconds
from labweb.domain.approvals.roles import Permission
from labweb.domain.errors import NotFoundError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.telemetry import selectors

_DEFAULT_WINDOW_S = 600.0


class Telemetry(APIView):
    """What a device told."""

    def get(self, request: Request, device_id: UUID) -> Response:
        """Return the series of each status between `since_s` and `until_s`."""
        device = enrollment_selectors.find_device(device_id)
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        if not enrollment_selectors.is_seen(device, seen):
            raise NotFoundError(f"no device {device_id}", code="device.not_found")
        until = seconds(request, "until_s", time.time())
        since = seconds(request, "since_s", until - _DEFAULT_WINDOW_S)
        return Response({"series": selectors.series(device.id, since, until)})
