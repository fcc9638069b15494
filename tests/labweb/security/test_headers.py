"""Headers of every sort of answer, and what never stands in the repository or an URL."""

from __future__ import annotations

import math
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from tests.builders import PASSWORD, Bench
from tests.labweb.web import call, routes, signed_in

ROOT = Path(__file__).parents[3]

ANSWERS = {
    "page": "/",
    "API": "/api/v1/home",
    "refusal": "/api/v1/runs/00000000-0000-0000-0000-000000000000",
    "schema": "/api/schema/",
    "admin list": "/admin/enrollment/device/",
    "sign of life": "/healthz",
    "nothing": "/api/nothing",
}


@pytest.mark.parametrize("sort", ANSWERS)
def test_every_answer_carries_the_headers(bench: Bench, sort: str) -> None:
    answer = signed_in(bench.people["admin"]).get(ANSWERS[sort])
    policy = answer["Content-Security-Policy"]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'self'"
    assert rules["script-src"] == "'self'"
    assert rules["frame-ancestors"] == "'self'"
    assert rules["object-src"] == rules["base-uri"] == "'none'"
    assert "*" not in policy
    assert answer["X-Content-Type-Options"] == "nosniff"
    assert answer["Referrer-Policy"] == "same-origin"
    assert answer["X-Frame-Options"] == "SAMEORIGIN"
    assert "Access-Control-Allow-Origin" not in answer


def test_no_admin_page_has_a_script_in_it(bench: Bench) -> None:
    client = signed_in(bench.people["admin"])
    device = bench.device("ph_1").id
    for path in (
        "/admin/",
        "/admin/enrollment/device/",
        f"/admin/enrollment/device/{device}/review/",
        "/admin/accounts/user/add/",
    ):
        text = client.get(path).content.decode()
        assert "admin_labweb.css" in text
        for tag in re.findall(r"<script[^>]*>", text):
            assert "src=" in tag or 'type="application/json"' in tag, (path, tag)
        assert not re.search(r"\son\w+=\"", text), path
        assert "javascript:" not in text


def test_the_session_cookie_is_not_for_scripts(bench: Bench) -> None:
    client = signed_in(None)
    body = {"username": "chemist", "password": PASSWORD}
    assert call(client, "POST", "/api/v1/session", body).status_code == 200
    cookie = client.cookies["sessionid"]
    assert cookie["httponly"]
    assert cookie["samesite"] == "Lax"


ABOUT_TOKENS = {
    "api/v1/join-tokens",
    "api/v1/join-tokens/<uuid:token_id>",
    "api/v1/session/password",
    "api/v1/tokens",
    "api/v1/tokens/<uuid:access_id>",
}
"""Routes that make and end tokens, of which one takes the id of one, never its secret; and where a
password is changed, which stands in the body."""


def test_no_url_takes_a_credential() -> None:
    words = re.compile(r"token|secret|password(?!_change)|passwd|api_?key|nonce", re.IGNORECASE)
    own = {route for route, _ in routes() if not route.startswith("admin/")}
    assert {route for route in own if words.search(route)} == ABOUT_TOKENS


SECRETS = {
    "private key": re.compile(r"-----BEGIN [A-Z ]*PRIVATE KEY-----"),
    "cloud key": re.compile(r"\bAKIA[0-9A-Z]{16}\b"),
    "forge token": re.compile(r"\b(?:gh[pousr]_[A-Za-z0-9]{36}|glpat-[A-Za-z0-9_-]{20})\b"),
    "URL with a password": re.compile(
        r"\b[a-z][a-z0-9+]*://[^\s/:@'\"{}$]+:(?!guest@)[^\s/@'\"{}$]+@"
    ),
}
ASSIGNED = re.compile(
    r"""(?i)\b\w*(?:secret|password|passwd|token|api_key)\w*\s*[:=]\s*["']([A-Za-z0-9+/_=-]{16,})["']"""
)


def bits(text: str) -> float:
    """Return the entropy of a text, in bits per character."""
    shares = [count / len(text) for count in Counter(text).values()]
    return -sum(share * math.log2(share) for share in shares)


def leaks(text: str) -> list[str]:
    found = [name for name, pattern in SECRETS.items() if pattern.search(text)]
    random = [match for match in ASSIGNED.findall(text) if bits(match) > 4.2]
    return found + ["random text in a secret's place" for _ in random]


def test_the_repository_holds_no_secret() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT, capture_output=True, check=True,
    ).stdout.decode().split("\0")  # fmt: skip
    found = []
    for name in filter(None, listed):
        path = ROOT / name
        if (
            not path.is_file()
            or path.suffix in {".lock", ".png", ".woff2"}
            or path == Path(__file__)
        ):
            continue
        found += [(name, leak) for leak in leaks(path.read_text("utf-8", errors="replace"))]
    assert not found


def test_the_search_for_secrets_finds_some() -> None:
    assert leaks("-----BEGIN " + "PRIVATE KEY-----") == ["private key"]
    assert leaks("redis://someone:" + "hunter2@host/0") == ["URL with a password"]
    assert leaks("SECRET_KEY = '" + "kJ8s7dFq2Lw9xZ3vB6nM1pRt" + "'")
    assert leaks('PASSWORD = "a-long-enough-passphrase"') == []
