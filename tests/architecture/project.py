"""Where the project's files are, and what they import."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("labweb", "labweb_client", "drivers", "workers", "twin", "fixtures", "deploy")


@cache
def files() -> tuple[Path, ...]:
    """List every file that git tracks or would track, relative to the root."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    paths = (Path(name) for name in listed.split("\0") if name)
    return tuple(sorted(path for path in paths if (ROOT / path).is_file()))


def python_files(*packages: str) -> list[Path]:
    """List the Python files below the named top-level folders, relative to the root."""
    return [path for path in files() if path.suffix == ".py" and path.parts[0] in packages]


def tree_of(path: Path) -> ast.Module:
    """Parse one file of the project."""
    return ast.parse((ROOT / path).read_text(encoding="utf-8"), filename=str(path))


@cache
def imported_by(path: Path) -> frozenset[str]:
    """Return the dotted names that one file of the project imports."""
    return frozenset(imports_of(tree_of(path)))


def imports_of(tree: ast.Module) -> Iterator[str]:
    """List the dotted names that a module imports, wherever in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def run_tool(*argv: str, cwd: Path = ROOT, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """Run a program of this environment and capture what it says."""
    tool = Path(sys.executable).with_name(argv[0])
    return subprocess.run(
        [str(tool), *argv[1:]],
        cwd=cwd,
        input=stdin,
        check=False,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "COLUMNS": "200"},
    )
