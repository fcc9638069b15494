"""Right plans are proved."""

from __future__ import annotations

import pytest

from tests.domain.workflows.interpret.bench import check
from tests.domain.workflows.interpret.plans import RIGHT


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_plan_is_proved(name: str) -> None:
    assert check(RIGHT[name]) == []
