"""The download of a run as an RO-Crate."""

from __future__ import annotations

from typing import ClassVar
from uuid import UUID

from django.http import StreamingHttpResponse
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.files.download import sent
from labweb.domain.approvals.role_permissions import Permission
from labweb.records.services.electronic_lab_notebook import MEDIA_TYPE, name_of, pack_eln
from labweb.records.services.ro_crate import pack_run
from labweb.resources import selectors as resource_selectors
from labweb.runs.api.runs import visible


class RunCrate(Endpoint):
    """A run with all that belongs to it, in one file."""

    answer_type = "application/zip"
    refusals: ClassVar = {"get": {409, 422}}  # a file of the run is damaged, or missing

    def get(self, request: Request, run_id: UUID) -> StreamingHttpResponse:
        """Return a ZIP file: workflow version, plan, events, telemetry, readings, provenance."""
        user = user_of(request)
        run = visible(run_id, user)
        packed = pack_run(run, resource_selectors.allowed_ids(user, Permission.VIEW))
        return sent(packed, self.answer_type, f"run-{run.number}.crate.zip")


class RunEln(Endpoint):
    """A run for an electronic lab notebook."""

    answer_type = MEDIA_TYPE
    refusals: ClassVar = {"get": {409, 422}}  # as of the crate

    def get(self, request: Request, run_id: UUID) -> StreamingHttpResponse:
        """Return an .eln file: the crate of the run as one experiment."""
        user = user_of(request)
        run = visible(run_id, user)
        packed = pack_eln(run, resource_selectors.allowed_ids(user, Permission.VIEW))
        return sent(packed, self.answer_type, f"{name_of(run)}.eln")
