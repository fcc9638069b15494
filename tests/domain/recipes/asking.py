"""What the tests of XDL ask: a small recipe, and the findings of a refusal."""

from __future__ import annotations

from pathlib import Path

import pytest

from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe
from labweb.domain.recipes.xdl.tables.step_spec import STEPS, StepTable, step_spec
from tests.corpus import XDL

HARDWARE = '<Component id="reactor" type="reactor"/><Component id="flask" type="flask"/>'
REAGENTS = (
    '<Reagent name="water" density="1 g/mL" molecular_weight="18 g/mol"/>'
    '<Reagent name="salt" solid="true" molecular_weight="58.443 g/mol"/>'
)

MOCK_MEASURE = step_spec("MockMeasure", "target_repeats:count=1", is_monitor=True)
"""A monitor of the reference's own tests: done when it was carried out so often."""

TEST_TABLE = StepTable({**STEPS.steps, "MockMeasure": MOCK_MEASURE})


def text(steps: str, *, reagents: str = REAGENTS, before: str = "", extra: str = "") -> bytes:
    """Write a recipe around some steps."""
    return (
        f"<XDL>{before}<Synthesis><Hardware>{HARDWARE}</Hardware>{extra}"
        f"<Reagents>{reagents}</Reagents><Procedure>{steps}</Procedure></Synthesis></XDL>"
    ).encode()


def recipe(steps: str, **around: str) -> Recipe:
    """Read a recipe around some steps."""
    return read_xdl(text(steps, **around))


def refused(raw: bytes) -> list[Finding]:
    """Return why a file is refused."""
    with pytest.raises(ProtocolError) as caught:
        read_xdl(raw)
    assert caught.value.findings
    assert caught.value.code == caught.value.findings[0].code
    return list(caught.value.findings)


def codes(raw: bytes) -> list[str]:
    """Return the codes of the reasons for which a file is refused."""
    return [finding.code for finding in refused(raw)]


def corpus_files(*folders: str) -> list[Path]:
    """List the published files of some folders, all when none is named."""
    tops = [XDL / folder for folder in folders] or [XDL]
    found = {p for top in tops for p in top.rglob("*") if p.suffix in {".xdl", ".xml", ".xdlexe"}}
    return sorted(found)
