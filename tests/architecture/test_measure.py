"""The figures of the house may only get better: `python -m tests.architecture.measure`."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.architecture import measure

MAX_LONG_CLASSES = 58
MAX_UNTYPED_LINES = 1876
MAX_NAMES_TWICE = 5


def test_no_folder_is_full() -> None:
    assert not measure.full_folders(measure.trees())


def test_a_package_defines_nothing_itself() -> None:
    assert not measure.packages_with_content(measure.trees().items())


def test_classes_do_not_get_longer() -> None:
    found = [
        each for path, tree in measure.trees().items() for each in measure.long_classes(path, tree)
    ]
    assert len(found) <= MAX_LONG_CLASSES, found


def test_functions_of_the_server_stay_short() -> None:
    lengths = measure.function_lengths(
        tree for path, tree in measure.trees().items() if path.parts[0] == "labweb"
    )
    assert lengths[len(lengths) // 2] <= 8
    assert lengths[len(lengths) * 9 // 10] <= 23


def test_what_is_typed_stays_typed() -> None:
    assert measure.untyped_lines() <= MAX_UNTYPED_LINES


def test_a_class_does_not_take_the_name_of_another() -> None:
    twice = measure.names_in_several_files(measure.trees().items())
    assert len(twice) <= MAX_NAMES_TWICE, twice


def test_modules_do_not_import_each_other() -> None:
    assert measure.circles(measure.by_module(measure.trees())) == []


def test_a_folder_of_twenty_six_modules_is_full() -> None:
    modules = [Path("a", f"m{number}.py") for number in range(25)]
    assert not measure.full_folders([*modules, Path("a", "__init__.py"), Path("a/b", "c.py")])
    assert measure.full_folders([*modules, Path("a", "m25.py")]) == {"a": 26}


def test_a_package_with_a_function_has_content_and_one_with_imports_has_none() -> None:
    package = Path("a", "__init__.py")
    imports = ast.parse("from a.b import c\n__all__ = ['c']")
    assert not measure.packages_with_content([(package, imports)])
    assert measure.packages_with_content([(package, ast.parse("def f(): ..."))]) == [package]


def test_a_class_of_twenty_one_methods_is_long() -> None:
    def tree(methods: int) -> ast.Module:
        return ast.parse("class A:\n" + "    def f(self): ...\n" * methods)

    assert not measure.long_classes(Path("a.py"), tree(20))
    assert measure.long_classes(Path("a.py"), tree(21)) == [
        measure.LongClass(Path("a.py"), "A", 22, 21)
    ]


def test_a_class_name_in_two_files_is_found_and_a_private_one_is_not() -> None:
    one, other = ast.parse("class A: ...\nclass _B: ..."), ast.parse("class A: ...\nclass _B: ...")
    assert measure.names_in_several_files([(Path("x.py"), one), (Path("y.py"), other)]) == {
        "A": [Path("x.py"), Path("y.py")]
    }


def test_modules_that_import_each_other_are_found_in_functions_too() -> None:
    found = measure.circles(
        {
            "p": ast.parse(""),
            "p.a": ast.parse("from p import b"),
            "p.b": ast.parse("def f():\n    from p.a import x"),
            "p.c": ast.parse("if TYPE_CHECKING:\n    from p.d import x"),
            "p.d": ast.parse("import p.c"),
        }
    )
    assert found == [["p.a", "p.b"]]
