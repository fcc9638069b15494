"""A field that is taken from an answer changes the types of both clients, and the gate sees it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from drf_spectacular.generators import SchemaGenerator

from deploy.client import __main__ as maker
from tests.architecture.project import ROOT

SCHEMA = ROOT / "frontend" / "openapi.json"
TYPESCRIPT = ROOT / "frontend" / "src" / "model" / "api.gen.ts"
MODELS = ROOT / "labweb_client" / "generated" / "models.py"
ANSWER, FIELD = "SignedInUser", "initials"

pytestmark = pytest.mark.slow

Make = Callable[[dict[str, Any]], str]


@pytest.fixture
def schema() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(SCHEMA.read_text())
    return found


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Make:
    """Make the types of the Python client from a schema, elsewhere."""
    monkeypatch.setattr(maker, "SCHEMA", tmp_path / "openapi.json")
    monkeypatch.setattr(maker, "TARGET", tmp_path / "generated")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)  # says how it is formatted

    def make(schema: dict[str, Any]) -> str:
        maker.SCHEMA.write_text(json.dumps(schema))
        assert maker.main() == 0
        return (maker.TARGET / "models.py").read_text()

    return make


@pytest.fixture
def typescript(tmp_path: Path) -> Make:
    """Make the types of the pages from a schema, elsewhere, as `npm run generate` does."""
    package = json.loads((ROOT / "frontend" / "package.json").read_text())
    tool, _, *options, _ = package["scripts"]["generate"].split()

    def make(schema: dict[str, Any]) -> str:
        (tmp_path / "openapi.json").write_text(json.dumps(schema))
        made = tmp_path / "api.gen.ts"
        command = [f"node_modules/.bin/{tool}", str(tmp_path / "openapi.json"), *options, str(made)]
        subprocess.run(command, cwd=ROOT / "frontend", check=True, capture_output=True)
        return made.read_text()

    return make


def without_a_field(schema: dict[str, Any]) -> dict[str, Any]:
    answer = schema["components"]["schemas"][ANSWER]
    del answer["properties"][FIELD]
    answer["required"].remove(FIELD)
    return schema


def test_the_schema_in_the_tree_is_the_one_of_the_endpoints(schema: dict[str, Any]) -> None:
    make: Any = SchemaGenerator
    made = make(api_version=None).get_schema(public=True)
    assert json.loads(json.dumps(made))["paths"] == schema["paths"]
    assert json.loads(json.dumps(made))["components"] == schema["components"]


def test_a_field_less_changes_the_types_of_the_python_client(
    schema: dict[str, Any], python: Make
) -> None:
    assert python(schema) == MODELS.read_text()
    assert python(without_a_field(schema)) != MODELS.read_text()


def test_a_field_less_changes_the_types_of_the_pages(
    schema: dict[str, Any], typescript: Make
) -> None:
    assert typescript(schema) == TYPESCRIPT.read_text()
    assert typescript(without_a_field(schema)) != TYPESCRIPT.read_text()


def test_the_gate_compares_every_file_that_is_made_from_the_schema() -> None:
    gate = (ROOT / "deploy" / "setup" / "check").read_text()
    listed = re.search(r"git ls-files .* -- (.+) \|", gate)
    assert listed is not None
    patterns = [one.strip("'") for one in listed[1].split()]
    command = ["git", "ls-files", "--", *patterns]
    found = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    made = {str(path.relative_to(ROOT)) for path in (SCHEMA, TYPESCRIPT, MODELS)}
    assert made <= set(found.splitlines())
    assert 'step "generated files" generated_is_current' in gate
