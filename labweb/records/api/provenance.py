"""The endpoints of provenance: what led to a thing, what it touched, and under which conditions."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import ApiAnswer
from labweb.common.clock import now
from labweb.common.requests import Parameter, identity, one_of, seconds, whole_number, word
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.api import visible as visible_resource
from labweb.crutd.selectors.lineage import DEEPEST
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.provenance.graph_views import to_json
from labweb.domain.crutd.provenance.prov_json_write import render_prov
from labweb.domain.errors import NotFoundError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.records.answers.provenance import ProvenanceGraph, ResourceConditions
from labweb.records.selectors import conditions as condition_selectors
from labweb.records.selectors import provenance, visible_provenance
from labweb.records.selectors.provenance import Provenance
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs.api.runs import visible as visible_run
from labweb.telemetry import selectors as telemetry_selectors

_FORMS = ("json", "prov")
_DEPTH = 10
_GRAPH: Mapping[str, Parameter] = {
    "direction": one_of(provenance.DIRECTIONS),
    "depth": Parameter({"type": "integer", "minimum": 1, "maximum": DEEPEST}),
    "form": one_of(_FORMS, "Of the answer; prov: the graph as a PROV-JSON document."),
}
_DOCUMENTS: Mapping[str, str] = {"form": "prov"}
_ANSWERS: Mapping[str, Mapping[int, type[ApiAnswer]]] = {"get": {200: ProvenanceGraph}}


def _asked(request: Request) -> dict[str, Any]:
    """Read `direction` and `depth`.

    Raises:
        DefinitionError: One of them is none that is offered.
    """
    direction = word(request, "direction", provenance.DIRECTIONS)
    word(request, "form", _FORMS)
    depth = whole_number(request, "depth", default=_DEPTH, low=1, high=DEEPEST)
    return {"direction": direction, "depth": depth}


def _told(request: Request, found: Provenance) -> Response:
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    graph = visible_provenance.seen_by(found, seen)
    if request.query_params.get("form") == "prov":
        return Response(render_prov(graph, str(found.lab.id)))
    told = {**to_json(graph), "truncation": found.truncation()}
    return Response(msgspec.convert(told, ProvenanceGraph))


class ResourceProvenance(Endpoint):
    """What led to a resource, and what it touched."""

    queries = _GRAPH
    documents = _DOCUMENTS
    answers = _ANSWERS

    def get(self, request: Request, resource_id: UUID) -> Response:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        row = visible_resource(request, resource_id)
        return _told(request, provenance.of_resource(row, **_asked(request)))


class LotProvenance(Endpoint):
    """What was made from a lot."""

    queries = _GRAPH
    documents = _DOCUMENTS
    answers = _ANSWERS

    def get(self, request: Request, lot_id: UUID) -> Response:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        lab = resource_selectors.the_lab()
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        lots = {lot.id: lot for lot in crutd_selectors.visible_lots(lab, seen)}
        if lot_id not in lots:
            raise NotFoundError(f"no lot {lot_id}", code="lot.not_found")
        return _told(request, provenance.of_lot(lots[lot_id], **_asked(request)))


class RunProvenance(Endpoint):
    """What a run used and made."""

    queries = _GRAPH
    documents = _DOCUMENTS
    answers = _ANSWERS

    def get(self, request: Request, run_id: UUID) -> Response:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        run = visible_run(run_id, user_of(request))
        return _told(request, provenance.of_run(run, **_asked(request)))


class FileProvenance(Endpoint):
    """What a kept file is of."""

    queries = _GRAPH
    documents = _DOCUMENTS
    answers = _ANSWERS

    def get(self, request: Request, file_id: UUID) -> Response:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        row = telemetry_selectors.find_file(*_place(file_id, request))
        return _told(request, provenance.of_file(row.made_from or row, **_asked(request)))


class ReadingProvenance(Endpoint):
    """Where a reading comes from."""

    queries = _GRAPH
    documents = _DOCUMENTS
    answers = _ANSWERS

    def get(self, request: Request, reading_id: UUID) -> Response:
        """Return the graph: `direction` up, down or both; `depth`; `form` json or prov."""
        row = telemetry_selectors.find_reading(*_place(reading_id, request))
        return _told(request, provenance.of_reading(row, **_asked(request)))


def _place(row_id: UUID, request: Request) -> tuple[Lab, UUID, set[UUID]]:
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    return resource_selectors.the_lab(), row_id, seen


class Conditions(Endpoint):
    """What a device told while a resource was in it."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        "device": Parameter({"type": "string", "format": "uuid"}, "Which.", is_required=True),
        "since_s": Parameter({"type": "number"}, "Begin, seconds since the Unix epoch."),
        "until_s": Parameter({"type": "number"}, "End; without it, now."),
    }

    def get(self, request: Request, resource_id: UUID) -> ResourceConditions:
        """Return each stay in the device `device` from `since_s` to `until_s`.

        Without `since_s` from when the resource was made, without `until_s` till now.
        """
        row = visible_resource(request, resource_id)
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        device = enrollment_selectors.find_device(identity(request, "device"), seen)
        until = seconds(request, "until_s", now().timestamp())
        since = seconds(request, "since_s", condition_selectors.made_s(row))
        found = condition_selectors.conditions(
            row,
            device,
            since=datetime.fromtimestamp(since, UTC),
            until=datetime.fromtimestamp(until, UTC),
        )
        _hide_acts(request, found)
        _hide_files(device.lab, seen, found)
        _hide_surroundings(device.lab, seen, found)
        return msgspec.convert(found, ResourceConditions)


def _hide_acts(request: Request, found: dict[str, Any]) -> None:
    """Leave out the acts of runs that the caller may not know of."""
    runs = {act["run_id"] for stay in found["stays"] for act in stay["acts"]}
    if runs:
        known = visible_provenance.shown_runs(runs, user_of(request))
        for stay in found["stays"]:
            stay["acts"] = [act for act in stay["acts"] if act["run_id"] in known]


def _hide_surroundings(lab: Lab, seen: set[UUID], found: dict[str, Any]) -> None:
    """Leave out the readings of devices that the caller may not know of."""
    known = {str(row.pk) for row in enrollment_selectors.visible_devices(lab, seen)}
    for act in (act for stay in found["stays"] for act in stay["acts"]):
        act["contexts"] = {
            moment: {
                **context,
                "environment": [r for r in context["environment"] if r["device_id"] in known],
            }
            for moment, context in act["contexts"].items()
        }


def _hide_files(lab: Lab, seen: set[UUID], found: dict[str, Any]) -> None:
    """Leave out the files about what the caller may not know of."""
    ids = {UUID(file["file_id"]) for stay in found["stays"] for file in stay["files"]}
    if ids:
        rows = telemetry_selectors.visible_files(lab, seen).filter(pk__in=ids)
        shown_ids = {str(pk) for pk in rows.values_list("pk", flat=True)}
        for stay in found["stays"]:
            stay["files"] = [file for file in stay["files"] if file["file_id"] in shown_ids]
