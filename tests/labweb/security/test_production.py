"""Production settings: complete, or no start."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def check(folder: Path, **changes: str | None) -> subprocess.CompletedProcess[str]:
    """Run `manage.py check --deploy` with production settings in an environment of its own."""
    key = folder / "secret"
    key.write_text(secrets.token_urlsafe(64), encoding="ascii")
    (folder / "static").mkdir(exist_ok=True)
    environment: dict[str, str | None] = {
        "PATH": os.environ["PATH"],
        "DJANGO_SETTINGS_MODULE": "labweb.settings.production",
        "DATABASE_URL": "postgresql://labweb@/labweb",
        "REDIS_URL": "redis://127.0.0.1:6379/0",
        "LABWEB_DATA": str(folder),
        "LABWEB_HOSTS": "lab.example.org",
        "LABWEB_SECRET_KEY_FILE": str(key),
        "LABWEB_ALLOW_SINGLE_FACTOR": "yes",
        **changes,
    }
    return subprocess.run(
        [sys.executable, "manage.py", "check", "--deploy", "--fail-level", "WARNING"],
        cwd=ROOT,
        env={name: value for name, value in environment.items() if value is not None},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )


def test_the_check_for_deployment_has_nothing_to_say(tmp_path: Path) -> None:
    done = check(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "no issues" in done.stdout


@pytest.mark.parametrize("length", [0, 49])
def test_a_short_secret_is_refused(tmp_path: Path, length: int) -> None:
    short = tmp_path / "short"
    short.write_text("k" * length, encoding="ascii")
    done = check(tmp_path, LABWEB_SECRET_KEY_FILE=str(short))
    assert done.returncode != 0
    assert "at least 50 characters" in done.stderr


@pytest.mark.parametrize("said", [None, "", "no", "1"])
def test_one_factor_alone_has_to_be_accepted_in_so_many_words(
    tmp_path: Path, said: str | None
) -> None:
    done = check(tmp_path, LABWEB_ALLOW_SINGLE_FACTOR=said)
    assert done.returncode != 0
    assert "LABWEB_ALLOW_SINGLE_FACTOR=yes" in done.stderr


def test_a_server_that_is_to_break_on_purpose_is_refused(tmp_path: Path) -> None:
    done = check(tmp_path, LABWEB_FAULTS="1")
    assert done.returncode != 0
    assert "LABWEB_FAULTS" in done.stderr
