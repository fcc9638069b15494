"""Prepared queries return what Django's own do, whatever is in the rows."""

from __future__ import annotations

from contextlib import nullcontext
from uuid import UUID

import pytest
from django.core.exceptions import ObjectDoesNotExist
from django.db import DataError, IntegrityError, connection
from django.db.models import F, UUIDField
from django.db.transaction import TransactionManagementError, atomic
from django.test.utils import CaptureQueriesContext

from labweb.accounts.models import AuditEntry
from labweb.common.clock import new_id, now
from labweb.common.database.prepared_queries import (
    Given,
    IsAnyOf,
    Prepared,
    Question,
    Written,
    insert_rows,
    inserting,
    prepared_cursor,
    together,
    update_row,
    updating,
)
from labweb.enrollment.models import Device
from labweb.resources.models import Resource
from labweb.runs.models import Job
from labweb.runs.selectors import job_for_update
from tests.builders import MOVE_WATER, Bench, a_started_run

_BY_ID = Prepared(lambda: Resource.objects.filter(pk=Given("id", UUIDField())))


def _columns(row: object) -> dict[str, object]:
    return {key: value for key, value in vars(row).items() if key != "_state"}


def test_an_object_is_the_same_as_djangos(bench: Bench) -> None:
    water = bench.node("water")
    found = _BY_ID.first(id=water.pk)
    assert found is not None
    assert _columns(found) == _columns(Resource.objects.get(pk=water.pk))
    assert isinstance(found.config, dict)
    assert isinstance(found.pk, UUID)
    assert not found._state.adding


def test_it_runs_again_with_other_values(bench: Bench) -> None:
    for key in ("water", "waste", "water"):
        found = _BY_ID.first(id=bench.node(key).pk)
        assert found is not None
        assert found.key == key
    assert _BY_ID.first(id=new_id()) is None


def test_related_rows_come_along_and_deferred_columns_stay_away(bench: Bench) -> None:
    run = a_started_run(bench, MOVE_WATER)
    job_id = run.jobs.get(index=0).pk
    with atomic():
        job = job_for_update(job_id)
        with CaptureQueriesContext(connection) as queries:
            told = (job.run.lab.key, job.device.host.key, job.device.driver.digest)
        assert not queries.captured_queries
        wanted = Job.objects.select_related("run__lab", "device__host", "device__driver")
        other = wanted.get(pk=job_id)
        assert told == (other.run.lab.key, other.device.host.key, other.device.driver.digest)
        assert "spec" in job.device.driver.get_deferred_fields()


def test_a_missing_relation_is_none(bench: Bench) -> None:
    query = Prepared(
        lambda: Device.objects.filter(pk=Given("id", UUIDField())).select_related("next_driver")
    )
    device = Device.objects.filter(next_driver=None, lab=bench.lab).first()
    assert device is not None
    found = query.first(id=device.pk)
    assert found is not None
    assert found.next_driver is None


def test_values_come_as_tuples_with_json_read(bench: Bench) -> None:
    query = Prepared(
        lambda: Resource.objects.filter(pk=Given("id", UUIDField())).values_list("key", "config")
    )
    water = bench.node("water")
    assert query.rows(id=water.pk) == [("water", water.config)]


def test_one_of_an_array(bench: Bench) -> None:
    query = Prepared(
        lambda: Resource.objects.filter(IsAnyOf(F("id"), Given("ids", UUIDField()))).order_by("key")
    )
    ids = [bench.node("water").pk, bench.node("waste").pk]
    assert [row.key for row in query.rows(ids=ids)] == ["waste", "water"]
    assert query.rows(ids=[]) == []


def test_a_value_that_is_not_given_is_asked_for() -> None:
    with pytest.raises(KeyError, match="id"):
        _BY_ID.rows()


@pytest.mark.django_db(transaction=True)
def test_rows_are_locked_only_within_a_transaction() -> None:
    query = Prepared(
        lambda: Resource.objects.filter(pk=Given("id", UUIDField())).select_for_update()
    )
    with atomic():
        assert query.rows(id=new_id()) == []
    with pytest.raises(TransactionManagementError):
        query.rows(id=new_id())


def test_a_written_statement_returns_objects_and_what_stands_beside_them(bench: Bench) -> None:
    query = Written(
        Resource, "SELECT {columns}, position + 1 FROM resources_resource WHERE key = ANY(%s)"
    )
    ((row, (following,)),) = query.rows([["water"]])
    assert _columns(row) == _columns(bench.node("water"))
    assert following == row.position + 1


def test_new_rows_are_written_as_django_writes_them(bench: Bench) -> None:
    like = bench.node("water")
    first, second = (
        Resource(
            lab=bench.lab,
            parent_id=like.parent_id,
            key=key,
            name="ü \\ '",
            kind="vial",
            nature=like.nature,
            config={"a": [1, None, "'; --"]},
            pose=None,
        )
        for key in ("new one", "new two")
    )
    insert_rows([first, second])
    insert_rows([])
    for made in (first, second):
        found = Resource.objects.get(pk=made.pk)
        assert (found.name, found.config, found.pose) == (made.name, made.config, None)
    entry = AuditEntry(at=now(), action="a", subject="s", prev_hash="", hash="0" * 64)
    insert_rows([entry])
    assert AuditEntry.objects.get(hash="0" * 64).pk == entry.pk


def test_a_row_that_breaks_a_rule_is_refused(bench: Bench) -> None:
    like = bench.node("water")
    twin = Resource(lab=bench.lab, key=like.key, name="x", kind="vial", nature=like.nature)
    with pytest.raises(IntegrityError), atomic():
        insert_rows([twin])


def test_named_fields_of_a_row_are_written_and_no_other(bench: Bench) -> None:
    water = bench.node("water")
    water.name, water.kind, water.data = "Tap", "other", {"ph": 7.0}
    update_row(water, "name", "data")
    found = Resource.objects.get(pk=water.pk)
    assert (found.name, found.data) == ("Tap", {"ph": 7.0})
    assert found.kind != "other"
    with pytest.raises(ObjectDoesNotExist):
        update_row(Resource(name="nobody"), "name")


def test_the_database_plans_a_statement_once_for_a_connection(bench: Bench) -> None:
    for _ in range(3):
        _BY_ID.first(id=bench.node("water").pk)
    with prepared_cursor() as cursor:
        cursor.execute(
            "SELECT generic_plans + custom_plans FROM pg_prepared_statements"
            ' WHERE statement LIKE \'SELECT "resources_resource"."id"%"id" = ($1)%\''
        )
        counts = [count for (count,) in cursor.fetchall()]
    assert max(counts) >= 3


@pytest.mark.parametrize("is_logged", [False, True])
def test_questions_are_answered_in_order_and_each_by_itself(
    bench: Bench, *, is_logged: bool
) -> None:
    keys = ("water", "waste", "pump_1")
    asked = [_BY_ID.asking(id=bench.node(key).pk) for key in keys]
    with CaptureQueriesContext(connection) if is_logged else nullcontext():
        found = together(*asked, _BY_ID.asking(id=new_id()))
    assert [[row.key for row in rows] for rows in found] == [["water"], ["waste"], ["pump_1"], []]


def _vial(bench: Bench, key: str) -> Resource:
    like = bench.node("water")
    return Resource(
        lab=bench.lab,
        parent_id=like.parent_id,
        key=key,
        name=key,
        kind="vial",
        nature=like.nature,
    )


@pytest.mark.parametrize("is_logged", [False, True])
def test_writes_are_asked_with_reads_and_seen_by_those_after_them(
    bench: Bench, *, is_logged: bool
) -> None:
    water = bench.node("water")
    made = [_vial(bench, "new one"), _vial(bench, "new two")]
    water.name = "Tap"
    with CaptureQueriesContext(connection) if is_logged else nullcontext(), atomic():
        written, told, found, one = together(
            inserting(made),
            updating(water, "name"),
            _BY_ID.asking(id=water.pk),
            _BY_ID.asking(id=made[1].pk),
        )
    assert (written, len(told)) == ([], 1)
    assert [row.name for row in (*found, *one)] == ["Tap", "new two"]
    assert Resource.objects.filter(pk__in=[row.pk for row in made]).count() == len(made)


def test_a_row_that_is_gone_undoes_what_was_written_with_it(bench: Bench) -> None:
    made = _vial(bench, "new")
    with pytest.raises(ObjectDoesNotExist), atomic():
        together(inserting([made]), updating(Resource(name="nobody"), "name"))
    assert not Resource.objects.filter(pk=made.pk).exists()


def test_a_write_that_breaks_a_rule_undoes_those_before_it(bench: Bench) -> None:
    water = bench.node("water")
    made, twin = _vial(bench, "new"), _vial(bench, water.key)
    with pytest.raises(IntegrityError), atomic():
        together(inserting([made]), inserting([twin]), _BY_ID.asking(id=water.pk))
    assert not Resource.objects.filter(pk=made.pk).exists()


def test_a_question_that_fails_fails_them_all_and_the_block_around_it(bench: Bench) -> None:
    good = _BY_ID.asking(id=bench.node("water").pk)
    with pytest.raises(DataError), atomic():
        together(good, Question("SELECT 1 / (%s::int)", [0], tuple), good)
    assert together(good, good)[1][0].key == "water"
