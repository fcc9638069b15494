"""A person at a browser who counts what they press, and notes what the page complains of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlparse

from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Error,
    Locator,
    Page,
    Request,
    Response,
    expect,
)

from tests.system.stack import Stack

WITHIN_MS = 60_000
"""The machine may be busy; a page that has not answered by then is broken."""

DESKTOP = {"width": 1440, "height": 900}
PHONE = {"width": 390, "height": 844}
IN_PAGE = {"data", "blob", "about"}


class Visitor:
    """One person with one tab."""

    def __init__(self, context: BrowserContext, url: str) -> None:
        self.context = context
        self.url = url
        self.page: Page = context.new_page()
        self.password = ""
        self.presses = 0
        self.complaints: list[str] = []
        self.refusals: list[int] = []
        self._origin = urlparse(url).netloc
        context.on("console", self._hear)
        context.on("weberror", lambda error: self.complaints.append(f"threw {error.error}"))
        context.on("request", self._see)
        context.on("response", self._weigh)

    def _hear(self, message: ConsoleMessage) -> None:
        # The browser's own line about an answer of 4xx says no more than `refusals` does.
        if message.type == "error" and not message.text.startswith("Failed to load resource"):
            self.complaints.append(f"console: {message.text}")

    def _see(self, request: Request) -> None:
        address = urlparse(request.url)
        if address.scheme not in IN_PAGE and address.netloc != self._origin:
            self.complaints.append(f"asked another origin: {request.url}")

    def _weigh(self, response: Response) -> None:
        if response.status >= 400:
            self.refusals.append(response.status)

    def at(self, testid: str) -> Locator:
        """Return what carries a test id."""
        return self.page.get_by_test_id(testid)

    def open(self, path: str) -> None:
        """Go to an address, as one who types it."""
        self.page.goto(f"{self.url}{path.lstrip('/')}")

    def press(self, what: Locator | str) -> None:
        """Click, and count it."""
        (self.at(what) if isinstance(what, str) else what).click()
        self.presses += 1

    def press_signed(self, what: str, seen: str) -> None:
        """Press what is signed, and type the password where it is asked for; `seen` follows."""
        self.press(what)
        self.at("signing-form").or_(self.at(seen)).first.wait_for()
        if self.at("signing-form").is_visible():
            self.at("signing-password").fill(self.password)
            self.press("signing-send")

    def key(self, name: str) -> None:
        """Press a key; only Enter and Space count, the others type or move."""
        self.page.keyboard.press(name)
        if name in {"Enter", "Space"}:
            self.presses += 1

    def go_to(self, page: str) -> None:
        """Go to a main page by the rail."""
        self.press(self.page.locator("nav.rail").get_by_role("link", name=page))

    def sign_in(self, stack: Stack, username: str) -> None:
        """Type name and password on the sign-in page."""
        self.press("username")
        self.page.keyboard.type(username)
        self.key("Tab")
        self.password = password_of(stack, username)
        self.page.keyboard.type(self.password)
        self.key("Enter")

    def wait_for_state(self, state: str, within_s: float = 60.0) -> None:
        """Wait until the run page shows a state."""
        shown = self.page.locator(f"[data-testid=run][data-state={state}]")
        shown.wait_for(timeout=within_s * 1000)

    def read_volume(self, key_id: str) -> str:
        """Return the volume that the tree of the lab shows for a vessel."""
        row = self.page.locator(f"[data-testid=tree-row][data-resource='{key_id}']")
        return plain(row.locator(".volcell").inner_text())


def plain(text: str) -> str:
    """Return text with ordinary blanks."""
    return " ".join(text.split())


def password_of(stack: Stack, username: str) -> str:
    """Return the password that the first start made for a user."""
    rows = json.loads((stack.data / "passwords.json").read_text())
    return str(next(row["password"] for row in rows if row["username"] == username))


def cookies_of(stack: Stack, username: str) -> list[dict[str, str]]:
    """Return the cookies of a session that is open, with a password that was just typed."""
    client = stack.client(username)
    client.confirm()
    jar = client.http.cookies.jar
    return [{"name": c.name, "value": c.value or "", "url": stack.url} for c in jar]


@contextmanager
def visiting(
    browser: Browser,
    stack: Stack,
    username: str | None,
    *,
    size: dict[str, int] = DESKTOP,
    scheme: str = "light",
) -> Iterator[Visitor]:
    """Open a fresh tab, signed in or not; a complaint of the page fails the test."""
    context = browser.new_context(
        viewport={"width": size["width"], "height": size["height"]},
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="reduce",
    )
    context.set_default_timeout(WITHIN_MS)
    expect.set_options(timeout=WITHIN_MS)
    try:
        if username is not None:
            context.add_cookies(cookies_of(stack, username))  # type: ignore[arg-type]
        visitor = Visitor(context, stack.url)
        yield visitor
        assert visitor.complaints == []
        assert not [status for status in visitor.refusals if status >= 500]
    finally:
        try:
            context.close()
        except Error:
            if browser.is_connected():
                raise
