"""One lab of real processes for all tests of this folder that leave it whole."""

from __future__ import annotations

import logging
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.services import given_urls
from tests.system.stack import BROKER, Stack, running


@pytest.fixture(scope="session")
def stack() -> Iterator[Stack]:
    """Start the starter lab, sixty times as fast as real time."""
    with _starter_lab(embedded=False) as lab:
        yield lab


@pytest.fixture
def stack_to_break(request: pytest.FixtureRequest, process: str) -> Iterator[Stack]:
    """Give a lab whose process the test may kill, the broker included.

    A broker that was given to this run belongs to others too; then the lab is one of its own,
    with the embedded broker.
    """
    if process != BROKER or not given_urls():
        yield request.getfixturevalue("stack")
        return
    with _starter_lab(embedded=True) as lab:
        yield lab


@contextmanager
def _starter_lab(*, embedded: bool) -> Iterator[Stack]:
    logging.getLogger("httpx").setLevel(logging.WARNING)
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with running(folder / "lab", embedded=embedded, from_nothing=True) as lab:
            yield lab
    finally:
        shutil.rmtree(folder, ignore_errors=True)
