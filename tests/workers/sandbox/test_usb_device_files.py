"""A line with a USB instrument reaches the file of that instrument, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.workers.bench import a_device
from tests.workers.sandbox.test_confinement import a_config
from workers.line.line_confinement import bounds_of
from workers.sandbox import address_bounds, usb_device_files
from workers.sandbox.address_bounds import device_files, marks_of

URL = "visa://USB0::0x2A8D::0x1301::MY1::INSTR"


def plug(folder: Path, name: str, serial: str, number: int) -> Path:
    """Lay out a device as the kernel does; returns its device file."""
    device = folder / f"sys/devices/pci0/usb1/{name}"
    device.mkdir(parents=True)
    told = {"idVendor": "2a8d", "idProduct": "1301", "serial": serial, "busnum": "1"}
    for key, value in {**told, "devnum": str(number)}.items():
        (device / key).write_text(f"{value}\n")
    (folder / "sys/bus/usb/devices").mkdir(parents=True, exist_ok=True)
    (folder / f"sys/bus/usb/devices/{name}").symlink_to(device)
    node = folder / f"dev/001/{number:03d}"
    node.parent.mkdir(parents=True, exist_ok=True)
    node.touch()
    return node


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(address_bounds, "BUS", tmp_path / "sys/bus/usb")
    monkeypatch.setattr(usb_device_files, "BUS", tmp_path / "sys/bus/usb")
    monkeypatch.setattr(usb_device_files, "NODES", tmp_path / "dev")
    return tmp_path


def test_only_the_instrument_with_that_serial_number_is_reached(machine: Path) -> None:
    other, own = plug(machine, "1-1", "MY2", 4), plug(machine, "1-2", "MY1", 12)
    found = bounds_of(a_config(machine), "x", [a_device(URL)])
    assert own in found.writable
    assert other not in found.writable
    assert {machine / "sys/bus/usb", machine / "sys/devices/pci0/usb1"} <= set(found.readable)
    assert found.has_interfaces
    assert found.ports == ()


def test_one_that_is_plugged_in_later_or_again_is_noticed(machine: Path) -> None:
    assert device_files([a_device(URL)]) == []
    away = marks_of([a_device(URL)])
    plug(machine, "1-2", "MY1", 12)
    here = marks_of([a_device(URL)])
    (machine / "sys/devices/pci0/usb1/1-2/devnum").write_text("13\n")
    (machine / "dev/001/013").touch()
    assert len({away, here, marks_of([a_device(URL)])}) == 3


def test_a_line_without_usb_learns_nothing_of_it(machine: Path) -> None:
    plug(machine, "1-2", "MY1", 12)
    found = bounds_of(a_config(machine), "x", [a_device("visa://GPIB0::8::INSTR")])
    assert not found.has_interfaces
    assert not any("usb" in str(path) for path in found.readable)
