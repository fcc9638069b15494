"""Where a USB instrument is on this machine: its device file, and what the kernel tells of its bus.

Source:
    Linux, Documentation/ABI/stable/sysfs-bus-usb: idVendor, idProduct, serial, busnum, devnum; the
    device file is /dev/bus/usb/BBB/DDD, both of three digits.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

BUS = Path("/sys/bus/usb")
NODES = Path("/dev/bus/usb")


@dataclass(frozen=True)
class UsbPlace:
    """One instrument that is plugged in."""

    node: Path
    """Its device file."""

    bus: Path
    """What the kernel tells of its bus; only read."""


def places_of(place: str) -> list[UsbPlace]:
    """Find the instrument of a line; none where it is not plugged in, and one in all else.

    Args:
        place: Vendor, product and serial number, as the line has them: `2a8d:1301:MY1`.
    """
    vendor, product, serial = place.split(":", 2)
    found = []
    for folder in sorted((BUS / "devices").glob("*")):
        with suppress(OSError, ValueError):
            told = [(folder / name).read_text("utf-8").strip() for name in _NAMES]
            if told == [vendor, product, serial]:
                numbers = [int((folder / name).read_text()) for name in ("busnum", "devnum")]
                node = NODES.joinpath(*(f"{number:03d}" for number in numbers))
                found.append(UsbPlace(node, _root(folder.resolve(strict=True), numbers[0])))
    return found


_NAMES = ("idVendor", "idProduct", "serial")


def _root(device: Path, number: int) -> Path:
    """Return the folder of the whole bus, where the library looks for the hub before a device."""
    return next((one for one in device.parents if one.name == f"usb{number}"), device)
