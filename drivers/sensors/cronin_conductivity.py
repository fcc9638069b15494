"""Conductivity sensor on a microcontroller, as the Chemputer's control software has it.

Protocol: 9600 8N1, one letter LF; answered by whole numbers of ten bits, CR LF.
Quality: bronze, simulated instrument.
Safe state: idle; a sensor moves nothing.

The sensor tells counts of its converter and no unit. What a full scale stands for is found
by calibration and has to be set; the whole scale is taken as linear.

Source:
    Mehr, Craven, Leonov, Keenan, Cronin, Science 370 (2020) 101, control software,
    module conductivity_sensor.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.conductivity_sensor import ConductivitySensor
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DefinitionError, FrameError

END = b"\r\n"
FULL_SCALE_COUNTS = 1023
ALL_CHANNELS = b"C\n"
ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One channel of a sensor."""

    full_scale_us_cm: Annotated[float, Range(1.0, 1_000_000.0)]
    """Conductivity at full scale, from the last calibration."""

    channel_index: Annotated[int, Range(1, 16)] = 1


def decode_counts(frame: bytes) -> tuple[int, ...]:
    r"""Read the counts of all channels.

    Raises:
        FrameError: Not whole numbers of ten bits.

    Example:
        >>> decode_counts(b"512 0 0 1023\r\n")
        (512, 0, 0, 1023)
    """
    if not re.fullmatch(rb"[0-9]{1,4}( [0-9]{1,4})* ?\r\n", frame):
        raise FrameError("answer is no row of counts", context={"frame": frame.hex()})
    counts = tuple(int(count) for count in frame.split())
    if max(counts) > FULL_SCALE_COUNTS:
        raise FrameError(f"count {max(counts)} has more than ten bits")
    return counts


class CroninConductivity(Driver[ByteTransport, Config], ConductivitySensor):
    """One channel of a sensor."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read once, and refuse a channel that the sensor does not have."""
        channels = len(self._counts())
        if self.config.channel_index > channels:
            raise DefinitionError(
                f"channel {self.config.channel_index} is set; the sensor has {channels}",
                code="driver.config",
            )

    def halt(self) -> None:
        """Nothing to send: a sensor moves nothing."""

    @status(every_s=2.0)
    def conductivity_us_cm(self) -> float:
        """Tell the conductivity."""
        return self._conductivity_us_cm(self._count())

    @action(timeout_s=10.0, recovery="R1", operation="read")
    def measure(self) -> Report:
        """Read once, as evidence `conductivity_us_cm` with the bare count beside it.

        Raises:
            FrameError: The count is at full scale: the conductivity is beyond the range.

        Effect:
            None.
        """
        self.refuse_if_stopped()
        with before_acting():
            count = self._count()
            conductivity_us_cm = self._conductivity_us_cm(count)
            return Report(evidence={"conductivity_us_cm": conductivity_us_cm, "counts": count})

    def _conductivity_us_cm(self, count: int) -> float:
        if count >= FULL_SCALE_COUNTS:
            raise FrameError("the reading is at full scale", context={"counts": count})
        return round(count * self.config.full_scale_us_cm / FULL_SCALE_COUNTS, 3)

    def _count(self) -> int:
        counts = self._counts()
        if len(counts) < self.config.channel_index:
            raise FrameError(f"answer has {len(counts)} channels")
        return counts[self.config.channel_index - 1]

    def _counts(self) -> tuple[int, ...]:
        answer = self.transport.exchange(ALL_CHANNELS, until=END, timeout_s=ANSWER_S)
        return decode_counts(answer)
