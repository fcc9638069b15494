"""The tables in docs/graphs.md say what the binding files say."""

from __future__ import annotations

from pathlib import Path

import pytest

from labweb.domain.graph.lab_file.binding_file import BindingFile, read_binding

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "graphs.md"
HEAD = ["| class | device | driver, or why none |", "|---|---|---|"]


def rows(binding: BindingFile) -> list[str]:
    """Return a row for each class: those with a device first, in the order of the rules."""
    found: dict[str, list[str]] = {}
    for rule in binding.devices:
        module = rule.driver.partition(":")[0].rpartition(".")[2]
        for sort in dict.fromkeys(one for classes in rule.roles.values() for one in classes):
            found.setdefault(sort, []).append(f"{rule.name} | `{module}`")
    made = [f"| `{sort}` | {text} |" for sort, texts in found.items() for text in texts]
    left = [
        f"| `{sort}` | – | {why} |" for sort, why in binding.unbound.items() if sort not in found
    ]
    return [*HEAD, *made, *left]


@pytest.mark.parametrize("name", ["uni_lab_os", "chemputer"])
def test_the_page_has_a_row_for_each_class_of_a_binding_and_no_other(name: str) -> None:
    binding = read_binding((ROOT / f"fixtures/bindings/{name}.json").read_bytes())
    assert binding.format == name
    tables = PAGE.read_text().split("→ device, or why none\n")[1:]
    table = tables[0 if name == "uni_lab_os" else 1]
    assert [line for line in table.splitlines() if line.startswith("|")] == rows(binding)


def test_no_class_is_both_a_device_and_unbound_but_as_the_line_of_another() -> None:
    for name in ("uni_lab_os", "chemputer"):
        binding = read_binding((ROOT / f"fixtures/bindings/{name}.json").read_bytes())
        first = {one for rule in binding.devices for one in next(iter(rule.roles.values()))}
        assert not first & binding.unbound.keys(), name
