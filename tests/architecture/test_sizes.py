"""A file fits in the head: 400 lines, functions 60."""

from __future__ import annotations

from pathlib import PurePath

import pytest

from tests.architecture.project import ROOT, files
from tests.architecture.sizes import is_exempt, long_files, long_functions

MEASURED = [path for path in files() if path.suffix in {".py", ".ts", ".tsx"}]


def test_no_file_is_longer_than_four_hundred_lines() -> None:
    found = [
        line
        for path in MEASURED
        if not is_exempt(path)
        for line in long_files(str(path), (ROOT / path).read_text("utf-8"))
    ]
    assert not found, "\n".join(found)


def test_no_function_is_longer_than_sixty_lines() -> None:
    found = [
        line
        for path in MEASURED
        if not is_exempt(path)
        for line in long_functions(str(path), (ROOT / path).read_text("utf-8"))
    ]
    assert not found, "\n".join(found)


def test_a_file_of_four_hundred_and_one_lines_is_reported() -> None:
    assert not long_files("a.py", "x = 1\n" * 400)
    assert long_files("a.py", "x = 1\n" * 401) == ["a.py: 401 lines"]


@pytest.mark.parametrize("head", ["def f() -> None:", "async def f() -> None:"])
def test_a_python_function_of_sixty_one_lines_is_reported(head: str) -> None:
    assert not long_functions("a.py", head + "\n    x = 1" * 59)
    assert long_functions("a.py", head + "\n    x = 1" * 60) == ["a.py:1 f: 61 lines"]


def test_a_long_method_inside_a_class_is_reported() -> None:
    text = "class A:\n    def f(self) -> None:" + "\n        x = 1" * 60
    assert long_functions("a.py", text) == ["a.py:2 f: 61 lines"]


@pytest.mark.parametrize(
    "head",
    [
        "function f() {",
        "export function f(a: Map<string, number>): Promise<void> {",
        "const f = (a: string): void => {",
        "class A { f(a: string) {",
        "const s = 'if (x) {'; const f = async () => {",
    ],
)
def test_a_typescript_function_of_sixty_one_lines_is_reported(head: str) -> None:
    end = "\n}" + "}" * head.startswith("class")
    assert not long_functions("a.ts", head + "\n  g();" * 58 + end)
    assert long_functions("a.ts", head + "\n  g();" * 59 + end) == ["a.ts:1 function: 61 lines"]


def test_a_long_type_or_a_long_block_is_not_a_function() -> None:
    assert not long_functions("a.ts", "type A = {" + "\n  b: number;" * 80 + "\n}")
    assert not long_functions("a.ts", "if (a()) {" + "\n  g();" * 80 + "\n}")


def test_only_migrations_generated_files_and_tables_are_exempt() -> None:
    exempt = ["labweb/runs/migrations/0001_initial.py", "src/schema.gen.ts", "a/media_table.py"]
    assert all(is_exempt(PurePath(name)) for name in exempt)
    assert not any(is_exempt(PurePath(name)) for name in ["a/table.py", "a/generated.py"])
