"""Reads back what an action has set, while it waits for it or holds it.

A driver declares nothing for it beyond its statuses: what an action sets, and by which status one
sees it, are words of its role (`labweb.domain.enrollment.setpoint_readback`). Every wait of a
driver passes `Driver.pause`, and there the device is asked.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from drivers.base import Driver
from labweb.domain.enrollment.setpoint_readback import (
    LOOK_S,
    KeptReading,
    ReadbackVerdict,
    Seen,
    look,
)
from labweb.domain.errors import DeviceError

SHORTEST_S = 0.1
"""Real seconds between two looks, however fast lab time runs: others use the line too."""

CANNOT_TELL: Mapping[str, str] = {
    "drivers.characterization.molecular_devices_spectramax": (
        "its protocol tells the incubator's reading and no set-point"
    ),
    "drivers.connectors.masterflex_ls": (
        "its statuses repeat what was sent: the drive is asked for nothing but its number"
    ),
    "drivers.processing.sila_temperature_controller": (
        "its feature tells the reading; the command that keeps the target tells its own end"
    ),
}
"""Drivers that leave something set and have no status that shows the set-point, with the reason.
Of these the progress of the reading alone is watched (`drivers.waiting`)."""


@contextmanager
def reading_back(
    driver: Driver[Any, Any], kept: Sequence[KeptReading], read: Callable[[str], Any]
) -> Iterator[None]:
    """Read back inside what has to stay; a wait of the driver raises what is gone.

    Args:
        driver: It acts on this thread.
        kept: What the action sets.
        read: Asks the device for one status.
    """
    if not kept:
        yield
        return
    driver.while_waiting = _Looking(driver, kept, read)
    try:
        yield
    finally:
        driver.while_waiting = None


class _Looking:
    """Looks once in a while, on the thread of the action alone."""

    def __init__(
        self, driver: Driver[Any, Any], kept: Sequence[KeptReading], read: Callable[[str], Any]
    ) -> None:
        self._driver = driver
        self._read = read
        self._seen = dict.fromkeys(kept, Seen())
        self._thread_id = threading.get_ident()
        self._every_s = max(LOOK_S, SHORTEST_S * driver.pace)
        self._due_s = driver.now_s() + self._every_s

    def __call__(self) -> None:
        """Ask for what is kept, where it is time to.

        Raises:
            DeviceError: `device.setpoint_lost` or `device.stalled`: what was set is gone. What
                the device did since nobody knows, until the driver has read how far it came.
        """
        if self._driver.now_s() < self._due_s or threading.get_ident() != self._thread_id:
            return
        self._due_s = self._driver.now_s() + self._every_s
        for kept, seen in self._seen.items():
            try:
                value = self._read(kept.status)
            except DeviceError:
                continue  # what cannot be read says nothing; the action's own reading will fail
            self._seen[kept] = look(kept, seen, value, self._driver.now_s())
            if self._seen[kept].is_lost:
                raise lost(kept, value)


def lost(kept: KeptReading, value: Any) -> DeviceError:  # noqa: ANN401 - as the device tells it
    """Return the error of what is gone."""
    return DeviceError(
        kept.reason(value),
        code="device.stalled" if kept.sort is ReadbackVerdict.MOTION else "device.setpoint_lost",
        context={"status": kept.status, "asked": kept.asked, "found": value},
    )
