"""One lab of real processes and one browser for every test of this folder."""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

from tests.e2e.visitor import Visitor, visiting
from tests.system.stack import Stack, running

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
]

Visit = Callable[[str | None], Visitor]


@pytest.fixture(scope="package")
def stack() -> Iterator[Stack]:
    """Start the starter lab with its twin, twenty times as fast as real time."""
    logging.getLogger("httpx").setLevel(logging.WARNING)
    folder = Path(tempfile.mkdtemp(prefix="le-", dir="/tmp"))
    try:
        with running(folder / "lab", speed=20.0, with_twin=True) as lab:
            yield lab
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="package")
def chromium() -> Iterator[Browser]:
    """Start the browser of this machine, or the one that Playwright brought."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium: Browser, stack: Stack) -> Iterator[Visit]:
    """Let people in, each in a browser of their own; None is somebody not signed in."""
    with ExitStack() as tabs:

        def enter(username: str | None = "chemist") -> Visitor:
            tab: AbstractContextManager[Visitor] = visiting(chromium, stack, username)
            return tabs.enter_context(tab)

        yield enter
