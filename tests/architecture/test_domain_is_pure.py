"""The rules ask nothing of the world: no clock, no random, no file, no library but three."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.project import ROOT, imports_of, python_files, tree_of

LIBRARIES = {"pint", "rustworkx", "msgspec"}
WORLDLY = {
    "open", "input", "print", "exec", "eval", "__import__",
    "uuid1", "uuid4", "uuid7", "now", "utcnow", "today", "urandom",
}  # fmt: skip
DOMAIN = [path for path in python_files("labweb") if path.parts[1:2] == ("domain",)]


def foreign_imports(tree: ast.Module) -> list[str]:
    """List the imports that are neither standard library nor one of the three."""
    return [
        name
        for name in imports_of(tree)
        if not name.startswith("labweb.domain")
        and name.split(".")[0] not in sys.stdlib_module_names | LIBRARIES
    ]


def worldly_calls(tree: ast.Module) -> Iterator[str]:
    """List the calls whose answer depends on anything but their arguments."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        if name in WORLDLY:
            yield f"{name} in line {node.lineno}"


@pytest.mark.parametrize("path", DOMAIN, ids=str)
def test_a_domain_module_is_pure(path: Path) -> None:
    tree = tree_of(path)
    assert not foreign_imports(tree)
    assert not list(worldly_calls(tree))


def test_an_impure_module_is_seen() -> None:
    assert foreign_imports(ast.parse("import numpy")) == ["numpy"]
    assert foreign_imports(ast.parse("from labweb.runs import models")) == ["labweb.runs"]
    assert list(worldly_calls(ast.parse("import uuid\nuuid.uuid4()"))) == ["uuid4 in line 2"]
    assert list(worldly_calls(ast.parse("open('a')"))) == ["open in line 1"]


def test_the_whole_domain_is_imported_without_a_framework() -> None:
    modules = [".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in DOMAIN]
    program = (
        f"import {', '.join(modules)}\nimport sys\n"
        "print(*{'django', 'celery', 'channels', 'redis'} & sys.modules.keys())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert not done.stdout.strip()
