"""The project speaks of itself alone, never of the place where it is written."""

from __future__ import annotations

import re
from pathlib import Path

from tests.architecture.project import ROOT, files

# Written in pieces, so that this file does not find itself.
PLACES = (
    r"(?<![\w.])/wo" + r"rk/",
    r"(?<![\w-])sha" + r"red/(?:data|design|reference|hooks)\b",
    r"(?<!\w)\.lib" + r"rary\b",
)
STRANGE = re.compile("|".join(PLACES))
SIBLING_DATA = "../sha" + "red/data"
TEXT = {".py", ".ts", ".tsx", ".js", ".mjs", ".css", ".html", ".md", ".toml", ".json", ".yaml"}
TEXT |= {".yml", ".ini", ".cfg", ".sh", ".txt", ".service", ".conf", ".sql", ".svg", ""}


def strange_lines(path: Path, text: str) -> list[str]:
    """List the lines that name the workplace; tests may look for data beside the project."""
    if path.parts[0] == "tests":
        text = text.replace(SIBLING_DATA, "")
    return [
        f"{path}:{number}: {line.strip()[:80]}"
        for number, line in enumerate(text.splitlines(), 1)
        if STRANGE.search(line)
    ]


def test_no_file_names_the_workplace() -> None:
    found = [
        line
        for path in files()
        if path.suffix in TEXT
        for line in strange_lines(path, (ROOT / path).read_text("utf-8", errors="replace"))
    ]
    assert not found, "\n".join(found)


def test_a_workplace_path_is_seen_and_sibling_data_is_left_to_tests() -> None:
    for line in ("see /wo" + "rk/main/a", "sha" + "red/design/a.md", "in .lib" + "rary/search"):
        assert strange_lines(Path("docs/a.md"), line)
    assert not strange_lines(Path("tests/a.py"), SIBLING_DATA)
    assert strange_lines(Path("labweb/a.py"), SIBLING_DATA)
    assert not strange_lines(Path("docs/a.md"), "a lib" + "rary that is sha" + "red, ~/network/a")
