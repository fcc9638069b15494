"""What hosts have told cannot be changed in the database unseen."""

from __future__ import annotations

import json
from io import StringIO

import pytest
from django.core.management import CommandError, call_command

from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.runs import services
from labweb.runs.models import HostEvent
from tests.builders import Bench
from tests.labweb.accounts.test_signed_heads import keys_to_the_database
from tests.labweb.runs.hosts import Host, a_heating_run


@pytest.fixture
def told(bench: Bench) -> Bench:
    """Have a host tell of two actions."""
    host = Host(bench)
    a_heating_run(bench)
    for _ in range(2):
        services.dispatch_ready()
        host.take()
        host.end(host.begin(), ActionReport(ok=True))
        host.tell()
    return bench


def verified() -> tuple[int, str]:
    out = StringIO()
    try:
        call_command("verify_host_events", "--json", stdout=out)
    except CommandError as error:
        return error.returncode, out.getvalue()
    return 0, out.getvalue()


def code() -> str:
    status, text = verified()
    (found,) = json.loads(text)["chains"].values()
    assert status == (0 if found is None else 1)
    return "" if found is None else str(found["code"])


def test_what_a_host_has_told_is_whole(told: Bench) -> None:
    assert HostEvent.objects.count() > 6
    assert code() == ""


@pytest.mark.parametrize(
    "change", [{"body": {"x": 1}}, {"kind": "aborted"}, {"at_s": 1.0}, {"action_id": None}]
)
def test_an_edited_event_is_named(told: Bench, change: dict[str, object]) -> None:
    row = HostEvent.objects.order_by("seq")[3]
    with keys_to_the_database():
        HostEvent.objects.filter(pk=row.pk).update(**change)
    assert code() == "host_events.edited"
    assert f"event {row.seq} of" in verified()[1]


def test_a_removed_event_is_named(told: Bench) -> None:
    with keys_to_the_database():
        HostEvent.objects.filter(pk=HostEvent.objects.order_by("seq")[3].pk).delete()
    assert code() == "host_events.missing"


def test_a_lost_end_is_named(told: Bench) -> None:
    with keys_to_the_database():
        HostEvent.objects.filter(pk=HostEvent.objects.order_by("-seq")[0].pk).delete()
    assert code() == "host_events.truncated"
