"""How easily a stranger finds the way about: folders, classes, functions, names and circles.

`python -m tests.architecture.measure` prints every figure, with what stands behind it.
"""

from __future__ import annotations

import ast
import re
import statistics
import sys
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import rustworkx

from tests.architecture.project import PACKAGES, ROOT, python_files, tree_of
from tests.architecture.sizes import is_exempt

MAX_FOLDER_MODULES = 25
MAX_CLASS_LINES = 250
MAX_CLASS_METHODS = 20

FOLDERS_OF_KINDS = frozenset(
    {
        "drivers/interfaces",
        "drivers/sensors",
        "drivers/connectors",
        "drivers/processing",
        "drivers/characterization",
        "drivers/logistics",
    }
)
"""One file for each model or role: they grow with the instruments, not with the rules."""

GIVEN_NAMES = frozenset({"Command", "Config"})
"""Names that others ask for: Django of a command, the catalog of what a driver is set up with."""

TYPED = ("labweb", "workers", "drivers", "twin")
"""Where a line with `Any` is counted."""

_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class LongClass:
    """A class that does not fit in the head."""

    path: Path
    name: str
    lines: int
    methods: int


def product_files() -> list[Path]:
    """List the Python files that are written by hand and shipped, relative to the root."""
    return [
        path
        for path in python_files(*PACKAGES)
        if "migrations" not in path.parts and "generated" not in path.parts
    ]


def full_folders(paths: Iterable[Path]) -> dict[str, int]:
    """Count the modules of each folder that holds too many of them side by side."""
    counts = Counter(str(path.parent) for path in paths if path.name != "__init__.py")
    return {
        folder: count
        for folder, count in sorted(counts.items())
        if count > MAX_FOLDER_MODULES and folder not in FOLDERS_OF_KINDS
    }


def packages_with_content(trees: Iterable[tuple[Path, ast.Module]]) -> list[Path]:
    """Return the packages that define something themselves: nobody looks for a rule there."""
    return [
        path
        for path, tree in trees
        if path.name == "__init__.py"
        and any(isinstance(node, (*_FUNCTIONS, ast.ClassDef)) for node in tree.body)
    ]


def long_classes(path: Path, tree: ast.Module) -> list[LongClass]:
    """Report the classes of one file that have too many lines or methods."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            methods = sum(isinstance(each, _FUNCTIONS) for each in node.body)
            if lines > MAX_CLASS_LINES or methods > MAX_CLASS_METHODS:
                found.append(LongClass(path, node.name, lines, methods))
    return found


def function_lengths(trees: Iterable[ast.Module]) -> list[int]:
    """Return the length of each function in lines, the shortest first."""
    return sorted(
        (node.end_lineno or node.lineno) - node.lineno + 1
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, _FUNCTIONS)
    )


def names_in_several_files(trees: Iterable[tuple[Path, ast.Module]]) -> dict[str, list[Path]]:
    """Return the public class names that stand in more than one file, with the files."""
    places: dict[str, list[Path]] = defaultdict(list)
    for path, tree in trees:
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(path)
    return {
        name: found
        for name, found in sorted(places.items())
        if len(found) > 1 and name not in GIVEN_NAMES
    }


def circles(modules: dict[str, ast.Module]) -> list[list[str]]:
    """Return the groups of modules that import each other, wherever in a module it is done.

    Imports for the type checker alone do not count: nothing is loaded by them.
    """
    graph = rustworkx.PyDiGraph()
    nodes = {name: graph.add_node(name) for name in modules}
    for name, tree in modules.items():
        for target in _imported(tree, modules):
            if target != name:
                graph.add_edge(nodes[name], nodes[target], None)
    groups = rustworkx.strongly_connected_components(graph)
    return sorted(sorted(graph[index] for index in group) for group in groups if len(group) > 1)


def _imported(tree: ast.Module, modules: Container[str]) -> Iterator[str]:
    for node in _at_run_time(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in modules:
                    yield inner
                elif node.module in modules:
                    yield node.module


def _at_run_time(node: ast.AST) -> Iterator[ast.AST]:
    for child in ast.iter_child_nodes(node):
        is_for_types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        if not is_for_types:
            yield child
            yield from _at_run_time(child)


def module_of(path: Path) -> str:
    """Return the dotted name of a file."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def by_module(files: Mapping[Path, ast.Module]) -> dict[str, ast.Module]:
    """Return the files under their dotted names."""
    return {module_of(path): tree for path, tree in files.items()}


@cache
def trees() -> dict[Path, ast.Module]:
    """Parse every file of the product."""
    return {path: tree_of(path) for path in product_files()}


def untyped_lines() -> int:
    """Count the lines on which the type checker is told to look away."""
    return sum(
        bool(re.search(r"\bAny\b", line))
        for path in python_files(*TYPED)
        if not is_exempt(path)
        for line in (ROOT / path).read_text("utf-8").splitlines()
    )


def report() -> Iterator[str]:
    """Print each figure, with what stands behind it."""
    found = trees()
    folders = full_folders(found)
    yield f"folders with more than {MAX_FOLDER_MODULES} modules: {len(folders)}"
    yield from (f"  {count} {folder}" for folder, count in folders.items())
    full = packages_with_content(found.items())
    yield f"packages with content of their own: {len(full)}"
    yield from (f"  {path}" for path in full)
    classes = [each for path, tree in found.items() for each in long_classes(path, tree)]
    yield (
        f"classes with more than {MAX_CLASS_LINES} lines or {MAX_CLASS_METHODS} methods: "
        f"{len(classes)}"
    )
    yield from (f"  {c.lines} lines, {c.methods} methods: {c.path} {c.name}" for c in classes)
    lengths = function_lengths(tree for path, tree in found.items() if path.parts[0] == "labweb")
    yield (
        f"functions of labweb: median {statistics.median(lengths):g} lines, "
        f"p90 {lengths[len(lengths) * 9 // 10]} lines, {len(lengths)} functions"
    )
    yield f"lines with Any in {', '.join(TYPED)}: {untyped_lines()}"
    twice = names_in_several_files(found.items())
    yield f"public class names in more than one file: {len(twice)}"
    yield from (f"  {name}: {', '.join(map(str, places))}" for name, places in twice.items())
    rounds = circles(by_module(found))
    yield f"circles of imports: {len(rounds)}"
    yield from (f"  {', '.join(group)}" for group in rounds)


if __name__ == "__main__":
    sys.stdout.writelines(f"{line}\n" for line in report())
