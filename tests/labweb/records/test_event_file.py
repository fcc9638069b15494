"""A lab is made anew from a file of its events, in a database that never knew it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from io import StringIO
from pathlib import Path
from secrets import token_hex
from typing import Any

import psycopg
import pytest
from django.core.management import CommandError, call_command
from django.db import connection
from psycopg import sql

from labweb.accounts.models import User
from labweb.crutd.models import Event, ResourceLock
from labweb.crutd.selectors.event_chain import first_broken_event
from labweb.domain.runs.states import event_export_file
from labweb.resources.models import Lab, Resource
from labweb.runs.models import HostEvent, Job
from tests.builders import Bench, a_lab, a_started_run, an_edge, dispatched, to_transfer
from tests.labweb.crutd.hand import a_jar
from tests.labweb.crutd.test_rebuild import move
from tests.labweb.crutd.test_verify import tamper
from tests.labweb.records.test_ledger_rebuild import state
from tests.labweb.records.test_provenance import pour

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def bench(transactional_db: None) -> Bench:
    return a_lab()


def a_doubtful_history(bench: Bench) -> None:
    """Do a run, pour and carry by hand, and leave a doubt with its locks behind."""
    edge = an_edge(bench)
    edge.work_off(a_started_run(bench))
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    a_jar(bench, "jar")
    move(bench, "jar", "lab")
    edge.lose(to_transfer(a_started_run(bench), edge))


def exported(path: Path) -> list[bytes]:
    call_command("export_events", str(path), stdout=StringIO())
    return path.read_bytes().splitlines(keepends=True)


def emptied() -> None:
    """Leave the tables, and nothing in them."""
    call_command("flush", interactive=False, verbosity=0)
    assert not Lab.objects.exists()


def all_told(bench: Bench) -> dict[str, Any]:
    locks = ResourceLock.objects.filter(released_at=None).order_by("id")
    hosts = HostEvent.objects.order_by("id")
    return state(bench) | {
        "events": list(Event.objects.order_by("seq").values_list("seq", "at", "hash")),
        "locks": list(locks.values_list("resource_id", "mode", "transaction_id")),
        "hosts": list(hosts.values_list("journal_id", "seq", "hash")),
        "full jobs": list(Job.objects.order_by("id").values()),
    }


def test_a_lab_comes_back_whole_in_a_database_that_is_empty(bench: Bench, tmp_path: Path) -> None:
    a_doubtful_history(bench)
    before, file = all_told(bench), tmp_path / "events.jsonl"
    lines = exported(file)
    assert lines == exported(tmp_path / "again.jsonl")
    emptied()
    out = StringIO()
    call_command("rebuild", "--from", str(file), stdout=out, stderr=StringIO())
    assert out.getvalue() == f"{bench.lab.key}: equal\n"
    assert all_told(bench) == before
    assert first_broken_event(bench.lab) is None
    assert exported(tmp_path / "third.jsonl") == lines
    assert not User.objects.filter(is_active=True).exists()
    assert not any(user.has_usable_password() for user in User.objects.all())
    assert bench.host.__class__.objects.get().public_key == ""


def edited(lines: list[bytes], at: int) -> list[bytes]:
    return [*lines[:at], lines[at].replace(b'"n":', b'"n" :', 1), *lines[at + 1 :]]


def changed(lines: list[bytes], at: int) -> list[bytes]:
    plain = json.loads(lines[at])
    plain["body"] = {"changed": True}
    return [*lines[:at], json.dumps(plain).encode() + b"\n", *lines[at + 1 :]]


def dropped(lines: list[bytes], at: int) -> list[bytes]:
    return [*lines[:at], *lines[at + 1 :]]


def exchanged(lines: list[bytes], at: int) -> list[bytes]:
    return [*lines[:at], lines[at + 1], lines[at], *lines[at + 2 :]]


def truncated(lines: list[bytes], at: int) -> list[bytes]:
    return lines[:at]


def halved(lines: list[bytes], at: int) -> list[bytes]:
    return [*lines[:at], lines[at][: len(lines[at]) // 2]]


def doubled(lines: list[bytes], at: int) -> list[bytes]:
    return [*lines[:at], lines[at], *lines[at:]]


@pytest.fixture
def told(bench: Bench, tmp_path: Path) -> tuple[list[bytes], Path]:
    an_edge(bench).work_off(a_started_run(bench))
    lines = exported(tmp_path / "events.jsonl")
    emptied()
    return lines, tmp_path / "bad.jsonl"


def refusal(file: Path) -> str:
    """Try it, see that nothing was written, and return what is said."""
    with pytest.raises(CommandError) as refused:
        call_command("rebuild", "--from", str(file), stdout=StringIO(), stderr=StringIO())
    assert refused.value.returncode == 1
    rows = (Lab, User, Resource, Event, Job, HostEvent)
    assert not any(model._default_manager.exists() for model in rows)
    return str(refused.value)


def test_what_was_done_to_the_file_is_refused_by_the_first_bad_line(
    told: tuple[list[bytes], Path],
) -> None:
    lines, file = told
    last = len(lines) - 1
    harms: list[tuple[Callable[[list[bytes], int], list[bytes]], int, int]] = [
        (changed, 0, 0), (changed, 5, 5), (changed, last - 1, last - 1), (changed, last, last),
        (dropped, 0, 0), (dropped, 7, 7), (dropped, last - 1, last - 1), (dropped, last, last),
        (exchanged, 9, 9), (truncated, 0, 0), (truncated, 12, 12), (truncated, last, last),
        (halved, 11, 11), (halved, last, last), (doubled, 3, 4), (doubled, last, last + 1),
    ]  # fmt: skip
    for harm, at, first_bad in harms:
        file.write_bytes(b"".join(harm(lines, at)))
        said = refusal(file)
        assert said.startswith(f"event_file.line: line {first_bad + 1} "), (harm.__name__, said)
    file.write_bytes(b"".join(edited(lines, 4)))  # only a space: the same line
    call_command("rebuild", "--from", str(file), stdout=StringIO(), stderr=StringIO())
    assert Lab.objects.count() == 1


def rewritten(lines: list[bytes], kind: str, change: Callable[[Any], None]) -> tuple[bytes, int]:
    """Change the second line of a kind and bind all lines anew, as who means it would."""
    plain = [json.loads(line) for line in lines]
    at = [n for n, line in enumerate(plain) if line["kind"] == kind][1]
    change(plain[at]["body"])
    body = [(line["kind"], line["body"]) for line in plain[1:-1]]
    return b"".join(event_export_file.write(body)), at + 1


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("event", lambda body: body["body"].update(message="other")),
        ("event", lambda body: body.update(seq=9)),
        ("host_event", lambda body: body["body"].update(note="other")),
        ("host_event", lambda body: body.update(seq=9)),
        ("row", lambda body: body.update(model="auth.permission")),
        ("row", lambda body: body["fields"].update(password="!", is_superuser=True)),
    ],
)
def test_who_binds_the_lines_anew_still_breaks_a_chain_or_names_what_no_file_has(
    told: tuple[list[bytes], Path], kind: str, change: Callable[[Any], None]
) -> None:
    lines, file = told
    raw, first_bad = rewritten(lines, kind, change)
    file.write_bytes(raw)
    assert refusal(file).startswith(f"event_file.line: line {first_bad} ")


def test_a_job_that_says_other_than_its_host_follows_its_host(
    told: tuple[list[bytes], Path],
) -> None:
    lines, file = told
    plain = [json.loads(line) for line in lines[1:-1]]
    jobs = [line["body"] for line in plain if line["body"].get("model") == "runs.job"]
    jobs[0]["fields"]["state"] = "aborted"
    file.write_bytes(
        b"".join(event_export_file.write((line["kind"], line["body"]) for line in plain))
    )
    call_command("rebuild", "--from", str(file), stdout=StringIO(), stderr=StringIO())
    assert Job.objects.get(pk=jobs[0]["pk"]).state == "complete"


def test_a_database_that_holds_a_lab_is_left_as_it_is(bench: Bench, tmp_path: Path) -> None:
    exported(tmp_path / "events.jsonl")
    before = state(bench)
    with pytest.raises(CommandError, match=r"rebuild\.not_empty"):
        call_command("rebuild", "--from", str(tmp_path / "events.jsonl"), stderr=StringIO())
    assert state(bench) == before


def test_nothing_is_exported_of_a_broken_chain_or_while_something_is_under_way(
    bench: Bench, tmp_path: Path
) -> None:
    an_edge(bench)
    dispatched(a_started_run(bench))
    with pytest.raises(CommandError, match=r"rebuild\.under_way"):
        exported(tmp_path / "events.jsonl")
    tamper("UPDATE crutd_transaction SET state = 'committed'")
    tamper("UPDATE crutd_event SET body = jsonb_set(body, '{code}', '\"x\"') WHERE seq = 1")
    with pytest.raises(CommandError, match=r"rebuild\.chain"):
        exported(tmp_path / "events.jsonl")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_not_there_is_said(transactional_db: None, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="cannot read the file"):
        call_command("rebuild", "--from", str(tmp_path / "none.jsonl"))


@pytest.fixture
def other(transactional_db: None) -> Iterator[str]:
    """The address of a second, empty database on the same server."""
    name = f"labweb_{token_hex(6)}"
    connection.ensure_connection()
    info = connection.connection.info
    here = {"host": info.host, "user": info.user, "password": info.password, "port": info.port}
    with psycopg.connect(**here, dbname="postgres", autocommit=True) as server:
        server.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
        try:
            yield psycopg.conninfo.make_conninfo(**here, dbname=name)
        finally:
            server.execute(sql.SQL("DROP DATABASE {} WITH (FORCE)").format(sql.Identifier(name)))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_commands_bring_a_lab_to_a_second_database(
    bench: Bench, other: str, tmp_path: Path
) -> None:
    a_doubtful_history(bench)
    file = tmp_path / "events.jsonl"
    lines = exported(file)

    def manage(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "manage.py", *words],
            cwd=ROOT,
            env=os.environ | {"DATABASE_URL": other, "LABWEB_SECRET_KEY": token_hex()},
            capture_output=True,
            text=True,
            timeout=200,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    manage("migrate", "--verbosity", "0")
    manage("rebuild", "--from", str(file))
    assert json.loads(manage("rebuild", "--check", "--json"))["equal"]
    assert json.loads(manage("verify_ledger", "--json"))["holds"]
    assert json.loads(manage("verify_events", "--json"))["whole"]
    manage("export_events", str(tmp_path / "second.jsonl"))
    second = (tmp_path / "second.jsonl").read_bytes().splitlines(keepends=True)
    assert second == lines
