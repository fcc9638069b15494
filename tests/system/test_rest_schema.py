"""Whatever is asked, each answer of a live server is one that the schema describes."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.rest_people import VARIABLES
from tests.system.rest_probe import OUT_OF_REACH, Probe
from tests.system.stack import CHECKOUT, Stack, running

IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
FOR_S = 900.0 if IS_SOAK else 60.0
SEED = int(os.environ.get("LABWEB_SEED", "0"))
LEAST_REACHED_RATIO = 0.9
"""Share of the operations that can succeed in this lab, and have to."""

FIGURES = CHECKOUT / "docs" / "figures" / "rest.txt"

pytestmark = [pytest.mark.slow, pytest.mark.timeout(FOR_S + 240)]


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with running(folder / "lab", variables=VARIABLES) as found:
            yield found
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def test_every_answer_is_as_the_schema_says(stack: Stack) -> None:
    probe = Probe(stack, SEED)
    probe.run(FOR_S)
    tally = probe.tally
    told = "\n".join([*tally.lines(), *(f"{at}\n  {what}" for at, what in tally.faults.items())])
    if IS_SOAK:
        FIGURES.write_text(f"seed {SEED}, {FOR_S:g} s\n{told}\n")
    assert not tally.faults, told
    possible = set(tally.statuses) - set(OUT_OF_REACH)
    assert len(possible & tally.reached()) >= LEAST_REACHED_RATIO * len(possible), told
