"""Who locks a row lets others refer to it, so that two never wait for each other."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from django.db import connection
from django.db.transaction import atomic

from labweb.accounts.models import AuditEntry
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import JoinToken
from labweb.runs import services as run_services
from tests.builders import Bench, a_lab

WITHIN_S = 20.0

_WAITING = """
SELECT count(*) FROM pg_locks JOIN pg_database d ON d.oid = database
WHERE locktype = 'advisory' AND NOT granted AND d.datname = current_database()
"""


@pytest.mark.django_db(transaction=True)
def test_a_stop_and_a_token_made_at_the_same_moment_both_come_through() -> None:
    """
    ```text
    token: refers to the lab ── has the audit trail ─────────────── commits: is the lab there?
    stop:                       has the lab's row ── waits for the audit trail
    ```
    """
    bench, is_made = a_lab(), threading.Event()
    with ThreadPoolExecutor(1) as pool:
        token = pool.submit(_make_token, bench, is_made)
        assert is_made.wait(WITHIN_S)
        lab = run_services.stop_lab(actor=bench.people["admin"])
        token.result(WITHIN_S)
    assert lab.is_stopped
    assert JoinToken.objects.filter(lab=bench.lab).count() == 1
    written = AuditEntry.objects.order_by("id").values_list("action", flat=True)
    assert list(written)[-2:] == ["host.token_made", "lab.stop"]


def _make_token(bench: Bench, is_made: threading.Event) -> None:
    """Make a token, and commit once the other waits for the audit trail."""
    try:
        with atomic():
            enrollment_services.make_token(bench.lab, actor=bench.people["admin"])
            is_made.set()
            _wait_for_the_other()
    finally:
        is_made.set()
        connection.close()


def _wait_for_the_other() -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline_s:
        with connection.cursor() as cursor:
            cursor.execute(_WAITING)
            if cursor.fetchone() != (0,):
                return
        time.sleep(0.01)
    raise AssertionError("nobody waits for the audit trail")
