"""A lab whose rows were put into the database is the lab that the services wrote."""

from __future__ import annotations

import pytest
from django.db import DatabaseError, connection
from django.db.transaction import atomic, set_rollback

from labweb.accounts.selectors import User
from labweb.workflows.models import WorkflowVersion
from tests import again
from tests.again import contents
from tests.builders import a_lab, a_started_run, an_edge


@pytest.fixture(autouse=True)
def nothing_built(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(again, "_rows", {})


def built() -> dict[str, str]:
    """Return the rows of a lab, and leave the database as it was."""
    with atomic():
        a_lab()
        found = contents()
        set_rollback(True)
    return found


def test_every_row_is_there_again(db: None) -> None:
    assert not contents()
    first = built()
    assert len(first) > 15
    assert built() == first, "from its rows"
    assert len(again._rows) == 1


def test_a_lab_is_built_anew_where_there_is_anything(db: None) -> None:
    first = built()
    User.objects.create(username="guest")
    a_lab()
    versions = "workflows_workflowversion"
    assert first.keys() == contents().keys()
    assert first[versions] != contents()[versions]
    assert User.objects.filter(username="guest").exists()


def test_triggers_look_at_what_comes_after_it(db: None) -> None:
    built()
    a_lab()
    with pytest.raises(DatabaseError, match="append"), atomic():
        WorkflowVersion.objects.update(number=2)


def test_a_run_is_worked_off_in_it(db: None) -> None:
    built()
    bench = a_lab()
    edge = an_edge(bench)
    run = a_started_run(bench)
    edge.work_off(run)
    run.refresh_from_db()
    assert run.state == "complete"


def test_rows_after_it_have_numbers_of_their_own_even_where_numbers_begin_anew(db: None) -> None:
    built()
    with connection.cursor() as cursor:
        cursor.execute("ALTER SEQUENCE accounts_auditentry_id_seq RESTART")
    run = a_started_run(a_lab())
    assert run.jobs.exists()
