"""The five steps of the review: photo, what changed, guards, places, tryouts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.test import Client
from pytest_django import Settings

from labweb.common.signatures import authority
from labweb.enrollment import services
from labweb.enrollment.models import Candidate, Device
from labweb.telemetry import selectors as telemetry_selectors
from tests.builders import Bench, an_edge
from tests.labweb.approvals.test_tryouts import REACH, a_simulating_edge, ask, begun, tell
from tests.labweb.enrollment.driver_texts import approved, timer
from tests.labweb.enrollment.test_discovery import seen, taken_up
from tests.labweb.photos import a_photo
from tests.labweb.web import signed_in


@pytest.fixture(autouse=True)
def _own_folder(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


@pytest.fixture
def admin(bench: Bench) -> Client:
    return signed_in(bench.people["admin"])


def url_of(device: Device) -> str:
    return f"/admin/enrollment/device/{device.pk}/review/"


def page_of(client: Client, device: Device) -> str:
    answer = client.get(url_of(device))
    assert answer.status_code == 200
    return " ".join(answer.content.decode().split())


def test_the_five_steps_are_there(bench: Bench, admin: Client) -> None:
    device = bench.device("pump_1")
    page = page_of(admin, device)
    for step in (
        "1. Is it the one in front of you?",
        "2. Compare the code",
        "3. What it may do",
        "4. Where it belongs",
        "5. Prove it",
    ):
        assert step in page
    assert "no code was compared" in page
    assert "pose unknown until measured" in page or "mm in what carries it" in page
    assert " → " in page, "its tubes"


def test_a_photo_is_kept_and_shown_in_the_review(bench: Bench, admin: Client) -> None:
    device = bench.device("pump_1")
    assert "No photo" in page_of(admin, device)
    body = {"act": "photo", "photo": SimpleUploadedFile("p.jpg", a_photo())}
    assert admin.post(url_of(device), body).status_code == 302
    kept = telemetry_selectors.newest_photo(device)
    assert kept is not None
    page = page_of(admin, device)
    assert f'<img src="/api/v1/devices/{device.pk}/photo?of={kept.file.sha256[:12]}"' in page
    assert "No photo" not in page


@pytest.mark.parametrize("data", [None, b"<svg onload=alert(1)>"])
def test_what_is_no_photo_is_refused_in_words(
    bench: Bench, admin: Client, data: bytes | None
) -> None:
    device = bench.device("pump_1")
    body: dict[str, object] = {"act": "photo"}
    if data is not None:
        body["photo"] = SimpleUploadedFile("p.jpg", data, "image/jpeg")
    answer = admin.post(url_of(device), body)
    assert answer.status_code == 422
    wanted_text = "choose a photo first" if data is None else "no photo that can be read"
    assert wanted_text in answer.content.decode()
    assert telemetry_selectors.newest_photo(device) is None


def test_a_form_without_end_is_broken_off(bench: Bench, admin: Client) -> None:
    device = bench.device("pump_1")
    large = SimpleUploadedFile("p.jpg", b"\xff" * (16 * 2**20 + 1))
    answer = admin.post(url_of(device), {"act": "photo", "photo": large})
    assert answer.status_code == 422
    assert "a file may have 16777216 bytes" in answer.content.decode()


def test_the_review_says_what_guards_an_action_and_what_is_missing(
    bench: Bench, admin: Client
) -> None:
    page = page_of(admin, bench.device("pump_1"))
    assert "its host reads is_initialized, port_index and volume_ul" in page
    heater = page_of(admin, bench.device("heater_1"))
    assert "then its host reads temperature_c" in heater
    assert "No reading stops an action that goes on" in heater
    spec = bench.device("heater_1").driver.spec
    heat = next(one for one in spec["actions"] if one["name"] == "heat_to")
    assert f"halted after {heat['timeout_s'] * 1.5 + 5:g} s" in heater


def test_a_device_that_has_not_changed_says_so(bench: Bench, admin: Client) -> None:
    people = bench.people["admin"]
    device = bench.device("pump_1")
    Device.objects.filter(pk=device.pk).update(state="candidate")
    assert "What has changed" not in page_of(admin, device), "nobody has admitted it before"
    services.admit_device(device.pk, actor=people, reason="label read")
    assert "What has changed" not in page_of(admin, device), "it is in service"
    services.suspend_device(device.pk, actor=people, reason="moved")
    page = page_of(admin, device)
    assert "What has changed since it was admitted" in page
    assert "Nothing: key, serial number" in page


def test_a_returning_device_shows_its_new_key_serial_driver_and_settings(
    bench: Bench, admin: Client
) -> None:
    edge, people = an_edge(bench), bench.people["admin"]
    device = taken_up(bench, seen(bench, edge))
    services.admit_device(device.id, actor=people, reason="ok")
    rival = seen(bench, edge, address="tcp://192.0.2.66:5000")
    again = taken_up(bench, rival)
    assert again.pk == device.pk
    Candidate.objects.filter(pk=rival.pk).update(serial="0816")
    Device.objects.filter(pk=device.pk).update(config={**device.config, "probe": 2})
    page = page_of(admin, bench.device("plate_2"))
    assert "typed or scanned the code that it shows" in page
    assert '<th scope="row">Key</th>' in page
    assert "<td>0815</td><td><strong>0816</strong></td>" in page
    assert "Setting probe" in page
    services.admit_device(device.id, actor=people, reason="board changed, seen")
    services.suspend_device(device.id, actor=people, reason="to look again")
    assert "Nothing: key, serial number" in page_of(admin, bench.device("plate_2"))


def test_an_action_that_came_with_a_version_is_named_and_not_ticked(
    bench: Bench, admin: Client
) -> None:
    device, people = bench.device("timer_1"), bench.people["admin"]
    Device.objects.filter(pk=device.pk).update(state="candidate")
    services.admit_device(device.pk, actor=people, reason="ok")
    services.suspend_device(device.pk, actor=people, reason="a new version")
    assert 'value="wait" aria-label="admit wait" checked' in page_of(admin, device)
    more = approved(bench, timer(3) + LATER)
    Device.objects.filter(pk=device.pk).update(driver=more)
    page = page_of(admin, bench.device("timer_1"))
    assert "Action wait_again" in page
    assert 'value="wait_again" aria-label="admit wait_again" >' in page
    assert '<code>wait_again</code> <span class="chip chip-need">new</span>' in page
    assert 'value="wait" aria-label="admit wait" checked' in page


LATER = '''
    @action(timeout_s=5.0, recovery="R1", operation="read")
    def wait_again(self, duration_s: Annotated[float, Range(0.0, 1.0)]) -> Report:
        """Wait another time."""
        return self.wait(duration_s)
'''


def test_one_that_was_admitted_before_is_reviewed_as_a_new_one(bench: Bench, admin: Client) -> None:
    device, people = bench.device("timer_1"), bench.people["admin"]
    Device.objects.filter(pk=device.pk).update(state="candidate")
    services.admit_device(device.pk, actor=people, reason="ok")
    Device.objects.filter(pk=device.pk).update(state="suspended", admitted_as={})
    page = page_of(admin, device)
    assert "before labweb kept what a device is" in page


def test_what_a_tryout_has_shown_stands_in_the_review(bench: Bench, admin: Client) -> None:
    edge = a_simulating_edge(bench)
    row = begun(bench, edge)
    device = bench.device("heater_1")
    Device.objects.filter(pk=device.pk).update(driver=row.version)
    device = bench.device("heater_1")
    assert "no action" in page_of(admin, device)
    tell(edge, row, number=ask(bench, row, "act", "reach_temperature", **REACH))
    page = page_of(admin, device)
    assert row.title in page
    assert "<dt>Ended well</dt><dd><code>reach_temperature</code>" in page
    assert '<span class="chip chip-need">not passed</span> This version of its driver' in page
    for name in ("hold", "stop_control"):
        args = {"temperature_c": 30.0, "duration_s": 1.0, "tolerance_c": 0.5}
        sent = args if name == "hold" else {}
        tell(edge, row, number=ask(bench, row, "act", name, **sent))
    values = {"values": {"temperature_c": 30.0}, "problems": {}}
    tell(edge, row, number=ask(bench, row, "read"), data=values)
    page = page_of(admin, device)
    assert '<span class="chip chip-enrolled">passed</span> This version of its driver' in page
    other = bench.device("pump_1")
    assert "Nobody has tried this version of its driver in a simulator" in page_of(admin, other)
