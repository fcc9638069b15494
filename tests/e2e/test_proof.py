"""A device that is out of service is looked at on its host before somebody lets it in again."""

from __future__ import annotations

import os

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.test_look import is_within, picture
from tests.e2e.visitor import DESKTOP, Visitor, visiting
from tests.system.stack import Stack
from workers.sandbox.confinement import is_possible

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(180),
    pytest.mark.skipif(not is_possible(), reason="this kernel cannot confine drivers"),
]

NARROW = {"width": 360, "height": 740}
SCHEMES = ("light", "dark") if "LABWEB_SOAK" in os.environ else ("light",)


def look_until_told(admin: Visitor) -> None:
    """Press again where the host was away: after a suspension it opens another session."""
    proof = admin.page.locator("section[aria-labelledby=proof]")
    button = admin.page.get_by_role("button", name="Look at it now")
    for _ in range(60):
        if "What it told" in proof.inner_text():
            return
        if button.count():
            admin.press(button)
            admin.page.wait_for_load_state()
        admin.page.wait_for_timeout(1000)
    raise AssertionError(proof.inner_text())


def test_what_the_instrument_tells_stands_in_its_review(chromium: Browser, stack: Stack) -> None:
    device = next(
        row for row in stack.client().get("devices")["devices"] if row["key"] == "balance_1"
    )
    page = f"admin/enrollment/device/{device['id']}/review/"
    acts = len(stack.actuations("balance_1"))
    with visiting(chromium, stack, "admin", size=DESKTOP, scheme="light") as admin:
        admin.open(page)
        admin.page.fill("#reason", "moved to another bench")
        admin.press(admin.page.get_by_role("button", name="Suspend"))
        look_until_told(admin)
        proof = admin.page.locator("section[aria-labelledby=proof]")
        expect(proof).to_contain_text("mass_mg")
        expect(proof.get_by_text("passed", exact=True)).to_be_visible()
        assert is_within(admin)
    for scheme in SCHEMES:
        for name, size in (("desk", DESKTOP), ("narrow", NARROW)):
            with visiting(chromium, stack, "admin", size=size, scheme=scheme) as admin:
                admin.open(page)
                admin.page.locator("#proof").scroll_into_view_if_needed()
                assert is_within(admin)
                picture(admin, f"proof-{name}-{scheme}")
    with visiting(chromium, stack, "admin", size=DESKTOP, scheme="light") as admin:
        admin.open(page)
        admin.page.fill("#reason", "its display shows the same mass")
        admin.press(admin.page.get_by_role("button", name="Admit", exact=True))
        admin.page.get_by_role("button", name="Suspend").wait_for()
    assert len(stack.actuations("balance_1")) == acts
