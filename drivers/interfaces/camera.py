"""A camera that looks at one place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from drivers.base import Report


class Camera(ABC):
    """Takes a still picture of one place and says what it can tell from it.

    What one picture tells is one status, `sighting`, so that a verdict never mixes two
    pictures:

    | field | holds |
    |---|---|
    | `is_present` | whether a vessel stands there; null: the picture does not tell |
    | `presence_confidence_ratio` | how sure that is, 0 to 1 |
    | `tag` | the text of the vessel's tag, "" where no vessel stands; null: it does not tell |
    | `tag_confidence_ratio` | how sure that is, 0 to 1 |
    | `image_sha256` | SHA-256 of the picture's bytes, as they came |
    | `media_type` | `image/jpeg` |
    """

    @abstractmethod
    def look(self) -> Report:
        """Take a picture and return what it tells, as evidence `sighting`.

        Effect:
            None.
        """

    @abstractmethod
    def sighting(self) -> dict[str, Any]:
        """Tell what a picture taken at this moment shows."""

    @abstractmethod
    def is_present(self) -> bool | None:
        """Tell whether a vessel stands at the place; None: the picture does not tell."""

    @abstractmethod
    def tag(self) -> str | None:
        """Tell the vessel's tag, "" where none stands; None: the picture does not tell."""
