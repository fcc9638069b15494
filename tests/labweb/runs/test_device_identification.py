"""A device shows its name, so that a person sees which one on the bench it is."""

from __future__ import annotations

import json

import pytest

from labweb.domain.errors import ForbiddenError, StateError
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment.models import Device
from labweb.resources.models import Lot
from labweb.runs import services
from labweb.runs.models import Run
from tests.builders import Bench
from tests.labweb.runs.hosts import Host
from tests.labweb.web import call, read, signed_in


def test_a_balance_shows_its_name_in_a_run_of_one_job_and_nothing_moves(bench: Bench) -> None:
    device = bench.device("balance_1")
    client = signed_in(bench.people["chemist"])
    assert read(client, f"/api/v1/devices/{device.id}")["shows_itself"] is True
    answer = call(client, "POST", f"/api/v1/devices/{device.id}/show", {})
    assert answer.status_code == 201
    (job,) = Run.objects.get(pk=json.loads(answer.content)["run_id"]).jobs.all()
    assert (job.action, job.args) == ("show_itself", {"text": device.name[:20], "shown_s": 20.0})
    assert job.operation["op"] == "read"
    host = Host(bench)
    assert services.dispatch_ready() == 1
    host.take()
    assert host.step(report=ActionReport(ok=True, evidence={"text": device.name}))
    host.tell()
    job.refresh_from_db()
    assert job.state == "complete"
    assert [event.kind for event in host.disk.events if event.kind == "started"], "journaled"
    assert Lot.objects.count() == len(bench.file.lots)


def test_what_was_withheld_is_not_shown(bench: Bench) -> None:
    device = bench.device("balance_1")
    Device.objects.filter(pk=device.pk).update(admission={"weigh": {}})
    with pytest.raises(StateError) as refusal:
        services.show_device(device.id, actor=bench.people["chemist"])
    assert refusal.value.code == "device.shows_nothing"
    with pytest.raises(StateError):
        services.show_device(bench.device("pump_1").id, actor=bench.people["chemist"])
    with pytest.raises(ForbiddenError):
        services.show_device(device.id, actor=bench.people["observer"])
    assert not Run.objects.exists()


def test_the_review_admits_a_device_only_to_show_itself(bench: Bench) -> None:
    device = bench.device("balance_1")
    Device.objects.filter(pk=device.pk).update(state="candidate")
    admin = signed_in(bench.people["admin"])
    url = f"/admin/enrollment/device/{device.id}/review/"
    assert 'value="show_only"' in admin.get(url).content.decode()
    reason = "which of the two is it"
    admin.post(url, {"act": "show_only", "reason": reason, "seen": device.driver.digest})
    found = bench.device("balance_1")
    assert (found.state, found.admission) == ("enrolled", {"show_itself": {}})
    page = admin.get(url).content.decode()
    assert f'href="/devices/{device.id}"' in page
    assert "for no more" in page
    services.show_device(device.id, actor=bench.people["chemist"])
    other = bench.device("heater_1")
    Device.objects.filter(pk=other.pk).update(state="candidate")
    text = admin.get(f"/admin/enrollment/device/{other.id}/review/").content.decode()
    assert 'value="show_only"' not in text, "its driver shows nothing"
