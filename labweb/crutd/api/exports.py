"""Downloads of the lab, of what it received and of what it holds."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from typing import ClassVar

from django.http import HttpResponse
from django.utils.http import content_disposition_header
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.clock import now
from labweb.common.requests import Parameter, moment, one_of, word
from labweb.crutd.answers import ResourceRow
from labweb.crutd.api import AT, past_rows, resource_rows
from labweb.crutd.selectors.deliveries import deliveries_of
from labweb.crutd.selectors.history_replay import as_it_was
from labweb.crutd.selectors.lab_export import lab_file_of
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.delivery_table import render_deliveries
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

CSV = "text/csv; charset=utf-8"
CONTENTS = ("key", "name", "kind", "lot", "material", "amount_nl", "amount_ug")
FORMS = ("labweb", "uni-lab-os")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def _whole_lab(request: Request) -> Lab:
    """Return the lab, for those alone who may see all of it."""
    lab = resource_selectors.the_lab()
    ids = {row.id for row in resource_selectors.resources_of(lab)}
    resource_selectors.require(user_of(request), Permission.VIEW, ids)
    return lab


class LabExport(Endpoint):
    """The lab as a file."""

    answer_type = "application/json"

    queries: ClassVar[Mapping[str, Parameter]] = {"form": one_of(FORMS)}

    def get(self, request: Request) -> HttpResponse:
        """Return lab.json, or with `form=uni-lab-os` a graph of Uni-Lab-OS."""
        form = word(request, "form", FORMS)
        lab = _whole_lab(request)
        if form == FORMS[0]:
            return _file(render_lab(lab_file_of(lab)), self.answer_type, f"{lab.key}.lab.json")
        graph = export_uni_lab_os(lab_file_of(lab))
        text = json.dumps(graph, ensure_ascii=False, indent=2, allow_nan=False) + "\n"
        return _file(text.encode(), self.answer_type, f"{lab.key}.uni-lab-os.json")


class LotsExport(Endpoint):
    """What was received."""

    answer_type = "text/csv"

    def get(self, request: Request) -> HttpResponse:
        """Return every lot with the vessels that it came into, as the import of lots reads it."""
        lab = _whole_lab(request)
        text = render_deliveries(deliveries_of(lab))
        return _file(text.encode(), CSV, f"{lab.key}.lots.csv")


class ContentsExport(Endpoint):
    """What is where."""

    answer_type = "text/csv"

    queries: ClassVar[Mapping[str, Parameter]] = {"at": AT}

    def get(self, request: Request) -> HttpResponse:
        """Return a row for each lot in each vessel that the caller may see, now or `at` a time."""
        lab = resource_selectors.the_lab()
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        at = moment(request, "at")
        if at is not None:
            rows = past_rows(lab, as_it_was(lab, at, now=now()), seen)
        else:
            found = [row for row in resource_selectors.resources_of(lab) if row.id in seen]
            rows = resource_rows(lab, found)
        return _file(_table(rows).encode(), CSV, f"{lab.key}.contents.csv")


def _table(rows: Iterable[ResourceRow]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(CONTENTS)
    for row in rows:
        for held in row.contents:
            texts = (row.key, row.name, row.kind, held.lot, held.material)
            writer.writerow([*map(_plain, texts), held.amount_nl, held.amount_ug])
    return out.getvalue()


def _plain(text: str) -> str:
    """Keep a spreadsheet from taking a name for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _file(content: bytes, media_type: str, name: str) -> HttpResponse:
    disposition = {
        "Content-Disposition": content_disposition_header(as_attachment=True, filename=name)
    }
    return HttpResponse(content, content_type=media_type, headers=disposition)
