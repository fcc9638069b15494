"""Ask the server for what it makes of a recipe."""

from __future__ import annotations

import base64
import json
from typing import Any

from django.http import HttpResponse
from django.test import Client

from labweb.workflows.models import WorkflowVersion
from tests.domain.recipes.test_opening import WATER
from tests.labweb.web import call

API = "/api/v1/recipes"


def packed(raw: bytes) -> str:
    return base64.b64encode(raw).decode()


def post(client: Client, act: str, **body: object) -> HttpResponse:
    return call(client, "POST", f"{API}/{act}", body)


def opened(client: Client, **body: object) -> dict[str, Any]:
    answer = post(client, "open", **body)
    assert answer.status_code == 200, answer.content[:500]
    found: dict[str, Any] = json.loads(answer.content)
    return found


def kept(chemist: Client, recipe: bytes = WATER) -> WorkflowVersion:
    keys = {"Water": "water", "reactor": "reactor_1"}
    answer = post(chemist, "keep", name="Warm", recipe=packed(recipe), bind=keys)
    return WorkflowVersion.objects.get(pk=json.loads(answer.content)["version"]["id"])
