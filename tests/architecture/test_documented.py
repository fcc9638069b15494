"""Every error code is public: it is listed, with what it means, in docs/errors.md."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping

from tests.architecture.project import ROOT, python_files, tree_of

CODE = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+")
DOCUMENTED = re.compile(rf"^\| `({CODE.pattern})` \| \S", re.MULTILINE)


def takers_in(trees: Iterable[ast.Module]) -> dict[str, set[int]]:
    """List the functions that take a code by position, and at which ones."""
    found: dict[str, set[int]] = {"Finding": {0}}
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [arg.arg for arg in node.args.args if arg.arg not in {"self", "cls"}]
            if "code" in names:
                found.setdefault(node.name, set()).add(names.index("code"))
    return found


def codes_in(tree: ast.Module, takers: Mapping[str, set[int]]) -> Iterator[str]:
    """List the codes that a module gives to errors and findings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield from _codes_of_call(node, takers)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = {target.id for target in targets if isinstance(target, ast.Name)}
            if "default_code" in names:
                yield from _text(node.value)


def _codes_of_call(call: ast.Call, takers: Mapping[str, set[int]]) -> Iterator[str]:
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    for position in takers.get(name, ()):
        yield from _text(call.args[position] if position < len(call.args) else None)
    for keyword in call.keywords:
        if keyword.arg == "code":
            yield from _text(keyword.value)


def codes_of_the_project() -> dict[str, str]:
    """Map each code in the source to a file that gives it."""
    trees = {path: tree_of(path) for path in python_files("labweb", "drivers", "workers", "twin")}
    takers = takers_in(trees.values())
    return {code: str(path) for path, tree in trees.items() for code in codes_in(tree, takers)}


def _text(node: ast.expr | None) -> Iterator[str]:
    if isinstance(node, ast.IfExp):
        yield from _text(node.body)
        yield from _text(node.orelse)
    elif isinstance(node, ast.Constant) and CODE.fullmatch(str(node.value)):
        yield str(node.value)


def test_every_error_code_is_documented_and_every_documented_code_exists() -> None:
    where = codes_of_the_project()
    listed = {found[0] for found in DOCUMENTED.findall(_page())}
    missing = [f"| `{code}` | … |  ({where[code]})" for code in sorted(where.keys() - listed)]
    gone = [f"| `{code}` |  (in no source file)" for code in sorted(listed - where.keys())]
    assert not missing, "docs/errors.md lacks these rows:\n" + "\n".join(missing)
    assert not gone, "docs/errors.md has rows for nothing:\n" + "\n".join(gone)


def test_no_code_is_documented_twice() -> None:
    listed = [found[0] for found in DOCUMENTED.findall(_page())]
    assert len(listed) == len(set(listed))


def test_codes_are_found_in_classes_findings_and_keywords() -> None:
    source = (
        'class A(LabError):\n    default_code = "a.one"\n'
        'raise A("x", code="a.two" if x else "a.three")\n'
        'Finding("a.four", "message")\nFinding(code="a.five", message="m")\n'
        'def refuse(self, where: str, code: str) -> None: ...\nself.refuse("x.x", "a.six")\n'
        'connect("not.a.code")\nrefuse()\n'
    )
    tree = ast.parse(source)
    numbers = ("one", "two", "three", "four", "five", "six")
    assert set(codes_in(tree, takers_in([tree]))) == {f"a.{number}" for number in numbers}


def _page() -> str:
    return (ROOT / "docs/errors.md").read_text("utf-8")
