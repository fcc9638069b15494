"""A check that does not check is a lie: each gate is shown a bad sample and must refuse it."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from hypothesis import settings

from tests.architecture.project import ROOT, run_tool
from tests.conftest import is_on_this_machine

HEAD = '"""A sample."""\n\n'


def ruff(code: str, at: str = "labweb/runs/services.py") -> str:
    """Check a piece of code as if it stood in that file."""
    done = run_tool(
        "ruff", "check", "--output-format=concise", "--stdin-filename", at, "-", stdin=code
    )
    return done.stdout


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        ("TID251", "from django.db.models.signals import post_save\n\n__all__ = ['post_save']\n"),
        ("TID251", "import time\n\ntime.sleep(1)\n"),
        ("TID251", "import datetime\n\nNOW = datetime.datetime.now(datetime.UTC)\n"),
        ("TID252", "from . import models\n\n__all__ = ['models']\n"),
        ("T201", "print('hello')\n"),
        ("ERA001", "# value = compute(1)\n"),
        ("ANN201", 'def f():\n    """Answer."""\n'),
        ("D103", "def f() -> None:\n    return\n"),
        ("BLE001", "try:\n    import a\nexcept Exception:\n    a = None\n"),
        ("S110", "try:\n    import a\nexcept Exception:\n    pass\n"),
        ("PLR0913", "def f(a: int, b: int, c: int, d: int, e: int, g: int, h: int) -> None: ...\n"),
        ("PGH003", "a = 1  # type: ignore\n"),
        ("DTZ005", "import datetime\n\nNOW = datetime.datetime.now()\n"),
    ],
)
def test_ruff_refuses_what_the_style_bans(rule: str, code: str) -> None:
    assert rule in ruff(HEAD + code)


def test_ruff_accepts_a_clean_sample() -> None:
    assert "All checks passed!" in ruff(HEAD + 'VOLUME_UL = 5.0\n"""A volume."""\n')


def test_ruff_lets_a_test_sleep_and_a_driver_not() -> None:
    code = HEAD + "import time\n\ntime.sleep(1)\n"
    assert "TID251" not in ruff(code, at="tests/drivers/test_a_pump.py")
    assert "TID251" in ruff(code, at="drivers/processing/pump.py")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        ("no-untyped-def", "def f(a):\n    return a\n"),
        ("arg-type", "def f(a: int) -> int:\n    return a\n\n\nf('x')\n"),
        ("ignore-without-code", "a: int = 'x'  # type: ignore\n"),
        ("possibly-undefined", "def f(x: bool) -> int:\n    if x:\n        a = 1\n    return a\n"),
        ("type-arg", "def f(a: list) -> None: ...\n"),
        ("no-any-return", "import json\n\n\ndef f() -> int:\n    return json.loads('1')\n"),
    ],
)
def test_mypy_refuses_what_strict_bans(tmp_path: Path, error: str, code: str) -> None:
    sample = tmp_path / "sample.py"
    sample.write_text(code, "utf-8")
    done = run_tool("mypy", "--config-file", str(ROOT / "pyproject.toml"), str(sample))
    assert done.returncode == 1, done.stdout + done.stderr
    assert f"[{error}]" in done.stdout


def test_a_test_cannot_reach_the_network() -> None:
    with socket.socket() as sock, pytest.raises(PermissionError, match="stay on this machine"):
        sock.connect(("192.0.2.1", 80))
    with pytest.raises(PermissionError, match="stay on this machine"):
        socket.getaddrinfo("example.org", 443)
    with pytest.raises(PermissionError, match="stay on this machine"):
        socket.create_connection(("example.org", 443), timeout=1)


def test_a_test_can_reach_this_machine() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        socket.create_connection(server.getsockname(), timeout=1).close()
    near, far = socket.socketpair()
    near.close()
    far.close()
    assert is_on_this_machine(("::1", 80, 0, 0))
    assert not is_on_this_machine(("10.0.0.1", 80))


def test_examples_come_again_in_continuous_integration() -> None:
    assert settings.get_profile("ci").derandomize
    assert settings.get_profile("ci").print_blob
