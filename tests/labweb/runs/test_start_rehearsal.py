"""A rehearsal goes the whole way of a click, and leaves nothing."""

from __future__ import annotations

import pytest
from django.db.models import Model

from labweb.accounts.models import AuditEntry
from labweb.crutd.models import ResourceLock, Transaction
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.runs import services
from labweb.runs.api.run_details import render_run
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.runs.services.execution import dispatch
from labweb.runs.services.planning import preview
from tests.builders import a_lab, an_edge

WRITTEN = (Run, Job, AuditEntry, Transaction, ResourceLock, Attempt, Outbox)


def _counts(*models: type[Model]) -> list[int]:
    return [model._default_manager.count() for model in models]


@pytest.mark.django_db(transaction=True)
def test_a_rehearsal_starts_a_run_as_a_click_does_and_takes_it_back() -> None:
    a_lab()
    before = _counts(Run, Job, AuditEntry)
    during: list[list[int]] = []
    rendered: list[object] = []
    assert services.rehearse_start(
        lambda run: rendered.append(render_run(run, run.created_by)),
        lambda _: during.append(_counts(Run, Job, AuditEntry)),
    )
    assert rendered
    assert all(now > then for now, then in zip(during[0], before, strict=True))
    assert _counts(Run, Job, AuditEntry) == before


@pytest.mark.django_db(transaction=True)
def test_a_rehearsal_writes_a_command_and_takes_it_back(monkeypatch: pytest.MonkeyPatch) -> None:
    an_edge(a_lab())
    signed: list[int] = []
    real = dispatch.signed

    def counted(row: Outbox, epoch: int) -> Signed:
        signed.append(Outbox.objects.filter(pk=row.pk).count())
        return real(row, epoch)

    monkeypatch.setattr(dispatch, "signed", counted)
    before = _counts(*WRITTEN)
    assert services.rehearse_dispatch()
    assert signed == [1]
    assert _counts(*WRITTEN) == before
    assert services.dispatch_ready() == services.publish_outbox() == 0


@pytest.mark.django_db(transaction=True)
def test_a_rehearsal_of_what_nobody_can_start_says_so_and_leaves_nothing() -> None:
    bench = a_lab()
    bench.lab.is_stopped = True
    bench.lab.save()
    before = _counts(*WRITTEN)
    assert not services.rehearse_start()
    assert not services.rehearse_dispatch()
    assert _counts(*WRITTEN) == before


@pytest.mark.django_db(transaction=True)
def test_a_rehearsal_that_meets_a_fault_of_our_own_says_so_and_ends(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    a_lab()
    before = _counts(*WRITTEN)

    def broken(*_: object, **__: object) -> None:
        raise KeyError("x")

    monkeypatch.setattr(preview, "compile_workflow", broken)
    assert not services.rehearse_dispatch()
    assert not services.rehearse_start()
    assert "is not rehearsed" in caplog.text
    assert _counts(*WRITTEN) == before
