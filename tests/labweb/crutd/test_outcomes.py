"""What a host reports at the end of a transfer, and what the record says then."""

from __future__ import annotations

from uuid import UUID

import msgspec

from labweb.crutd.models import Entry, ResourceLock, Ticket, Transaction
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.crutd.pre_and_postconditions import Condition, evaluate
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.runs.host_journal.action_states import ActionReport, conclude
from labweb.resources.models import Resource
from labweb.runs.models import Attempt, Job
from tests.builders import Bench, a_started_run, an_edge, to_transfer

BALANCE = UUID(int=3)


def moved_nl(attempt: Attempt) -> int:
    posted = Entry.objects.filter(transaction=attempt.transaction_id, state="posted")
    return sum(posted.values_list("amount_nl", flat=True))


def promised(attempt: Attempt) -> int:
    rows = Entry.objects.filter(transaction=attempt.transaction_id)
    signs = {"pending": 1, "void": -1, "posted": 0}
    return sum(signs[row.state] * row.amount_nl for row in rows)


def test_a_transfer_of_which_the_edge_says_half_was_moved_posts_that_half(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    half = attempt.job.operation["amount_nl"] // 2
    edge.begin(attempt)
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.PARTIAL, moved_nl=half))
    edge.report("aborted", attempt.id, **body, code="device.stopped", message="stopped half way")
    row = Transaction.objects.get(pk=attempt.transaction_id)
    assert (row.state, row.code) == ("committed", "device.stopped")
    assert Job.objects.get(pk=attempt.job_id).state == "aborted"
    assert (moved_nl(attempt), promised(attempt)) == (half, 0)
    assert not ResourceLock.objects.filter(transaction=row, released_at=None).exists()
    assert not Resource.objects.filter(quarantined_by__isnull=False).exists()
    assert not Ticket.objects.exists()
    assert ledger_violations(bench.lab) == rebuild_differences(bench.lab) == []


def test_a_transfer_with_which_a_sensor_disagrees_is_in_doubt_and_posts_nothing(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    asked = attempt.job.operation["amount_nl"]
    weighed = Condition(
        name="balance.gained", device_id=BALANCE, status="mass_mg", change=5_000, tolerance=50,
        is_sensor=True,
    )  # fmt: skip
    key = (BALANCE, "mass_mg")
    result = evaluate(weighed, {key: 102_400.0}, {key: 100_000.0})
    conclusion = conclude(ActionReport(ok=True, moved_nl=asked), [(weighed, result)])
    edge.act(attempt)
    body = edge.settled(attempt, conclusion.outcome) | {"post": [msgspec.to_builtins(result)]}
    body |= {"verification": conclusion.verification.value, "code": conclusion.code}
    edge.report(conclusion.state.value, attempt.id, **body, message=conclusion.message)
    row = Transaction.objects.get(pk=attempt.transaction_id)
    assert (row.state, row.code, row.verification) == ("quarantined", "balance.gained", "assumed")
    assert row.conditions[-1]["evidence"] == {
        "status": "mass_mg",
        "value": 102_400.0,
        "wanted": "a change of 5000 ± 50",
        "before": 100_000.0,
    }
    assert (moved_nl(attempt), promised(attempt)) == (0, asked)
    assert ResourceLock.objects.filter(transaction=row, released_at=None).exists()
    assert Resource.objects.filter(quarantined_by=row.id).count() == 2
    assert ledger_violations(bench.lab) == rebuild_differences(bench.lab) == []


def test_a_transfer_of_more_than_there_was_or_fits_is_in_doubt(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.act(attempt)
    unknown = edge.settled(attempt, Outcome(kind=OutcomeKind.UNKNOWN))
    outcome = {"kind": "done", "moved_nl": 10**12, "data": {}}
    edge.report("in_doubt", attempt.id, **unknown | {"outcome": outcome})
    row = Transaction.objects.get(pk=attempt.transaction_id)
    assert row.state == "quarantined"
    assert Ticket.objects.get().code == "crutd.contradiction"
    assert moved_nl(attempt) == 0
    assert ledger_violations(bench.lab) == rebuild_differences(bench.lab) == []
