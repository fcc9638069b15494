"""The guide for authors of drivers: what it tells to type is there, and does what it says."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from drivers.new.order import CARRIERS
from drivers.new.role import read_role
from drivers.transports.replay import parse_transcript
from fixtures.instruments.bench import parse_bench
from tests.architecture.project import ROOT
from tests.fixtures.running import until

GUIDE = ROOT / "docs" / "write-a-driver.md"
TEXT = GUIDE.read_text("utf-8")
FOLDER = "/tmp/loop"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def block(word: str) -> str:
    """Return the one block of commands that has the word."""
    (found,) = (one for one in blocks("sh") if word in one)
    return found


class Desk:
    """A terminal of the author, with the guide's folder elsewhere."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "bench.json").write_text(blocks("json")[0].replace(FOLDER, str(folder)))

    def words(self, text: str) -> list[str]:
        python = text.replace(".venv/bin/python", sys.executable)
        return ["bash", "-euc", python.replace(FOLDER, str(self.folder))]

    def type(self, text: str) -> str:
        done = subprocess.run(
            self.words(text), cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture
def desk() -> Iterator[Desk]:
    with TemporaryDirectory(prefix="lw") as name:
        desk = Desk(Path(name))
        command = "exec " + block("fixtures.instruments --bench")
        running = subprocess.Popen(
            desk.words(command), cwd=ROOT, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert running.stdout is not None
        assert json.loads(running.stdout.readline())["speed"] == 100
        yield desk
        running.terminate()
        running.communicate(timeout=10)


def test_the_guides_bench_plays_and_its_recording_is_a_transcript(desk: Desk) -> None:
    desk.type(block("drivers.record"))
    text = (desk.folder / "lauda_loop.txt").read_text()
    assert "# stop_control({}) returned" in text or "# stop_control() returned" in text
    sent = [exchange.request for exchange in parse_transcript(text)]
    assert sent[0] == b"TYPE\r\n"
    assert [b"START\r\n" in sent, b"STOP\r\n" in sent] == [True, True]


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on this machine")
def test_the_guides_look_inside_and_its_fault_work(desk: Desk) -> None:
    told = desk.type(block("curl"))
    assert '"model": "lauda_loop"' in told
    assert '"fault": "alarm"' in told
    until(lambda: '"fault": "alarm"' in desk.type(block("curl").splitlines()[0]))


def test_the_bench_of_the_guide_is_sound() -> None:
    (spec,) = parse_bench(json.loads(blocks("json")[0])).instruments
    assert spec.model == "lauda_loop"


def test_what_the_guide_says_of_beginning_is_so() -> None:
    (given,) = re.findall(r"^make driver (.*)$", TEXT, re.MULTILINE)
    words = dict(re.findall(r"([A-Z]+)='?([^'\n]+?)'?(?= [A-Z]+=|$)", given))
    role = read_role(words["ROLE"])
    assert words["TRANSPORT"] in CARRIERS
    assert (ROOT / "drivers" / role.folders[0] / f"{words['NAME']}.py").is_file()
    assert words["TITLE"] == "LAUDA LOOP 100"
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^make ([a-z]+)", "".join(blocks("sh")), re.MULTILINE):
        assert f"\n{target}: " in makefile


def test_every_file_that_the_guide_names_is_there() -> None:
    named = re.findall(r"\b(?:drivers|fixtures|tests)/[\w/]+(?:\.py|\.txt|/)", TEXT)
    assert len(set(named)) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []
    linked = re.findall(r"\]\(([\w.-]+\.md)\)", TEXT)
    assert [name for name in linked if not (GUIDE.parent / name).is_file()] == []


def test_the_readme_leads_to_the_guide() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "(docs/write-a-driver.md)" in readme
    assert "(docs/driver_versions.md)" in readme


def test_the_catalog_and_the_help_answer_as_the_guide_says(desk: Desk) -> None:
    assert desk.type(block("lauda_loop.py --check")) == ""
    assert "acme_pump" in desk.type(".venv/bin/python -m drivers.new --help")
