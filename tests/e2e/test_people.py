"""Coming back after the session ended, finding things, and letting a device in."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def end_session(visitor: Visitor) -> None:
    """Sign out as another tab would, so that this one does not know."""
    cookies = {c["name"]: c["value"] for c in visitor.context.cookies()}
    headers = {"X-CSRFToken": cookies["csrftoken"], "Referer": visitor.url}
    answer = visitor.context.request.delete(f"{visitor.url}api/v1/session", headers=headers)
    assert answer.ok


def test_an_ended_session_leads_to_the_sign_in_page_and_back(visit: Visit, stack: Stack) -> None:
    chemist = visit(None)
    here = f"lab?sel={stack.keys()['reactor_1']}"
    chemist.open(here)
    chemist.sign_in(stack, "chemist")
    chemist.at("resource").wait_for()
    assert chemist.page.url == f"{stack.url}{here}"
    end_session(chemist)
    chemist.page.evaluate("window.dispatchEvent(new Event('visibilitychange'))")
    chemist.at("sign-in").wait_for()
    chemist.sign_in(stack, "chemist")
    chemist.at("resource").wait_for()
    assert chemist.page.url == f"{stack.url}{here}"


def test_a_wrong_password_is_refused_in_words(visit: Visit, stack: Stack) -> None:
    guest = visit(None)
    guest.open("login")
    guest.at("username").fill("chemist")
    guest.at("password").fill("wrong")
    guest.press("sign-in")
    expect(guest.at("refused")).to_contain_text("session.wrong")
    assert 403 in guest.refusals


def test_an_unknown_address_has_a_page_that_leads_home(visit: Visit) -> None:
    chemist = visit("chemist")
    chemist.open("no/such/page")
    expect(chemist.at("not-found")).to_be_visible()
    chemist.press(chemist.at("not-found").get_by_role("link", name="Home"))
    expect(chemist.at("home")).to_be_visible()


def test_search_finds_the_reactor_by_its_name(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    chemist.open("")
    chemist.at("home").wait_for()
    chemist.key("Control+k")
    expect(chemist.at("search-input")).to_be_focused()
    chemist.page.keyboard.type("Reactor 1")
    hit = chemist.page.get_by_role("option").filter(has_text="Reactor 1").first
    expect(hit).to_be_visible()
    chemist.key("Enter")
    chemist.page.wait_for_url(re.compile(stack.keys()["reactor_1"]))
    expect(chemist.page.get_by_role("heading", name="Reactor 1")).to_be_visible()


def test_a_discovered_device_is_read_admitted_and_comes_online(visit: Visit, stack: Stack) -> None:
    device = next(d for d in stack.client().get("devices")["devices"] if d["key"] == "ph_1")
    assert device["state"] == "candidate"
    stranger = visit(None)
    stranger.open("admin/enrollment/device/")
    stranger.at("sign-in").wait_for()
    stranger.sign_in(stack, "admin")
    stranger.press(stranger.page.get_by_role("link", name="pH 1"))
    expect(stranger.page.get_by_role("button", name="Admit")).to_be_visible()
    admin = visit("admin")
    admin.open("")
    need = admin.at("needs").locator("[data-kind=candidate]")
    admin.press(need.get_by_role("button", name="Review"))
    admin.page.wait_for_url(f"**/admin/enrollment/device/{device['id']}/review/")
    expect(admin.page.get_by_text("The driver keeps every rule")).to_be_visible()
    admin.page.get_by_label("What did you check?").fill("serial number and wiring")
    admin.press(admin.page.get_by_role("button", name="Admit"))
    expect(admin.page.get_by_text("is admitted")).to_be_visible()
    admin.open("devices")
    row = admin.at("device-row").filter(has_text="pH 1")
    expect(row).to_have_attribute("data-state", "online", timeout=60_000)
