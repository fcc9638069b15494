"""Calibrations have moved between apps; their table has not."""

from __future__ import annotations

import pytest
from django.db import connection
from django.db.migrations.loader import MigrationLoader

from labweb.calibration.models import Calibration

pytestmark = pytest.mark.django_db


def test_the_move_out_of_runs_touches_no_table() -> None:
    loader = MigrationLoader(connection)
    moves = [("calibration", "0001_calibrations"), ("runs", "0023_calibrations_leave")]
    said = loader.collect_sql([(loader.graph.nodes[move], False) for move in moves])
    assert not [line for line in said if line and not line.startswith("--")]


def test_rows_are_where_they_were_before_the_move() -> None:
    assert Calibration._meta.db_table == "runs_calibration"
    with connection.cursor() as cursor:
        constraints = connection.introspection.get_constraints(cursor, "runs_calibration")
    wanted = {one.name for one in (*Calibration._meta.constraints, *Calibration._meta.indexes)}
    assert wanted <= constraints.keys()
