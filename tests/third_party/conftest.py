"""The environment that holds the drivers and simulators of others."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.running import ROOT

ENVIRONMENT = ROOT / ".cache/third-party"


def make_environment() -> str:
    """Make the environment, or bring it up to date; return what went wrong."""
    uv = Path(sys.prefix, "bin/uv")
    command = [str(uv), "sync", "--frozen", "--no-install-project", "--only-group", "third-party"]
    variables = {**os.environ, "UV_PROJECT_ENVIRONMENT": str(ENVIRONMENT), "VIRTUAL_ENV": ""}
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=variables,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return done.stderr[-2000:] if done.returncode else ""


@pytest.fixture(scope="session")
def python() -> Path:
    """Find the interpreter that has what others wrote."""
    problem = make_environment()
    if problem and os.environ.get("CI", "").lower() == "true":
        pytest.fail(f"what others wrote cannot be installed: {problem}")
    if problem:
        pytest.skip(f"what others wrote cannot be installed: {problem}")
    return ENVIRONMENT / "bin/python"
