"""One device as the executor of its line sees it: driver, link, stop."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from drivers.base import Driver, Report
from drivers.load import call_action, read_status
from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import DeviceError, LabError
from labweb.domain.messages.devices_and_drivers import DeviceConfig

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0


@contextmanager
def _border(key: str) -> Iterator[None]:
    """Turn a driver's bug into a device's failure, so that its line goes on."""
    try:
        yield
    except LabError:
        raise
    except Exception as error:
        log.exception("the driver of %s has a bug", key)
        text = f"{type(error).__name__}: {error}"
        raise DeviceError(text, code="driver.bug") from error


class DeviceUnit:
    """A device of this line."""

    def __init__(
        self, config: DeviceConfig, driver: Driver[Any, Any], clock: Clock, pace: float = 1.0
    ) -> None:
        self.config = config
        self.driver = driver
        self.driver.pace = pace
        self.is_online = False
        self.is_acting = False
        self.acting = ""
        """The action that its driver is carrying out; empty: none."""

        self._clock = clock
        self._retry_s = FIRST_RETRY_S
        self.owes_halt = False
        """A halt could not be delivered."""

        self._next_try_s = clock.monotonic_s()
        self._connecting = threading.Lock()

    @property
    def line(self) -> str:
        """Return the name of the wire."""
        return str(self.driver.transport.line)

    def connect_if_due(self) -> None:
        """Try to reach the device, unless it is reached or the last try was just now."""
        if self.is_online or self.is_acting or self._clock.monotonic_s() < self._next_try_s:
            return
        with self._connecting:
            try:
                with _border(self.config.key):
                    self.driver.connect()
            except LabError as error:
                self._wait_longer()
                log.warning("device %s is offline: %s", self.config.key, error)
                return
            self.is_online = True
            self._retry_s = FIRST_RETRY_S
            log.info("device %s is online", self.config.key)
            if self.owes_halt:
                self.stop()

    def lose_link(self) -> None:
        """Note that the device does not answer, and let go of its line."""
        if self.is_acting:
            return
        if self.is_online:
            log.warning("device %s does not answer", self.config.key)
        self.is_online = False
        self._wait_longer()
        self.close()

    def check_link(self) -> None:
        """Ask who answers after a halt or a failure; a silent device is offline."""
        if not self.is_online:
            return
        try:
            with _border(self.config.key):
                self.driver.identify()
        except LabError:
            self.lose_link()

    def close(self) -> None:
        """Let go of the line."""
        try:
            with _border(self.config.key):
                self.driver.close()
        except LabError:
            log.warning("device %s: its line did not close cleanly", self.config.key)

    def read(self, status: str) -> Any:  # noqa: ANN401 - any JSON value
        """Ask the device for one status.

        Raises:
            NotFoundError: It has no such status.
            DeviceError: It did not answer.
        """
        with _border(self.config.key):
            return read_status(self.driver, status)

    def picture(self, sha256: str) -> bytes | None:
        """Return a picture that the device took lately, or None."""
        with _border(self.config.key):
            return self.driver.picture(sha256)

    def act(self, action: str, args: dict[str, Any], action_id: str = "") -> Report:
        """Carry out one action. The only place where a device is made to move.

        Its id is told to the driver, which may give it on: a cluster names its job by it.

        Raises:
            LabError: It failed; the effect says what may have happened to matter.
        """
        self.driver.action_id = action_id
        self.acting = action
        try:
            return call_action(self.driver, action, args)
        finally:
            self.acting = ""

    def has_action(self, action: str) -> bool:
        """Say whether the driver offers an action of that name."""
        spec = self.driver.spec
        return spec is not None and any(one.name == action for one in spec.actions)

    def stop(self) -> None:
        """Bring the device to its safe state.

        A halt that cannot be delivered is logged, and delivered once the device is reached
        again, unless it may act by then.
        """
        self.owes_halt = False
        try:
            with _border(self.config.key):
                self.driver.stop()
        except LabError as error:
            self.owes_halt = True
            log.warning("device %s could not be halted: %s", self.config.key, error)

    def halt(self) -> None:
        """Tell the device to come to its safe state; it may act again at once.

        Raises:
            LabError: The word could not be delivered.
        """
        with _border(self.config.key):
            self.driver.halt()

    def clear_stop(self) -> None:
        """Allow actions again. A halt that is owed still has to be written down before."""
        self.owes_halt = False
        self.driver.clear_stop()

    def _wait_longer(self) -> None:
        self._next_try_s = self._clock.monotonic_s() + self._retry_s
        self._retry_s = min(self._retry_s * 2, LONGEST_RETRY_S)
