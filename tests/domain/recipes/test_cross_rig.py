"""The published cross-rig matrix beside what is made of the same recipes and rigs here.

A sample is judged anew each time; with `LABWEB_SOAK=1` all pairs are.
"""

from __future__ import annotations

import os
from collections import Counter

import pytest

from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.test_recipe_corpus import DOCS

pytestmark = [
    pytest.mark.skipif(not XDL.exists(), reason=NO_XDL),
    pytest.mark.timeout(0 if "LABWEB_SOAK" in os.environ else 300),
]

if XDL.exists():
    from tests.domain.recipes.cross_rig import Judged, grid, judged, matrix, pairs

SAMPLE = (
    ("orgsyn_v80p0129", "TEMPLATE_std6"),
    ("orgsyn_v80p0129", "lidocaine"),
    ("orgsyn_v80p0129", "antiviral_Arbidol_step2"),
    ("antiviral_Chloroquine_v4", "orgsyn_v80p0129"),
    ("antiviral_Arbidol_step7", "orgsyn_v81p0262"),
    ("orgsyn_v87p0016", "DMP"),
)


def cell(recipe: str, rig: str) -> str:
    """Return what the documentation says of a pair."""
    table = DOCS.read_text("utf-8")
    table = table[table.index("| recipe | 1 |") :]
    rigs = sorted({pair[1] for pair in pairs()})
    row = next(line for line in table.splitlines() if line.startswith(f"| `{recipe}` |"))
    return row.split("|")[2 + rigs.index(rig)].strip()


@pytest.mark.parametrize(("recipe", "rig"), SAMPLE)
def test_a_pair_is_as_the_docs_say(recipe: str, rig: str) -> None:
    found = judged(recipe, rig)
    ran = matrix()[recipe, rig]["executed"] == "True"
    assert cell(recipe, rig) == ("R" if ran else "–") + found.ours
    assert found.is_equal is not False


def test_every_pair_that_lies_here_is_in_the_table() -> None:
    assert all(cell(*pair)[1:] in ("p", "l", "d", "x") for pair in pairs())
    assert len(pairs()) == 324


def test_by_the_table_all_that_the_reference_runs_is_run_here() -> None:
    cells = Counter(cell(*pair) for pair in pairs())
    assert cells["Rx"] == 0
    assert sum(count for text, count in cells.items() if text[0] == "R") == 60
    assert (cells["Rp"], cells["Rl"], cells["Rd"]) == (17, 40, 3)
    assert (cells["–p"], cells["–l"], cells["–d"], cells["–x"]) == (4, 25, 116, 119)


@pytest.mark.skipif("LABWEB_SOAK" not in os.environ, reason="takes half an hour: LABWEB_SOAK=1")
def test_the_whole_matrix_is_as_the_docs_say() -> None:
    table = DOCS.read_text("utf-8")
    missing = [line for line in grid(pairs()) if line not in table]
    assert not missing, missing
    all_judged: list[Judged] = [judged(*pair) for pair in pairs()]
    assert Counter(one.is_equal for one in all_judged)[False] == 0
