"""The role of the lab's processes appends to the record, and rewrites nothing of it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from django.core.management import CommandError, call_command
from django.db import ProgrammingError, connection, transaction

from labweb.accounts.models import AuditEntry
from labweb.runs.models import Run
from tests.builders import Bench, a_started_run, an_edge
from tests.labweb.accounts.test_signed_heads import GUARDED

ROLE = "labweb_test_role"


@pytest.fixture
def restricted(bench: Bench) -> Iterator[Bench]:
    """A lab in which work was done, seen with the rights of the lab's processes."""
    an_edge(bench).work_off(a_started_run(bench))
    call_command("grant_database", ROLE)
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute(f"SET ROLE {ROLE}")
        yield bench
        cursor.execute("RESET ROLE")


def refused(statement: str) -> bool:
    try:
        with transaction.atomic(), connection.cursor() as cursor:
            cursor.execute(statement)
    except ProgrammingError as error:
        return "permission denied" in str(error) or "must be owner" in str(error)
    return False


APPENDED = sorted(set(GUARDED) - {"crutd_eventhead"})


@pytest.mark.parametrize("table", APPENDED)
def test_what_is_appended_cannot_be_edited_deleted_or_emptied(
    restricted: Bench, table: str
) -> None:
    assert refused(
        f"UPDATE {table} SET id = id"
        if table != "crutd_labbase"
        else f"UPDATE {table} SET sha256 = ''"
    )
    assert refused(f"DELETE FROM {table}")
    assert refused(f"TRUNCATE {table} CASCADE")


@pytest.mark.parametrize(
    "statement",
    [
        "SET session_replication_role = replica",
        "ALTER TABLE crutd_event DISABLE TRIGGER ALL",
        "DROP TABLE crutd_event CASCADE",
        "CREATE TABLE mine (id int)",
        "COPY crutd_event TO PROGRAM 'true'",
        "DELETE FROM django_migrations",
    ],
)
def test_no_rule_of_the_database_can_be_turned_off(restricted: Bench, statement: str) -> None:
    assert refused(statement)


def test_a_lab_works_with_that_role(restricted: Bench) -> None:
    before = AuditEntry.objects.count()
    run = a_started_run(restricted)
    assert Run.objects.get(pk=run.pk).state == "queued"
    assert AuditEntry.objects.count() > before


def test_the_owner_of_the_tables_cannot_be_restricted(db: None) -> None:
    with connection.cursor() as cursor:
        cursor.execute("SELECT current_user")
        (owner,) = cursor.fetchone()
    with pytest.raises(CommandError, match="owns the tables"):
        call_command("grant_database", owner)
