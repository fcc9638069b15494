"""Every address of the server says how quick it is, in one place."""

from __future__ import annotations

import inspect
import re
from typing import Any
from uuid import UUID

import pytest
from django.conf import settings

from labweb.api import rate_limits
from labweb.api.rate_limits import DECLARED, TERMS, Pace
from tests.labweb.web import methods_of, routes

HERE = [(route, view) for route, view in routes() if not route.startswith("admin/")]


def an_address(route: str) -> str:
    samples = {
        r"^api/": "api/none",
        r"^twin/view(?:/(?P<path>.*))?$": "twin/view/light/",
        r"^(?!api/|admin/|static/|ws/|twin/view).*$": "runs",
    }
    if route in samples:
        return samples[route]
    return re.sub(r"<int:\w+>", "7", re.sub(r"<uuid:\w+>", str(UUID(int=1)), route))


@pytest.mark.parametrize("route", [route for route, _ in HERE])
def test_every_address_is_declared_and_found_again(route: str) -> None:
    assert route in DECLARED, f"say in labweb/api/rate_limits.py how quick {route} is"
    found = rate_limits.find("/" + an_address(route))
    declared = DECLARED[route]
    for method in ("GET", "POST"):
        wanted = declared.get(method, Pace.QUICK) if isinstance(declared, dict) else declared
        assert found.pace(method) is wanted


def test_nothing_is_declared_that_is_no_address() -> None:
    own = {"admin/**", "static/**", "admin/enrollment/candidate/scan/"}
    assert DECLARED.keys() - {route for route, _ in HERE} == own
    assert any(route == "admin/enrollment/candidate/scan/" for route, _ in routes())


def _sends_a_file(view: Any, method: str) -> bool:  # noqa: ANN401 - a view
    kind = getattr(view, "view_class", None) or getattr(view, "cls", None)
    handler = getattr(kind, method.lower(), None)
    said = "" if handler is None else str(inspect.signature(handler).return_annotation)
    return "HttpResponse" in said


@pytest.mark.parametrize(
    ("method", "route"),
    [(m, route) for route, view in HERE for m in methods_of(view) if _sends_a_file(view, m)],
)
def test_what_sends_a_file_is_not_quick(method: str, route: str) -> None:
    assert rate_limits.find("/" + an_address(route)).pace(method) in {Pace.SLOW, Pace.STREAM}


def test_each_lane_has_connections_and_together_they_are_what_the_pool_has() -> None:
    lanes = {terms.lane for terms in TERMS.values() if terms.lane}
    assert lanes <= settings.LANES.keys()
    assert all(count >= 1 for count in settings.LANES.values())
    assert sum(settings.LANES.values()) < settings.POOL["max_size"]


def test_nobody_fills_a_lane_of_more_than_one_place_alone() -> None:
    for terms in TERMS.values():
        if terms.lane and settings.LANES[terms.lane] > 1:
            assert terms.own_count < settings.LANES[terms.lane], terms.lane
