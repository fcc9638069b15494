"""Run what others run steps with, in an environment of their own, from the group `peers`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.figures import Figure

ROOT = Path(__file__).parents[1]
ENVIRONMENT = ROOT / ".cache/peers"
MAKE_S, RUN_S = 600.0, 600.0

NAMES = {
    "bluesky": "peer: bluesky, an event a step",
    "ivoryos": "peer: ivoryos, a row a step",
    "prefect": "peer: prefect, a task a step",
}


class PeerError(RuntimeError):
    """A peer could not be run here."""


@dataclass(frozen=True, slots=True)
class Peer:
    """What a step costs there."""

    step_ms: float
    processor_ms: float


OURS = {"DATABASE_URL", "REDIS_URL", "AMQP_URL", "DJANGO_SETTINGS_MODULE"}
"""What names the lab's servers: a peer that read it would run on them."""


def make_environment() -> None:
    """Make the environment, or bring it up to date.

    Raises:
        PeerError: The packages are not within reach.
    """
    uv = Path(sys.prefix, "bin/uv")
    command = [str(uv), "sync", "--frozen", "--no-install-project", "--only-group", "peers"]
    variables = {**os.environ, "UV_PROJECT_ENVIRONMENT": str(ENVIRONMENT), "VIRTUAL_ENV": ""}
    _run(command, ROOT, MAKE_S, variables)


def run_peer(name: str, count: int) -> Peer:
    """Let a peer run so many steps, in a folder that is gone after.

    Raises:
        PeerError: It did not run them.
    """
    with tempfile.TemporaryDirectory(prefix="peer-") as folder:
        script = str(Path(__file__).with_name("others.py"))
        command = [str(ENVIRONMENT / "bin/python"), script, name, str(count)]
        variables = {name: text for name, text in os.environ.items() if name not in OURS}
        found = json.loads(_run(command, Path(folder), RUN_S, variables).splitlines()[-1])
    calls_s = found["calls_s"]
    per_ms = 1000 / (count - 1)
    return Peer((calls_s[-1] - calls_s[0]) * per_ms, found["processor_s"] * per_ms)


def figures(count: int) -> list[Figure]:
    """Return what a step costs in each peer that can be run here; of the others it says why."""
    found = []
    try:
        make_environment()
    except PeerError as error:
        sys.stdout.write(f"  peers are missing: {error}\n")
        return []
    for name, text in NAMES.items():
        try:
            peer = run_peer(name, count)
        except PeerError as error:
            sys.stdout.write(f"  {name} is missing: {error}\n")
            continue
        found.append(Figure(name=text, value=peer.step_ms, unit="ms a step"))
        told = f"{text.partition(',')[0]}, processor"
        found.append(Figure(name=told, value=peer.processor_ms, unit="ms a step"))
    return found


def _run(command: list[str], folder: Path, within_s: float, variables: dict[str, str]) -> str:
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=variables,
            capture_output=True,
            text=True,
            timeout=within_s,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PeerError(str(error)) from error
    if done.returncode:
        raise PeerError(done.stderr[-500:])
    return done.stdout
