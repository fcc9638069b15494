"""Who asks in a live lab: people with a session, programs with a token, and a stranger."""

from __future__ import annotations

import hashlib
import hmac
import json
import time
from dataclasses import dataclass, field
from uuid import uuid4

from tests.system.stack import Client, Stack

LIMS_SECRET = "s" * 40
LIMS_USER = "chemist"
VARIABLES = {
    "LABWEB_RATE_TIMES": "10000",  # else most would be refused as too many
    "LABWEB_LIMS_SECRET": LIMS_SECRET,
    "LABWEB_LIMS_USER": LIMS_USER,
}
"""What the server of such a lab is started with."""

SIGNED_IN = ("admin", "approver", "chemist")
CONFIRM_EVERY_S = 200.0
"""A password that was typed again holds for 300 s."""


@dataclass
class Caller:
    """Who sends a request, and what goes with it."""

    name: str
    cookies: dict[str, str] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)


def _with_session(name: str, client: Client) -> Caller:
    cookies = {str(one.name): str(one.value) for one in client.http.cookies.jar}
    headers = {"X-CSRFToken": cookies.get("csrftoken", ""), "Referer": client.url}
    return Caller(name, cookies, headers)


class People:
    """Everybody who calls the interface of one lab.

    The observer is spare: whatever is about a session or a password is done with theirs, so that
    nobody else is signed out, or shut out for wrong passwords.
    """

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        self._confirmed_at: float | None = None
        self._spare = stack.client("observer")
        self._tokens = [self._token(*one) for one in (("chemist", "submit"), ("approver", "read"))]

    def _token(self, name: str, scope: str) -> Caller:
        body = {"name": f"probe {uuid4()}", "scope": scope, "days": 2}
        secret = self._stack.client(name).call("POST", "tokens", body)["secret"]
        return Caller(f"{name}'s {scope} token", headers={"Authorization": f"Bearer {secret}"})

    def all(self) -> list[Caller]:
        """Return everybody, whoever may do most first."""
        now = time.monotonic()
        if self._confirmed_at is None or now - self._confirmed_at > CONFIRM_EVERY_S:
            for name in SIGNED_IN:
                self._stack.client(name).confirm()
            self._confirmed_at = now
        signed_in = [_with_session(name, self._stack.client(name)) for name in SIGNED_IN]
        return [*signed_in, *self._tokens, Caller("stranger")]

    @property
    def spare_password(self) -> str:
        """Password of the observer, as it is now."""
        return self._spare.password

    def spare(self) -> Caller:
        """Return the observer, signed in if that is possible."""
        rows = json.loads((self._stack.data / "passwords.json").read_text())
        row = next(row for row in rows if row["username"] == "observer")
        if self._spare.get("session")["user"] is None:
            body = {"username": row["username"], "password": self.spare_password}
            self._spare.http.post("session", json=body, headers=self._spare.headers())
        return _with_session("observer", self._spare)

    def note(self, body: object) -> None:
        """Keep the password that the observer has chosen."""
        if isinstance(body, dict) and isinstance(body.get("new"), str):
            self._spare.password = body["new"]


def signature(raw: bytes) -> dict[str, str]:
    """Return the header with which another system signs a delivery."""
    stamp = str(int(time.time()))
    mac = hmac.new(LIMS_SECRET.encode(), f"{stamp}.".encode() + raw, hashlib.sha256).hexdigest()
    return {"X-Labweb-Signature": f"t={stamp},v1={mac}"}
