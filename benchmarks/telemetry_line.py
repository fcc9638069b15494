"""One line of an edge host with a hundred devices that tell ten statuses ten times a second.

`python -m benchmarks.telemetry_line VALKEY_URL SECONDS IDS_FILE` samples as a line's process does
and prints how many samples it took.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import ClassVar
from uuid import UUID

import msgspec

from drivers.base import Driver, status
from drivers.transports.virtual import VirtualTransport
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base.system_clock import HostClock
from workers.base.valkey_store import ValkeyStore
from workers.line.device_unit import DeviceUnit
from workers.line.status_sampling import Sampler

LINE = "virtual:measured"
STATUSES = tuple(f"level_{number}_c" for number in range(10))
EVERY_S = 0.1


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """Nothing to set."""


class Teller(Driver[VirtualTransport, Config]):
    """A device that computes what it tells."""

    transport_type: ClassVar[type] = VirtualTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Nothing answers."""

    def halt(self) -> None:
        """Nothing moves."""


def _wave(number: int) -> object:
    @status(every_s=EVERY_S)
    def tell(_self: Teller) -> float:
        """A wave of its own period."""
        return 20.0 + 5.0 * math.sin(time.monotonic() / (number + 1))

    return tell


for _number, _name in enumerate(STATUSES):
    setattr(Teller, _name, _wave(_number))


def a_unit(device_id: UUID, number: int, wire: VirtualTransport, clock: HostClock) -> DeviceUnit:
    """Make one device on the line's wire, which all of them share."""
    config = DeviceConfig(
        id=device_id,
        key=f"teller_{number}",
        name=f"Teller {number}",
        module=__name__,
        class_name="Teller",
        digest="",
        transport=LINE,
        config={},
        statuses=dict.fromkeys(STATUSES, EVERY_S),
        nodes={},
    )
    return DeviceUnit(config, Teller(wire, {}), clock)


def main() -> None:
    """Sample for so long, then say how many samples were taken."""
    url, seconds, ids = sys.argv[1], float(sys.argv[2]), json.loads(Path(sys.argv[3]).read_text())
    clock, store = HostClock(), ValkeyStore(url)
    wire = VirtualTransport(LINE)
    units = {UUID(one): a_unit(UUID(one), number, wire, clock) for number, one in enumerate(ids)}
    sampler = Sampler(LINE, units, store, clock)
    sampler.start()
    time.sleep(seconds)
    sampler.stop()
    sys.stdout.write(f"{sampler.taken_count}\n")


if __name__ == "__main__":
    main()
