"""A device that shows which one it is: by a display, or by a light."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Showing(ABC):
    """Shows itself, so that a person sees which one it is; nothing else comes of it."""

    @abstractmethod
    def show_itself(self, text: str, shown_s: float) -> Report:
        """Show a text for a while, then what stood there before; or light up so long.

        Args:
            text: What a display shows; one that it cannot show is refused. A light shows none.
            shown_s: For how long.

        Effect:
            None.
        """
