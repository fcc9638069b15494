"""Published Chemputer rigs with the default binding: planned right, or rightly not."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.binding_file import read_binding
from labweb.domain.recipes.graph_formats.lab_of_any_format import Format, LabDocument
from tests.acceptance.asking import Subject
from tests.acceptance.interpreter import Wanted
from tests.acceptance.test_uni_lab_os_labs import AMOUNTS_NL, check
from tests.corpus import NO_XDL, XDL

ROOT = Path(__file__).parents[2]
MOST_VALVES = 3
"""All settings of the valves are tried: with a longer backbone that takes minutes."""

pytestmark = pytest.mark.skipif(not XDL.is_dir(), reason=NO_XDL)


@cache
def subjects() -> list[Subject]:
    """Return the rigs with few valves."""
    binding = read_binding((ROOT / "fixtures/bindings/chemputer.json").read_bytes())
    found = []
    for path in sorted(XDL.rglob("*.json")):
        try:
            document = LabDocument(path.read_bytes(), path.stem)
            if document.format is not Format.CHEMPUTER:
                continue
            subject = Subject(document.bound(binding)[0])
        except LabFileError:
            continue
        valves = subject.plumbing.of_kind("rotary_valve")
        if 0 < len(valves) <= MOST_VALVES and len(subject.plumbing.vessels()) > 1:
            found.append(subject)
    return found


def test_random_transfers_on_published_rigs_have_the_right_verdict() -> None:
    dice, planned = random.Random(8), 0
    for subject in subjects():
        for _ in range(12):
            source, target = dice.sample(subject.plumbing.vessels(), 2)
            want = Wanted("t", source, target, dice.choice((1_000_000, *AMOUNTS_NL)))
            planned += check(subject, want)
    assert planned > 10
