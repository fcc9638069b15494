"""An admin lets a machine in and reviews a device, page by page, with real processes."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, FilePayload, expect

from tests.e2e.conftest import CHROMIUM, FLAGS
from tests.e2e.pictures import shoot
from tests.e2e.visitor import Visitor, visiting
from tests.labweb.enrollment.test_scanning import a_picture
from tests.labweb.photos import a_photo
from tests.system.joining import Announcer, Machine, a_machine, asked, until
from tests.system.stack import Stack, free_port, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix="la-", dir="/tmp"))
    yield made
    shutil.rmtree(made, ignore_errors=True)


@pytest.fixture(scope="module")
def stack(folder: Path) -> Iterator[Stack]:
    with running(folder / "lab", has_door=True) as lab:
        yield lab


def press(visitor: Visitor, name: str) -> None:
    """Press a button of an admin page, which answers with another page."""
    with visitor.page.expect_navigation():
        visitor.press(visitor.page.get_by_role("button", name=name, exact=True))


def test_a_machine_and_a_device_are_admitted_page_by_page(
    chromium: Browser, stack: Stack, folder: Path
) -> None:
    with (
        a_machine(stack, folder / "nine") as machine,
        visiting(chromium, stack, "admin") as admin,
    ):
        let_in(admin, machine)
        heard = free_port()
        endpoints = json.loads((stack.data / "endpoints.json").read_text())
        port = int(endpoints["ph_1"].rsplit(":", 1)[1])
        device = Announcer(port, serial="4711")
        machine.configure(
            discovery={"beacon": {"port": heard, "interface": "127.0.0.1"}, "every_s": 1}
        )
        machine.run()
        machine.wait_for_state("online")
        review_candidate(
            admin, device, heard, port, device.code(machine.folder),
            chromium=chromium, stack=stack, folder=folder,
        )  # fmt: skip
        review_device(admin, stack)
        rival = Announcer(port, serial="4711", name="pH 2 again")
        come_back(admin, rival, heard, port, rival.code(machine.folder))


def test_nobody_admits_a_driver_that_was_changed_while_the_review_stood_open(
    chromium: Browser, stack: Stack, folder: Path
) -> None:
    rows = stack.client("admin").get("devices")["devices"]
    device_id = next(row["id"] for row in rows if row["key"] == "ph_1")
    with (
        visiting(chromium, stack, "admin") as admin,
        visiting(chromium, stack, "admin") as other,
        visiting(chromium, stack, "approver") as approver,
    ):
        review = f"admin/enrollment/device/{device_id}/review/"
        admin.open(review)
        shown = admin.page.locator("input[name=seen]").first.input_value()
        admin.page.fill("#reason", "label and display compared")
        give_another_driver(other, approver, stack, device_id, folder)
        press(admin, "Admit")
        expect(admin.page.get_by_role("alert")).to_contain_text("not the one that the page showed")
        assert 422 in admin.refusals
        assert stack.client("admin").get(f"devices/{device_id}")["state"] == "candidate"
        admin.open(review)
        assert admin.page.locator("input[name=seen]").first.input_value() != shown
        admin.page.fill("#reason", "what it may do now was read anew")
        press(admin, "Admit")
        expect(admin.page.get_by_text("is admitted").first).to_be_visible()


def give_another_driver(
    admin: Visitor, approver: Visitor, stack: Stack, device_id: str, folder: Path
) -> None:
    """Bring another version of the device's driver, have it approved, and give it to the device."""
    device = stack.client("admin").get(f"devices/{device_id}")
    present = stack.client("admin").get(f"drivers/{device['driver']['version_id']}")
    file = folder / f"{present['module'].rpartition('.')[2]}.py"
    file.write_text(f"{present['sources'][present['module']]}\n# brought meanwhile\n")
    admin.open("drivers")
    admin.press("bring-driver")
    with admin.page.expect_file_chooser() as chooser:
        admin.press("driver-input")
    chooser.value.set_files(file)
    admin.at("driver-class").select_option(present["module"].split(".")[1])
    admin.at("driver-note").fill("brought meanwhile")
    admin.press("driver-propose")
    admin.page.wait_for_url(re.compile(r"/drivers/[0-9a-f-]{36}$"))
    approver.open(admin.page.url.removeprefix(stack.url))
    approver.at("driver-changes").locator(".endmark").scroll_into_view_if_needed()
    approver.press("driver-approve")
    expect(approver.at("driver")).to_have_attribute("data-state", "approved")
    expect(admin.at("driver")).to_have_attribute("data-state", "approved")
    place = admin.page.locator(f"[data-testid=driver-place][data-device={device['key']}]")
    admin.press(place.get_by_test_id("driver-change"))
    admin.at("change-reason").fill("brought meanwhile")
    admin.press("change-send")
    expect(place).to_contain_text("has this version")


def let_in(admin: Visitor, machine: Machine) -> None:
    """Make a token, join with it, mistype the code once, and admit."""
    page, stack = admin.page, machine.stack
    admin.open("admin/enrollment/jointoken/")
    shoot(admin, "admin-tokens-none")
    admin.open("admin/enrollment/jointoken/new/")
    page.fill("#name", "Bench 9")
    shoot(admin, "admin-token-new")
    press(admin, "Make token")
    command = admin.at("command").inner_text()
    shoot(admin, "admin-token-made")
    found = re.search(r"--token[= ]'?([^\s']+)", command)
    assert found is not None, command
    machine.begin("--server", stack.door, "--token", found[1], "--mode", "sim")
    code = machine.code()
    (request,) = asked(stack, "Bench 9")
    admin.open("admin/enrollment/jointoken/")
    shoot(admin, "admin-tokens")
    admin.open("admin/enrollment/joinrequest/")
    shoot(admin, "admin-requests")
    admin.open(f"admin/enrollment/joinrequest/{request['id']}/review/")
    shoot(admin, "admin-request")
    page.fill("#code", "0000-0000-0000")
    page.fill("#reason", "read it from the screen")
    press(admin, "Admit")
    expect(page.get_by_text("The code differs. Do not admit.")).to_be_visible()
    shoot(admin, "admin-request-differs")
    page.fill("#code", code.lower())
    press(admin, "Admit")
    expect(page.get_by_text("is a host of this lab").first).to_be_visible()
    shoot(admin, "admin-request-admitted")
    assert machine.ended() == 0, machine.said()


def find(admin: Visitor, device: Announcer, heard: int, name: str) -> None:
    """Have the device announce itself until it stands in the inbox, and open its review."""

    def is_there() -> bool:
        device.shout(heard)
        admin.open("admin/enrollment/candidate/?state__exact=new")
        return admin.page.get_by_text(name, exact=True).count() > 0

    until(is_there)


def review_candidate(
    admin: Visitor,
    device: Announcer,
    heard: int,
    port: int,
    code: str,
    *,
    chromium: Browser,
    stack: Stack,
    folder: Path,
) -> None:
    page = admin.page
    find(admin, device, heard, "pH 2")
    shoot(admin, "admin-candidates")
    page.get_by_role("link", name="Review").first.click()
    page.wait_for_url("**/review/")
    shoot(admin, "admin-candidate")
    page.fill("#label", "pH-1 4711, inventory 88")
    page.fill("#transport", f"modbus+tcp://127.0.0.1:{port}?device=1")
    page.fill("#code", "0000-0000-0000")
    page.fill("#reason", "read from its display")
    press(admin, "Take it up")
    expect(page.get_by_text("What you typed differs. Do not admit.")).to_be_visible()
    shoot(admin, "admin-candidate-differs")
    scan_with_camera(admin, chromium, stack, folder, code)
    page.set_input_files("[data-scan-photo]", a_file(a_picture("A", "B")))
    expect(page.get_by_text("the picture shows 2 codes")).to_be_visible()
    page.set_input_files("[data-scan-photo]", a_file(a_picture(code)))
    expect(page.locator("#code")).to_have_value(code)
    shoot(admin, "admin-candidate-scanned")
    press(admin, "Take it up")
    page.wait_for_url("**/device/*/review/")


def a_file(data: bytes) -> FilePayload:
    return {"name": "code.jpg", "mimeType": "image/jpeg", "buffer": data}


def scan_with_camera(
    admin: Visitor, chromium: Browser, stack: Stack, folder: Path, code: str
) -> None:
    """Hold the device's code before a camera: what is read stands in the field."""
    seen = folder / "camera.mjpeg"
    seen.write_bytes(a_picture(code) * 30)
    camera = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
    flags = [*FLAGS, *camera, f"--use-file-for-fake-video-capture={seen}"]
    with (
        chromium.browser_type.launch(executable_path=CHROMIUM, args=flags) as other,
        visiting(other, stack, "admin") as phone,
    ):
        phone.page.goto(admin.page.url)
        phone.press(phone.page.get_by_role("button", name="Scan it with the camera"))
        expect(phone.page.locator("#code")).to_have_value(code)
        expect(phone.page.get_by_text(f"Read: {code}.")).to_be_visible()
        expect(phone.page.locator("video")).to_be_hidden()


def review_device(admin: Visitor, stack: Stack) -> None:
    page = admin.page
    shoot(admin, "admin-device-candidate")
    page.set_input_files(
        "#photo", {"name": "ph.jpg", "mimeType": "image/jpeg", "buffer": a_photo("teal")}
    )
    press(admin, "Keep the photo")
    expect(page.get_by_text("The photo is kept.")).to_be_visible()
    shown = page.locator(".photo img")
    assert shown.evaluate("one => one.complete && one.naturalWidth") == 640
    shoot(admin, "admin-device-photo")
    page.set_input_files(
        "#photo", {"name": "ph.jpg", "mimeType": "image/jpeg", "buffer": b"<svg/>"}
    )
    press(admin, "Keep the photo")
    expect(page.get_by_role("alert")).to_contain_text("no photo that can be read")
    page.fill("#reason", "label and display compared")
    page.locator("input[name=action]").first.set_checked(checked=False)
    expect(page.locator("[data-kept]")).to_have_text(
        "Kept. Nothing of it counts before you decide."
    )
    page.goto(page.url)
    expect(page.locator("#reason")).to_have_value("label and display compared")
    expect(page.locator("input[name=action]").first).not_to_be_checked()
    shoot(admin, "admin-device-kept")
    page.locator("input[name=action]").first.set_checked(checked=True)
    press(admin, "Admit")
    expect(page.get_by_text("is admitted").first).to_be_visible()
    shoot(admin, "admin-device-admitted")
    device_id = page.url.rstrip("/").split("/")[-2]
    until(lambda: stack.client("admin").get(f"devices/{device_id}")["readings"])
    review = page.url
    admin.open(f"devices/{device_id}")
    admin.at("device-photo").get_by_role("img").wait_for()
    shoot(admin, "device-photo")
    page.goto(review)


def come_back(admin: Visitor, rival: Announcer, heard: int, port: int, code: str) -> None:
    """Another key alone speaks in its place: it is suspended, and what has changed is shown."""
    page, review = admin.page, admin.page.url

    def is_suspended() -> bool:
        rival.shout(heard)
        page.goto(review)
        return page.get_by_text("Suspended by labweb").count() > 0

    until(is_suspended, within_s=150)
    shoot(admin, "admin-device-suspended")
    find(admin, rival, heard, "pH 2 again key changed")
    page.get_by_role("link", name="Review").first.click()
    page.wait_for_url("**/review/")
    shoot(admin, "admin-candidate-key-changed")
    page.fill("#transport", f"modbus+tcp://127.0.0.1:{port}?device=1")
    page.fill("#code", code)
    page.fill("#reason", "its board was changed; stood beside it")
    press(admin, "Take it up")
    page.wait_for_url("**/device/*/review/")
    changed = admin.at("changed")
    expect(changed).to_contain_text("Key")
    shoot(admin, "admin-device-returning")
    page.fill("#reason", "its board was changed")
    press(admin, "Admit")
    expect(page.get_by_text("is admitted").first).to_be_visible()
