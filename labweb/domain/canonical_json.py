"""One text for one value: what every hash is over, here, on an edge host and in a database."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Any

import msgspec

_TOKEN = re.compile(rb'"(?:[^"\\]|\\.)*"|-0\.0(?![\de])|-?\d+(?:\.\d+)?e\d+')
"""Texts, which stay as they are, and numbers that a database gives back in another form."""

_MAY_CHANGE = re.compile(rb"\de\d|-0\.0")
"""What is in such a number, and may be in a text as well."""


def canonical(value: Any) -> bytes:  # noqa: ANN401 - any plain data
    """Render plain data as JSON with sorted keys and no spaces.

    A number reads the same before and after PostgreSQL has kept it in `jsonb`, which knows
    neither a zero below zero nor an exponent: -0.0 is 0.0, and 1e16 is 10000000000000000.
    """
    raw = msgspec.json.encode(value, order="sorted")
    # Without its texts a value is short: most have no such number, and every event comes by here.
    bare = raw if b"\\" in raw else b"".join(raw.split(b'"')[::2])
    return _TOKEN.sub(_kept, raw) if _MAY_CHANGE.search(bare) else raw


def _kept(found: re.Match[bytes]) -> bytes:
    token = found.group()
    if token.startswith(b'"'):
        return token
    return b"0.0" if token == b"-0.0" else str(int(Decimal(token.decode()))).encode()


def without_null(value: Any) -> Any:  # noqa: ANN401 - any plain data
    """Return plain data with each null character shown as ␀: `jsonb` keeps none.

    Source:
        PostgreSQL 18, 8.14 JSON Types: jsonb rejects U+0000, which its type text cannot hold.
    """
    if isinstance(value, str):
        return value.replace("\0", "␀")
    if isinstance(value, dict):
        return {without_null(key): without_null(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [without_null(one) for one in value]
    return value
