"""Every page in light and dark, on a desk and on a phone: it fits, and it keeps quiet."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.visitor import DESKTOP, PHONE, Visitor, visiting
from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SCREENS = Path(__file__).resolve().parents[2] / "var" / "screens"
WATER = "Move 5 mL of water"
SIZES = {"desk": DESKTOP, "phone": PHONE}


FORMS = [("desk", "light"), ("phone", "dark")]
if "LABWEB_SOAK" in os.environ:
    FORMS += [("desk", "dark"), ("phone", "light")]
WITH_SCENE = {"run", "twin"}
REVIEW = "[data-testid=calibration-change]"
LIVE_TWIN = "[data-testid=twin][data-state=live]"


def addresses(stack: Stack) -> dict[str, tuple[str, str]]:
    """Return each page by a name for its picture: its address, and what it shows at last."""
    client, keys = stack.client(), stack.keys()
    workflows = {row["name"]: row["id"] for row in client.get("workflows")["workflows"]}
    runs = client.get("runs?limit=50")["runs"]
    requests = _requests(stack)
    if "run" not in requests:
        client.start("Heat and stir")
        requests = _requests(stack)
    water = [row for row in runs if row["workflow"]["name"] == WATER and row["state"] == "complete"]
    run = water[0] if water else client.wait_for_run(client.start(WATER)["id"], is_over, 90)
    device = next(row for row in client.get("devices")["devices"] if row["key"] == "heater_1")
    host = client.get("hosts")["hosts"][0]
    driver = next(row for row in client.get("drivers")["drivers"] if row["devices"])
    drawing = workflows["Make a dilution and weigh it"]
    measured = requests.get("calibration")
    calibration = f"approvals/{measured}?state=all"
    return ({} if measured is None else {"calibration": (calibration, REVIEW)}) | {
        "home": ("", "[data-testid=device-tile]"),
        "workflows": ("workflows", "[data-testid=workflow-row]"),
        "editor": (f"workflows/{drawing}/edit", "[data-testid=findings-bar][data-state=checked]"),
        "recipe": ("workflows/xdl", "[data-testid=empty]"),
        "runs": ("runs", "[data-testid=run-row]"),
        "run": (f"runs/{run['id']}", "[data-testid=event-row]"),
        "run-canvas": (f"runs/{run['id']}?tab=canvas", ".react-flow__node"),
        "run-logs": (f"runs/{run['id']}?tab=logs", "[data-testid=log-line]"),
        "run-telemetry": (f"runs/{run['id']}?tab=telemetry", "[data-testid^=plot-]"),
        "run-events": (f"runs/{run['id']}?tab=events", "[data-testid=event-row]"),
        "run-report": (f"runs/{run['id']}?tab=report", "[data-testid=report]"),
        "approvals": ("approvals?state=all", "[data-testid=approval-row]"),
        "approval": (f"approvals/{requests['run']}?state=all", "#review-actions"),
        "twin": ("twin", LIVE_TWIN),
        "devices": ("devices", "[data-testid=device-row]"),
        "device": (f"devices/{device['id']}", "[data-testid=device]"),
        "drivers": ("drivers", "[data-testid=driver-row]"),
        "driver": (f"drivers/{driver['id']}", "[data-testid=driver-hidden]"),
        "files": ("files", "[data-testid=files]"),
        "host": (f"hosts/{host['id']}", "[data-testid=host]"),
        "lab": (f"lab?sel={keys['reactor_1']}", "[data-testid=resource]"),
        "lineage": (f"lineage/{keys['reactor_1']}", "[data-testid=lineage]"),
        "missing": ("no/such/page", "[data-testid=not-found]"),
    }


def _requests(stack: Stack) -> dict[str, str]:
    """Return one request by what it is about."""
    rows = stack.client().get("approvals?state=all")["requests"]
    return {row["about"]: row["id"] for row in rows}


def picture(visitor: Visitor, name: str) -> None:
    """Keep a picture of the page once nothing moves any more."""
    SCREENS.mkdir(parents=True, exist_ok=True)
    visitor.page.screenshot(path=SCREENS / f"{name}.png", animations="disabled")


@pytest.mark.parametrize(("size", "scheme"), FORMS)
def test_every_page_fits_its_screen_and_asks_nobody_else(
    chromium: Browser, stack: Stack, size: str, scheme: str
) -> None:
    with visiting(chromium, stack, None, size=SIZES[size], scheme=scheme) as guest:
        guest.open("login")
        guest.at("sign-in").wait_for()
        picture(guest, f"login-{size}-{scheme}")
        assert is_within(guest)
    with visiting(chromium, stack, "approver", size=SIZES[size], scheme=scheme) as approver:
        show_scene(approver, is_wanted=False)
        approver.open("drivers")
        approver.press(approver.at("driver-row").get_by_role("link").first)
        settle(approver, "[data-testid=driver-source]")
        picture(approver, f"driver-source-{size}-{scheme}")
        assert is_within(approver), f"the source of a driver is wider than the {size}"
    with visiting(chromium, stack, "chemist", size=SIZES[size], scheme=scheme) as chemist:
        for name, (path, shown) in addresses(stack).items():
            show_scene(chemist, is_wanted=name in WITH_SCENE)
            chemist.open(path)
            settle(chemist, shown)
            picture(chemist, f"{name}-{size}-{scheme}")
            assert is_within(chemist), f"{name} is wider than the {size}"
            assert chemist.complaints == [], name
        assert chemist.refusals == []


def show_scene(visitor: Visitor, *, is_wanted: bool) -> None:
    """Draw the 3D scene, or leave its frame blank: drawn without a GPU, it takes seconds."""
    visitor.page.unroute("**/twin/view/**")
    if not is_wanted:
        visitor.page.route("**/twin/view/**", lambda route: route.fulfill(body=""))


def settle(visitor: Visitor, shown: str) -> None:
    """Wait until the page has its data, its fonts and its shapes."""
    page = visitor.page
    page.locator(shown).first.wait_for()
    expect(page.locator("main").get_by_text("Loading")).to_have_count(0)
    page.wait_for_load_state("networkidle")
    page.evaluate("document.fonts.ready.then(() => true)")


def is_within(visitor: Visitor) -> bool:
    """Tell whether the page needs no scrolling sideways."""
    wide = "document.scrollingElement.scrollWidth <= window.innerWidth"
    return bool(visitor.page.evaluate(wide))
