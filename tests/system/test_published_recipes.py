"""Published recipes run to their end on rigs of four and six pumps, by simulated instruments."""

from __future__ import annotations

import pytest

from benchmarks.corpus import judge
from benchmarks.corpus_pairs import Pair, find_traces
from benchmarks.corpus_volumes import Compared
from tests.corpus import NO_XDL, XDL

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(not XDL.exists(), reason=NO_XDL),
]

SPEED = 400.0


@pytest.mark.parametrize(
    ("recipe", "rig", "jobs_count"),
    [
        ("unit_0.3/stirring.xdl", "unit_0.3/bigrig.json", 5),
        ("antiviral/Arbidol/Step5/Arbidol_step5.xdl", "antiviral/Arbidol/Step5/graph.json", 100),
    ],
)
def test_a_published_recipe_runs_to_its_end(recipe: str, rig: str, jobs_count: int) -> None:
    """A person confirms what is asked, and states what boils off.

    Of each reagent each vessel gets what the recipe's own software brought into it on that rig.
    """
    pair = Pair(recipe=XDL / recipe, rig=XDL / rig)
    trace = find_traces(XDL)[pair]
    judged = judge(pair, is_started=True, speed=SPEED, trace=trace)
    assert judged.findings == []
    assert judged.ran is not None
    assert judged.ran.is_complete
    assert judged.ran.jobs_count >= jobs_count
    assert judged.ran.bytes_count > 1000
    assert judged.compared == Compared(by="trace", differences=[])
