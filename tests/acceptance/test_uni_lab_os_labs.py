"""Published graphs of Uni-Lab-OS with the default binding: planned right, or rightly not."""

from __future__ import annotations

import itertools
import os
import random
from functools import cache
from pathlib import Path

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.apply_binding import apply_binding
from labweb.domain.graph.lab_file.binding_file import read_binding
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from tests.acceptance.asking import Refusal, Subject
from tests.acceptance.interpreter import Wanted, prove_plan
from tests.corpus import GRAPHS, NO_GRAPHS

ROOT = Path(__file__).parents[2]
STATION = "comprehensive_protocol/comprehensive_station.json"
AMOUNTS_NL = (10_000_000, 60_000_000)
NO_WAY = {"plan.no_route", "plan.undriven_valve", "plan.no_device", "plan.ambiguous_port"}
"""Codes that say where the way breaks; which of them depends on what stands there."""

_PAIRS = 2000 if os.environ.get("LABWEB_SOAK") else 200

pytestmark = pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)


@cache
def subject_of(name: str) -> Subject:
    binding = read_binding((ROOT / "fixtures/bindings/uni_lab_os.json").read_bytes())
    lab, _ = apply_binding(read_uni_lab_os((GRAPHS / name).read_bytes(), name), binding)
    return Subject(lab)


@cache
def bound() -> list[str]:
    """Return the graphs that can be imported and have two vessels."""
    names = []
    for path in sorted(GRAPHS.rglob("*.json")):
        name = str(path.relative_to(GRAPHS))
        try:
            subject = subject_of(name)
        except LabFileError:
            continue
        if len(subject.plumbing.vessels()) > 1:
            names.append(name)
    return names


def check(subject: Subject, want: Wanted) -> bool:
    """Compare the verdicts; return whether there is a plan."""
    reasons = subject.plumbing.reasons(want.source, want.target, want.amount_nl)
    answer = subject.ask([want])
    if not isinstance(answer, Refusal):
        assert not reasons, (want, reasons)
        prove_plan(subject.file, answer, subject.keys, [want])
        return True
    assert reasons, (want, answer)
    assert {finding.subject for finding in answer.findings} == {want.step_id}
    assert answer.codes - NO_WAY == reasons - NO_WAY, (want, reasons, answer)
    assert bool(answer.codes & NO_WAY) == bool(reasons & NO_WAY), (want, reasons, answer)
    return False


def test_every_transfer_of_the_comprehensive_station_has_the_right_verdict() -> None:
    subject = subject_of(STATION)
    planned = 0
    for source, target in itertools.permutations(subject.plumbing.vessels(), 2):
        for amount_nl in AMOUNTS_NL:
            planned += check(subject, Wanted("t", source, target, amount_nl))
    assert planned > 10


def test_ten_millilitres_go_from_the_first_bottle_into_the_reactor() -> None:
    want = Wanted("t", "reagent_bottle_1", "main_reactor", 10_000_000)
    assert check(subject_of(STATION), want)


def test_random_transfers_on_all_other_graphs_have_the_right_verdict() -> None:
    dice, planned = random.Random(20), 0
    others = [name for name in bound() if name != STATION]
    plumbed = [name for name in others if subject_of(name).plumbing.pumps()]
    assert plumbed
    for place in range(_PAIRS):
        name = dice.choice(plumbed if place % 2 else others)
        subject = subject_of(name)
        source, target = dice.sample(subject.plumbing.vessels(), 2)
        want = Wanted("t", source, target, dice.choice((1_000_000, *AMOUNTS_NL)))
        planned += check(subject, want)
    assert planned > 5
