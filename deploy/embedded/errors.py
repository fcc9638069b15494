"""What keeps the embedded default from starting."""

from __future__ import annotations


class EmbeddedError(Exception):
    """A start that cannot go on. The message says what is true and what to do."""
