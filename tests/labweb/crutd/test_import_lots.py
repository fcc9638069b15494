"""Lots come in from a table: all of them, once, or none."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from labweb.accounts.models import AuditEntry
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.resources.models import Lot, Resource
from tests.builders import Bench, a_user
from tests.labweb.crutd.hand import held, rows

HEAD = "lot,material,phase,vessel,amount,supplier,number,expires_on"


def table(folder: Path, *lines: str, head: str = HEAD) -> Path:
    path = folder / "lots.csv"
    path.write_text("\n".join([head, *lines]) + "\n", "utf-8")
    return path


def told(path: Path, *words: str, by: str = "chemist") -> dict[str, Any]:
    out = StringIO()
    call_command("import_lots", str(path), *words, by=by, json=True, stdout=out)
    answer: dict[str, Any] = json.loads(out.getvalue())
    return answer


def refused(path: Path, *words: str, by: str = "chemist") -> list[tuple[str, str]]:
    """Return (row, code) of each finding; nothing was written."""
    before, out = rows(), StringIO()
    with pytest.raises(CommandError) as caught:
        call_command("import_lots", str(path), *words, by=by, json=True, stdout=out)
    assert caught.value.returncode == 1
    assert rows() == before
    answer = json.loads(out.getvalue())
    assert answer["verdict"] == "refused"
    return [(found["subject"], found["code"]) for found in answer["findings"]]


def test_every_lot_of_a_table_is_received(bench: Bench, tmp_path: Path) -> None:
    path = table(
        tmp_path,
        "w7,water,liquid,flask_1,2.5 mL,Acme,17,2999-12-31",
        "w7,water,liquid,reactor_1,500 uL,Acme,17,2999-12-31",
        "w8,water,liquid,flask_1,1 mL,Acme,18,",
    )
    answer = told(path)
    assert answer["verdict"] == "received"
    assert [lot["key"] for lot in answer["lots"]] == ["w7", "w8"]
    assert held(bench, "flask_1") == {"w7": (2_500_000, 0), "w8": (1_000_000, 0)}
    assert held(bench, "reactor_1") == {"w7": (500_000, 0)}
    assert ledger_violations(bench.lab) == []
    assert rebuild_differences(bench.lab) == []
    audit = AuditEntry.objects.get(action="lots.import")
    assert audit.detail["lots_count"] == 2


def test_a_table_may_be_checked_alone(bench: Bench, tmp_path: Path) -> None:
    before = rows()
    assert (
        told(table(tmp_path, "w7,water,liquid,flask_1,1 mL,,,"), "--check")["verdict"] == "checked"
    )
    assert rows() == before


def test_a_lot_is_not_received_twice(bench: Bench, tmp_path: Path) -> None:
    path = table(tmp_path, "w7,water,liquid,flask_1,1 mL,Acme,17,")
    told(path)
    assert refused(path) == [("row 2", "crutd.lot_received_twice")]
    other_key = table(
        tmp_path,
        "w9,water,liquid,flask_1,1 mL,Acme,19,",
        "w8,water,liquid,flask_1,1 mL,Acme,17,",
    )
    assert refused(other_key) == [("row 3", "crutd.lot_received_twice")]


def test_every_row_that_is_wrong_is_named(bench: Bench, tmp_path: Path) -> None:
    path = table(
        tmp_path,
        "w1,water,liquid,flask_1,1 mL,,,",
        "w2,water,vapour,flask_1,1 mL,,,",
        "w3,water,liquid,flask_1,1 mg,,,",
        "w4,water,liquid,flask_1,0 mL,,,",
        "w5,water,liquid,flask_1,0.0000001 mL,,,",
        "w6,water,liquid,flask_1,nan mL,,,",
        "w7,water,liquid,flask_1,9e30 L,,,",
        "w8,water,liquid,flask_1,1 mL,,,31.12.2999",
        ",water,liquid,flask_1,1 mL,,,",
    )
    found = refused(path)
    assert [row for row, _ in found] == [f"row {row}" for row in range(3, 11)]
    assert {code for _, code in found} == {"lots.value", "lots.missing"}


def test_a_row_that_contradicts_another_is_named(bench: Bench, tmp_path: Path) -> None:
    path = table(
        tmp_path,
        "w1,water,liquid,flask_1,1 mL,Acme,1,",
        "w1,water,liquid,reactor_1,1 mL,Other,1,",
        "w1,water,liquid,flask_1,1 mL,Acme,1,",
    )
    assert refused(path) == [("row 3", "lots.contradiction"), ("row 4", "lots.contradiction")]


def test_what_the_lab_does_not_know_is_named(bench: Bench, tmp_path: Path) -> None:
    path = table(
        tmp_path,
        "w1,gold,liquid,flask_1,1 mL,,,",
        "w2,water,liquid,flask_9,1 mL,,,",
        "w3,water,liquid,balance_1,1 mL,,,",
    )
    assert refused(path) == [("row 2", "lots.no_material"), ("row 3", "lots.no_vessel")]
    path = table(
        tmp_path,
        "w1,water,liquid,flask_1,1 mL,,,2001-01-31",
        "w3,water,liquid,balance_1,1 mL,,,",
        "w4,water,liquid,flask_1,900 L,,,",
    )
    assert refused(path) == [
        ("row 2", "crutd.expired_lot"),
        ("row 3", "crutd.no_vessel"),
        ("row 4", "crutd.capacity_exceeded"),
    ]


@pytest.mark.parametrize(
    ("text", "subject", "code"),
    [
        ("lot,material,phase,vessel\nw,water,liquid,flask_1\n", "row 1", "lots.column"),
        (f"{HEAD},colour\nw,water,liquid,flask_1,1 mL,,,,red\n", "row 1", "lots.column"),
        (f"{HEAD}\nw,water\n", "row 2", "lots.invalid"),
        (f'{HEAD}\n"w\n', "row 2", "lots.invalid"),
        ("", "row 1", "lots.column"),
    ],
)
def test_a_table_of_the_wrong_shape_is_refused(
    bench: Bench, tmp_path: Path, text: str, subject: str, code: str
) -> None:
    path = tmp_path / "lots.csv"
    path.write_text(text, "utf-8")
    assert (subject, code) in refused(path)


def test_who_may_not_work_on_a_vessel_receives_nothing_into_it(
    bench: Bench, tmp_path: Path
) -> None:
    a_user("chemist", on=bench.node("balance_1"), name="guest")
    path = table(tmp_path, "w1,water,liquid,reactor_1,1 mL,,,")
    assert refused(path, by="guest") == [("", "governance.forbidden")]
    assert refused(path, by="observer") == [("", "governance.forbidden")]
    with pytest.raises(CommandError, match="no user"):
        call_command("import_lots", str(path), by="nobody")


def test_what_is_exported_is_read_back(bench: Bench, tmp_path: Path) -> None:
    told(table(tmp_path, 'w7,water,liquid,flask_1,2.5 mL,"Acme, Inc.",17,2999-12-31'))
    out = tmp_path / "out.csv"
    call_command("export_lots", out=out, stdout=StringIO())
    lines = out.read_text("utf-8").splitlines()
    assert lines[0] == "lot,material,phase,vessel,amount,supplier,number,purity,expires_on"
    line = 'w7,water,liquid,flask_1,2500000 nL,"Acme, Inc.",17,,2999-12-31'
    assert line in lines
    assert len(lines) == 1 + Lot.objects.count()
    again = tmp_path / "again.csv"
    renamed = line.replace("w7", "w9").replace("17", "19")
    again.write_text(f"{lines[0]}\n{renamed}\n", "utf-8")
    told(again)
    assert held(bench, "flask_1")["w9"] == (2_500_000, 0)
    assert Resource.objects.filter(key="flask_1").exists()
