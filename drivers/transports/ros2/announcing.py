"""Announcements of devices over DDS: one topic, `/labweb/beacon`, of plain text.

A ROS 2 node or any other DDS participant announces a device with a `std_msgs/msg/String`. What
comes is text of a stranger: it is bounded here, and read by whoever listens.

Source:
    OMG, DDS 1.4, 2.2.2.5 (samples and the handle of who published them); a string bound as in
    OMG, DDS-XTypes 1.3, 7.2.4: a longer one does not come through.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from drivers.transports.ros2.bus import Bus, Publisher
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.types import Types

TOPIC = "/labweb/beacon"
MESSAGE = "std_msgs/msg/String"


class Announcements:
    """One place in a domain at which announcements are told and heard."""

    def __init__(self, settings: LinkSettings, longest_bytes: int) -> None:
        """Say where, and how long an announcement may be; nothing is opened yet."""
        text = {MESSAGE: f"string<={longest_bytes} data"}
        self._bus = Bus(settings, Types(Definitions(text)))
        self._publisher: Publisher | None = None

    def listen(self, heard: Callable[[bytes, str], None]) -> None:
        """Listen from now on; `heard` gets a text, and who published it, on another thread."""

        def take(value: Mapping[str, object], sender: str) -> None:
            heard(str(value["data"]).encode(), sender)

        self._bus.subscribe_from(TOPIC, MESSAGE, take)

    def say(self, text: bytes) -> None:
        """Announce.

        Raises:
            DefinitionError: The text is too long, or none.
        """
        if self._publisher is None:
            self._publisher = self._bus.publisher(TOPIC, MESSAGE)
        self._publisher.publish({"data": text.decode()})

    @property
    def listener_count(self) -> int:
        """Return how many hear what is said here."""
        return 0 if self._publisher is None else self._publisher.listener_count

    def close(self) -> None:
        """Leave the domain."""
        self._bus.close()
