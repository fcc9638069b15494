"""A row that is locked can be referred to meanwhile: `FOR NO KEY UPDATE`, nothing stronger.

`FOR UPDATE` conflicts with the check of a foreign key, which comes at the commit of who refers to
the row. Who commits may hold by then what the holder of the row waits for: the audit trail.
No row that is locked is deleted, nor its key changed, so nothing needs more.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.project import python_files, tree_of

_TOO_STRONG = re.compile(r"(?<!NO KEY )\bFOR\s+UPDATE\b")


def too_strong(path: Path, tree: ast.Module) -> Iterator[str]:
    """List the locks of a module that keep others from referring to their rows."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _name_of(node.func) == "select_for_update":
            has_key = {one.arg: ast.unparse(one.value) for one in node.keywords}
            if has_key.get("no_key") != "True":
                yield f"{path}:{node.lineno}: select_for_update() without no_key=True"
        elif isinstance(node, ast.Constant) and _TOO_STRONG.search(str(node.value)):
            yield f"{path}:{node.lineno}: FOR UPDATE without NO KEY"


def _name_of(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else ""


def test_every_row_lock_lets_others_refer_to_the_row() -> None:
    found = [line for path in python_files("labweb") for line in too_strong(path, tree_of(path))]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "rows.select_for_update()",
        "rows.select_for_update(of=('self',))",
        "rows.select_for_update(no_key=False)",
        "SQL = 'SELECT 1 FROM a FOR UPDATE NOWAIT'",
        "SQL = f'SELECT {a} FROM a FOR  UPDATE OF a'",
    ],
)
def test_a_lock_that_is_too_strong_is_reported(text: str) -> None:
    assert list(too_strong(Path("a.py"), ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "rows.select_for_update(of=('self',), no_key=True)",
        "SQL = 'SELECT 1 FROM a FOR NO KEY UPDATE'",
        "SQL = 'SELECT 1 FROM a FOR SHARE OF a'",
    ],
)
def test_a_lock_that_lets_others_refer_to_the_row_is_not(text: str) -> None:
    assert not list(too_strong(Path("a.py"), ast.parse(text)))
