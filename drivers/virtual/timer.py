"""A timer that runs on the edge host itself.

Protocol: none; the host's monotonic clock, as fast as its lab time runs.
Quality: bronze, the host's clock is the instrument.
Safe state: not waiting.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec

from drivers.base import DeviceStoppedError, Driver, Range, Report, action
from drivers.interfaces.timer import Timer
from drivers.transports.virtual import VirtualTransport
from labweb.domain.errors import Effect


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """A timer has nothing to set."""


class HostTimer(Driver[VirtualTransport, Config], Timer):
    """One timer of the edge host."""

    transport_type: ClassVar[type] = VirtualTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Nothing answers: the host is the device."""

    def halt(self) -> None:
        """Nothing to send: the waiting thread sees the stop."""

    @action(timeout_s=604_860.0, recovery="R1")
    def wait(self, duration_s: Annotated[float, Range(0.0, 604_800.0)]) -> Report:
        """Return after the duration, at most a week.

        Raises:
            DeviceStoppedError: Stopped while waiting; `context["waited_s"]` says after how long.

        Effect:
            None.
        """
        started_s = self.now_s()
        try:
            self.pause(duration_s)
        except DeviceStoppedError as error:
            error.effect = Effect.NONE
            error.context["waited_s"] = self._waited_s(started_s)
            raise
        return Report(evidence={"waited_s": self._waited_s(started_s)})

    def _waited_s(self, started_s: float) -> float:
        return round(self.now_s() - started_s, 3)
