"""Random recipes on random rigs: what the compiler claims, the verifier proves, every time."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import compile_recipe
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.domain.recipes.invent import Invented, pairs
from tests.domain.recipes.plans import unproved

EXAMPLES = 5000 if "LABWEB_SOAK" in os.environ else 200
RARE = 0.2
"""Both what fits and what does not make up more than this part of the examples."""

pytestmark = pytest.mark.timeout(0 if "LABWEB_SOAK" in os.environ else 600)


def compiled(read: Recipe, rig: Rig) -> tuple[dict[str, Any] | None, Sequence[Finding]]:
    """Return the plan, or none and why."""
    try:
        return compile_recipe(read, rig), ()
    except LabError as error:
        return None, error.findings


def outcome(one: Invented) -> str:
    """Compile: a plan is proved, a refusal gives its reasons. Return which it was."""
    rig = read_rig(json.dumps(one.graph).encode())
    vessels = frozenset(Equipment(rig).vessels)
    read, findings = check_document(parse_markup(one.recipe.encode()), rig_vessels=vessels)
    assert not findings, findings
    plan, reasons = compiled(read, rig)
    if plan is None:
        assert reasons
        assert all(finding.code and finding.message for finding in reasons)
        return "refused"
    doubts = unproved(plan, rig)
    assert not doubts, [(doubt.code, doubt.message) for doubt in doubts]
    return "planned" if plan["steps"] else "nothing to do"


def test_compiler_and_verifier_never_disagree() -> None:
    counts: Counter[str] = Counter()

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(pairs())
    def follow(one: Invented) -> None:
        counts[outcome(one)] += 1

    follow()
    total = sum(counts.values())
    assert total >= EXAMPLES
    assert counts["planned"] > RARE * total, counts
    assert counts["refused"] > RARE * total, counts
