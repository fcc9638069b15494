"""An endpoint lives in the app that owns the first word of its address, so that it is found.

What hangs below a thing of another app (`runs/<id>/provenance`) has a word of its own, which
decides: `PARTS`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from django.urls import URLPattern, URLResolver

from labweb.api import urls

OWNERS = {
    "approvals": "approvals",
    "calibrations": "calibration",
    "connections": "resources",
    "deliveries": "api",
    "devices": "fleet",
    "drivers": "fleet",
    "files": "records",
    "handovers": "runs",
    "home": "api",
    "hosts": "fleet",
    "jobs": "runs",
    "join-requests": "enrollment",
    "join-tokens": "enrollment",
    "lab": "runs",
    "lots": "crutd",
    "operations": "crutd",
    "readings": "records",
    "recipes": "workflows",
    "reservations": "runs",
    "resources": "crutd",
    "runs": "runs",
    "search": "api",
    "session": "api",
    "steps": "workflows",
    "tickets": "crutd",
    "tokens": "api",
    "tryouts": "fleet",
    "twin": "api",
    "workflows": "workflows",
}
"""The app of each first word; `api` holds what belongs to no app, or to all of them."""

PARTS = {
    "calibrations": "calibration",
    "conditions": "records",
    "crate": "records",
    "custody": "runs",
    "eln": "records",
    "handover": "runs",
    "lab/export": "crutd",
    "photo": "telemetry",
    "provenance": "records",
    "report": "records",
    "reservations": "runs",
    "telemetry": "telemetry",
}
"""The app of what hangs below a thing of another app."""

ELSEWHERE = {
    "approvals": "runs: a request is shown with the run that waits for it",
    "approvals/<>": "runs: with its plan",
    "approvals/<>/decision": "runs: the run goes on with it",
    "operations": "runs: what a person does may need a vessel that a host has in its hands",
    "operations/check": "runs: as above",
    "resources/<>": "records: its events name their runs",
    "resources/<>/events": "records: as above",
    "workflows": "runs: each is shown with its last run",
    "workflows/<>": "runs: as above",
    "workflows/check": "runs: a check is the preview of a start",
}
"""Addresses that need more than the app of their word may know, each with app and reason."""

NOT_YET_IN_FLEET = {"devices", "drivers", "hosts", "tryouts"}
"""Words whose endpoints are on their way into an app of their own."""


def endpoints(patterns: list[Any], before: str = "") -> Iterator[tuple[str, str]]:
    """Yield each address, `<>` for what stands for a thing, with the app that answers it."""
    for one in patterns:
        address = before + str(one.pattern)
        if isinstance(one, URLResolver):
            yield from endpoints(one.url_patterns, address)
        elif isinstance(one, URLPattern):
            view: Any = one.callback
            module = getattr(view, "view_class", getattr(view, "cls", view)).__module__
            yield re.sub(r"<[^>]*>", "<>", address), module.split(".")[1]


ALL = sorted(set(endpoints(urls.urlpatterns)))


def owner_of(address: str) -> str:
    """Return the app in which the endpoint of an address belongs."""
    if address in PARTS:
        return PARTS[address]
    words = address.split("/")
    return next((PARTS[word] for word in words[1:] if word in PARTS), OWNERS[words[0]])


@pytest.mark.parametrize(("address", "app"), ALL)
def test_an_endpoint_lives_in_the_app_of_its_address(address: str, app: str) -> None:
    wanted = owner_of(address)
    if address in ELSEWHERE:
        wanted = ELSEWHERE[address].split(":")[0]
    if address.split("/")[0] in NOT_YET_IN_FLEET and wanted == "fleet":
        assert app in {"api", "fleet", "runs"}
    else:
        assert app == wanted


def test_every_exception_is_still_one() -> None:
    known = dict(ALL)
    assert not [one for one in ELSEWHERE if one not in known or known[one] == owner_of(one)]


def test_an_endpoint_in_the_wrong_app_is_noticed() -> None:
    assert owner_of("runs/<>/pause") == "runs"
    assert owner_of("runs/<>/provenance") == "records"
    assert owner_of("devices/<>/calibrations/ph") == "calibration"
