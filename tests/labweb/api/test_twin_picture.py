"""The scene in a real browser, through the real proxy, drawn by the real viser."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

from labweb.api.twin import snapshot
from tests.labweb.api.twin_site import Site, there_is_a_twin_at
from twin import palette
from twin.palette import Role, Theme
from twin.scene import describe
from twin.server import Painter
from twin.state import Snapshot

CHROMIUM = shutil.which("chromium")
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 640, "height": 400}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(180),
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
    pytest.mark.skipif(
        "LABWEB_SOAK" not in os.environ,
        reason="software rendering takes minutes on a busy machine: part of `make soak`",
    ),
]


@pytest.fixture(params=palette.THEMES)
def painter(request: pytest.FixtureRequest) -> Iterator[Painter]:
    found = Painter(request.param)
    yield found
    found.stop()


def _pixels(site: Site, theme: Theme) -> np.ndarray[Any, Any]:
    client = site.client()
    cookies: Any = [
        {"name": name, "value": value, "url": site.url} for name, value in client.cookies.items()
    ]
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        context = browser.new_context(viewport=SIZE)  # type: ignore[arg-type]
        context.add_cookies(cookies)
        page = context.new_page()
        page.goto(f"{site.url}/twin/view/{'dark/' if theme == 'dark' else ''}")
        page.wait_for_selector("canvas")
        page.wait_for_timeout(12_000)
        picture = page.screenshot(timeout=90_000)
        browser.close()
    return np.asarray(Image.open(BytesIO(picture)).convert("RGB"), dtype=int)


def test_the_whole_bench_is_in_the_picture(site: Site, painter: Painter) -> None:
    painter.paint(describe(msgspec.convert(snapshot.snapshot(), Snapshot)))
    there_is_a_twin_at(painter.port)

    pixels = _pixels(site, painter.theme)

    ground = pixels[-1, 0]
    assert np.abs(ground - palette.colour(painter.theme, Role.GROUND)).max() < 24
    is_drawn = np.abs(pixels - ground).max(axis=2) > 5
    # The middle belongs to the scene; toast and panel of viser stay in the upper corners.
    scene = is_drawn[150:, :]
    assert 0.15 < scene.mean() < 0.95
    edges = np.concatenate([scene[:, 0], scene[:, -1], scene[-1, :]])
    assert edges.mean() < 0.02
