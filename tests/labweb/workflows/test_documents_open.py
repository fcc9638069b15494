"""Whatever the server keeps as a draft opens in the editor, as the editor itself shows."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from labweb.domain.workflows.unit_operations.step_palette import palette
from labweb.domain.workflows.workflow_draft import check_draft
from tests.domain.workflows.documents import JSON, bent, documents, places, templates

FRONTEND = Path(__file__).parents[3] / "frontend"
COUNT = 400 if "LABWEB_SOAK" in os.environ else 40


def accepted(count: int) -> list[dict[str, Any]]:
    """Return documents that the server keeps: templates, drawn ones, ones bent in a place."""
    kept = templates()

    @seed(2026)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def collect(data: st.DataObject) -> None:
        value = data.draw(st.sampled_from(templates()) | documents())
        if data.draw(st.booleans()):
            value = bent(value, data.draw(st.sampled_from(list(places(value)))), data.draw(JSON))
        if check_draft(value) == []:
            kept.append(value)

    collect()
    return kept


@pytest.mark.slow
def test_every_draft_that_the_server_keeps_opens_in_the_editor(tmp_path: Path) -> None:
    npx = shutil.which("npx")
    assert npx is not None, "Node is needed: see CONTRIBUTING.md"
    kept = accepted(COUNT)
    assert len(kept) > COUNT // 4
    corpus = tmp_path / "documents.json"
    corpus.write_text(json.dumps({"steps": palette(), "documents": kept}), encoding="utf-8")
    done = subprocess.run(
        [npx, "vitest", "run", "src/editor/opening.test.tsx"],
        cwd=FRONTEND,
        env={**os.environ, "LABWEB_DOCUMENTS": str(corpus), "CI": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-6000:]
