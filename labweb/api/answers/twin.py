"""What the endpoint of the twin answers with."""

from __future__ import annotations

from typing import Literal

from labweb.common.answers import ApiAnswer


class TwinState(ApiAnswer):
    """Whether there is a twin, and where."""

    state: Literal["online", "offline"]
    url: str
