"""What a hash is over reads the same before and after a database has kept it."""

from __future__ import annotations

import json
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from labweb.domain.canonical_json import canonical

NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
PLAIN = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text() | st.from_regex(r"\A[:\[,]?-?\d+e\d+\Z"),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


def kept(text: bytes) -> Any:  # noqa: ANN401 - any plain data
    """Return what PostgreSQL gives back of a document kept as `jsonb`: no exponent, no -0.0."""

    def number(token: str) -> int | float:
        plain = format(Decimal(token), "f")
        return float(plain) + 0.0 if "." in plain else int(plain)

    return json.loads(text, parse_float=number)


@given(PLAIN)
@example([-0.0, 1e16, -2.5e300, 1e-9, -0.05])
@example({":1e16": "-0.0", "a": '"1e16\\'})
def test_a_kept_document_has_the_same_text(value: Any) -> None:  # noqa: ANN401
    text = canonical(value)
    assert canonical(kept(text)) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-0.0, b"0.0"),
        (1e16, b"10000000000000000"),
        ({"b": [-0.0, "-0.0"], "a": "3e4"}, b'{"a":"3e4","b":[0.0,"-0.0"]}'),
    ],
)
def test_numbers_lose_their_exponent_and_texts_nothing(value: object, text: bytes) -> None:
    assert canonical(value) == text
