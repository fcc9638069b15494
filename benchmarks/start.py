"""How long `make run` takes to open, to open again, and to leave no process behind."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

LIMITS_S = {"first start": 120.0, "second start": 10.0, "stop": 5.0}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _start(data: Path, port: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "deploy.embedded", "run"]
    command += ["--data", str(data), "--port", str(port)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def _wait_for_page(port: int, limit_s: float) -> float:
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < limit_s:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=2):
                return time.monotonic() - begun_s
        except (urllib.error.URLError, OSError):
            time.sleep(0.02)
    raise SystemExit(f"no page within {limit_s} s")


def _stop(process: subprocess.Popen[bytes]) -> float:
    begun_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)
    return time.monotonic() - begun_s


def main() -> int:
    """Measure, print, and fail when a limit is broken."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    port = _free_port()
    figures: dict[str, float] = {}
    try:
        for name in ("first start", "second start"):
            process = _start(folder / "lab", port)
            figures[name] = _wait_for_page(port, LIMITS_S[name] * 2)
            time.sleep(8.0)
            figures["stop"] = _stop(process)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    for name, seconds in figures.items():
        sys.stdout.write(f"{name:<14}{seconds:8.1f} s   limit {LIMITS_S[name]:.0f} s\n")
    return 0 if all(figures[name] <= LIMITS_S[name] for name in figures) else 1
