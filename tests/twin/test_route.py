"""A page says which tubes to light: only keys count, and not without end."""

from __future__ import annotations

import json
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.twin import labs
from twin import palette
from twin.scene import describe
from twin.server import Painter, route_of

Points = NDArray[np.float32]


def test_keys_come_in_their_order_each_once() -> None:
    assert route_of('["t2", "t1", "t2"]') == ["t2", "t1"]


@pytest.mark.parametrize("text", ["", "no JSON", "7", '{"a": 1}', "[1, null, [2]]", "[" * 5000])
def test_what_is_no_list_of_keys_lights_nothing(text: str) -> None:
    assert route_of(text) == []


def test_a_route_has_an_end() -> None:
    assert len(route_of(json.dumps([str(n) for n in range(10_000)]))) == 500


class Person:
    """What a person's own page is told to draw."""

    def __init__(self) -> None:
        self.scene = self
        self.drawn: dict[str, dict[str, Any]] = {}

    def add_spline_catmull_rom(self, name: str, points: Points, **told: object) -> str:
        self.drawn[name] = {"points": points, **told}
        return name


def test_the_tubes_of_a_route_are_drawn_for_one_person_over_those_of_the_lab() -> None:
    painter, person = Painter("light"), Person()
    try:
        painter.paint(describe(labs.snapshot()))
        (key, tube), *_ = painter.scene.tubes.items()
        made = list(painter._draw_route(cast(Any, person), [key, "no tube"]))
    finally:
        painter.stop()
    assert made == list(person.drawn) == [f"/route/{key}"]
    shown = person.drawn[f"/route/{key}"]
    assert shown["points"] == pytest.approx(np.asarray(tube.points_mm) / 1000.0)
    assert shown["color"] == palette.colour("light", palette.Role.RUN)
