"""What a process of an edge host loads before it serves: a switch waits for every library."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "module",
    ["workers.tryouts.driver_trial", "workers.host.process_main", "workers.host.supervisor"],
)
def test_a_process_of_a_host_starts_without_converting_units(module: str) -> None:
    code = f"import sys, {module}; print(sorted({{'pint', 'numpy'}} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"
