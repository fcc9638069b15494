"""Who opens recipes."""

from __future__ import annotations

import pytest
from django.test import Client

from tests.builders import Bench
from tests.labweb.web import signed_in


@pytest.fixture
def chemist(bench: Bench) -> Client:
    return signed_in(bench.people["chemist"])
