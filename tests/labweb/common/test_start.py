"""What a process of the server loads when it starts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
ASKED = "import sys, django; django.setup()\n{}\nprint('labweb.approvals.admin' in sys.modules)"


def loads_pages(then: str = "") -> bool:
    """Start as a process of the server does, do something, and look for the admin's pages."""
    done = subprocess.run(
        [sys.executable, "-c", ASKED.format(then)],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip() == "True"


def test_a_process_that_serves_no_page_loads_none() -> None:
    assert not loads_pages()


def test_the_first_address_that_is_asked_for_brings_the_pages() -> None:
    assert loads_pages("from django.urls import reverse; reverse('admin:index')")


def test_the_checks_look_at_every_page() -> None:
    assert loads_pages("from django.core import checks; checks.run_checks(tags=['admin'])")
