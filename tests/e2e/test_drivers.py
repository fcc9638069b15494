"""A driver is brought, refused with its lines, mended, approved by another, given, taken back."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

KEY = "timer_1"
SWITCHED_WITHIN_MS = 90_000


def present(stack: Stack) -> dict[str, Any]:
    """Return the version of the driver that the timer has."""
    client = stack.client("admin")
    rows = client.get("devices")["devices"]
    device = client.get(f"devices/{next(row['id'] for row in rows if row['key'] == KEY)}")
    found: dict[str, Any] = client.get(f"drivers/{device['driver']['version_id']}")
    return found


def a_file(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def place(visitor: Visitor) -> Locator:
    return visitor.page.locator(f"[data-testid=driver-place][data-device={KEY}]")


def choose(visitor: Visitor, path: Path) -> None:
    """Choose a file as a person does, who may choose the same one again."""
    with visitor.page.expect_file_chooser() as chooser:
        visitor.press("driver-input")
    chooser.value.set_files(path)


def change(visitor: Visitor, reason: str, version: str | None = None) -> None:
    visitor.press(place(visitor).get_by_test_id("driver-change"))
    if version is not None:
        visitor.at("change-version").select_option(version)
    visitor.at("change-reason").fill(reason)
    visitor.press("change-send")
    expect(visitor.at("change-dialog")).to_have_count(0)


def test_a_driver_goes_from_a_file_to_a_device_and_back(
    visit: Visit, stack: Stack, tmp_path: Path
) -> None:
    before = present(stack)
    source = before["sources"][before["module"]]
    _, folder, model = before["module"].split(".")
    admin, approver = visit("admin"), visit("approver")

    admin.open("drivers")
    admin.press("bring-driver")
    bad = a_file(tmp_path, f"{model}.py", f"{source}\nimport numpy\n")
    choose(admin, bad)
    expect(admin.at("driver-model")).to_have_value(model)
    admin.at("driver-class").select_option(folder)
    line = source.count("\n") + 2
    expect(admin.at("driver-finding")).to_contain_text(f"{model}.py:{line} · DRV011")
    expect(admin.at("driver-propose")).to_be_disabled()

    good = a_file(tmp_path, f"{model}.py", f"{source}\n# tried in a browser\n")
    choose(admin, good)
    expect(admin.at("driver-found")).to_contain_text(before["class_name"])
    admin.at("driver-note").fill("tried in a browser")
    admin.press("driver-propose")
    admin.page.wait_for_url(re.compile(r"/drivers/[0-9a-f-]{36}$"))
    expect(admin.at("driver-changes")).to_contain_text("# tried in a browser")
    expect(admin.at("driver-why-not")).to_contain_text("a second person answers")
    expect(place(admin).get_by_test_id("driver-change")).to_be_disabled()
    url = admin.page.url.removeprefix(stack.url)

    approver.open("")
    approver.press(approver.at("needs").get_by_role("link", name=re.compile("^Driver ")).first)
    approver.page.wait_for_url(f"**/{url}")
    end = approver.at("driver-changes").locator(".endmark")
    end.scroll_into_view_if_needed()
    expect(approver.at("driver-approve")).to_be_enabled()
    approver.press("driver-approve")
    expect(approver.at("driver")).to_have_attribute("data-state", "approved")
    expect(approver.at("driver-change").first).to_be_disabled()

    expect(admin.at("driver")).to_have_attribute("data-state", "approved")
    change(admin, "tried in a browser")
    expect(place(admin)).to_contain_text("has this version", timeout=SWITCHED_WITHIN_MS)
    assert present(stack)["id"] == url.removeprefix("drivers/")
    change(admin, "only a trial", before["id"])
    expect(place(admin)).not_to_contain_text("has this version", timeout=SWITCHED_WITHIN_MS)
    assert present(stack)["id"] == before["id"]
    assert 422 in admin.refusals


def test_who_may_not_bring_or_answer_reads_why(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    chemist.open("drivers")
    expect(chemist.at("bring-driver")).to_be_disabled()
    chemist.press(chemist.at("driver-row").get_by_role("link").first)
    expect(chemist.at("driver-hidden")).to_contain_text("role approver or admin")
    expect(chemist.at("driver-source")).to_have_count(0)
    expect(chemist.at("driver-withdraw")).to_be_disabled()
    expect(chemist.at("driver-change").first).to_be_disabled()
