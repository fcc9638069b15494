"""`convert_graph` writes a graph in another format, or says what is lost; it asks no database."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.recipes.graph_formats.convert_graph import Target
from tests.architecture.project import ROOT
from tests.domain.recipes.test_opening import ROW, STARTER


def convert(tmp_path: Path, raw: bytes, *options: str) -> bytes:
    source, target = tmp_path / "in.json", tmp_path / "out"
    source.write_bytes(raw)
    call_command("convert_graph", str(source), str(target), *options)
    return target.read_bytes()


def test_what_loses_nothing_is_written(tmp_path: Path) -> None:
    text = convert(tmp_path, gzip.compress(ROW), "--to", "chemputer-graphml")
    assert text.startswith(b"<?xml")


def test_what_loses_something_is_written_only_when_that_is_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(CommandError, match="nothing is written") as refused:
        convert(tmp_path, ROW, "--to", "labweb", "--json")
    assert refused.value.returncode == 2
    assert not (tmp_path / "out").exists()
    told = json.loads(capsys.readouterr().out)
    assert not told["ok"]
    assert {one["code"] for one in told["findings"]} == {"graph.not_held"}
    with pytest.raises(CommandError, match="is written") as lossy:
        convert(tmp_path, ROW, "--to", "labweb", "--lossy", "--name", "My row")
    assert lossy.value.returncode == 2
    assert read_lab((tmp_path / "out").read_bytes()).name == "My row"
    assert "graph.not_held" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("raw", "code"), [(b"{}", "lab_file.no_nodes"), (b"\x1f\x8bxx", "lab_file.gzip")]
)
def test_what_is_no_graph_is_refused_with_its_findings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], raw: bytes, code: str
) -> None:
    with pytest.raises(CommandError) as refused:
        convert(tmp_path, raw, "--to", "labweb")
    assert refused.value.returncode == 2
    assert code in capsys.readouterr().err


def test_a_file_that_is_there_or_is_not_is_an_error_of_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(CommandError, match="cannot read") as missing:
        call_command("convert_graph", str(tmp_path / "none"), str(out), "--to", "labweb")
    assert missing.value.returncode == 1
    out.write_text("mine")
    with pytest.raises(CommandError, match="is there already"):
        convert(tmp_path, STARTER, "--to", "labweb")
    assert out.read_text() == "mine"


def test_it_runs_where_no_database_is_and_says_its_formats(tmp_path: Path) -> None:
    (tmp_path / "in.json").write_bytes(ROW)
    nowhere = {"DATABASE_URL": "postgres://nobody@127.0.0.1:1/none", "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "manage.py", "convert_graph"]
    files = [str(tmp_path / "in.json"), str(tmp_path / "out"), "--to", "chemputer-yed"]
    for rest, wanted in ((["--help"], [one.value for one in Target]), (files, ["chemputer-yed"])):
        done = subprocess.run(
            [*program, *rest],
            cwd=ROOT,
            env=os.environ | nowhere,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert all(text in done.stdout for text in wanted)
    assert b"NodeLabel" in (tmp_path / "out").read_bytes()
