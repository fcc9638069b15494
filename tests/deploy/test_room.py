"""The terminal warns of a disk by the levels by which the page does."""

from pathlib import Path

import pytest

from deploy.embedded import room
from deploy.embedded.room import DiskRoom
from labweb.domain.disk_space import DiskRoomLevel, DiskSpace, Floors

MIB = 2**20
HERE = Path("/data")


@pytest.mark.parametrize("total_mib", [1_000, 20_000, 400_000, 2_000_000])
@pytest.mark.parametrize("free_mib", [0, 199, 200, 999, 1_023, 1_024, 10_239, 10_240, 19_999])
def test_the_terminal_and_the_page_warn_alike(free_mib: int, total_mib: int) -> None:
    free, total = free_mib * MIB, total_mib * MIB
    level = DiskSpace(name="x", free_bytes=free, total_bytes=total).level(Floors())
    said = room.warning(HERE, DiskRoom(free, total), {})
    assert bool(said) is (level is not DiskRoomLevel.OK)
    assert ("no run is started" in said) is (level is DiskRoomLevel.FULL)


def test_the_levels_are_set_in_the_environment() -> None:
    found = DiskRoom(60 * MIB, 1_000 * MIB)
    assert "0.2 GB" in room.warning(HERE, found, {})
    calm = {room.WARN_MB: "50", room.WARN_PERCENT: "1", room.FLOOR_MB: "10"}
    assert room.warning(HERE, found, calm) == ""
    calm[room.FLOOR_MB] = "70"
    assert "no run is started below 73 MB" in room.warning(HERE, found, calm)


def test_a_disk_that_can_only_be_read_is_told_of() -> None:
    assert "can only be read" in room.warning(HERE, DiskRoom(10**12, 10**12, is_read_only=True), {})
