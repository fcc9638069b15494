"""What sensors on Modbus share: they are asked, they move nothing, and a stop keeps them silent."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from drivers.base import Driver, Report, before_acting
from drivers.transports.modbus import RegisterTransport

SIGN_BIT, WORD = 0x8000, 0x10000


class Transmitter:
    """A sensor that is read by registers; stands before `Driver` among the bases."""

    transport_type: ClassVar[type] = RegisterTransport

    def halt(self) -> None:
        """Nothing to send: a sensor moves nothing."""


def measured(driver: Driver[Any, Any], read: Callable[[], Mapping[str, float]]) -> Report:
    """Read once, unless the device is stopped, and report all that was read as evidence.

    Raises:
        DeviceError: It is stopped, or the reading failed; the effect is NONE.
    """
    driver.refuse_if_stopped()
    with before_acting():
        return Report(evidence=dict(read()))


def signed(word: int) -> int:
    """Return the number that a register holds in two's complement.

    Example:
        >>> signed(0xFFF6)
        -10
    """
    return word - WORD if word & SIGN_BIT else word
