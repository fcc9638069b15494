"""When a disk has too little room, and what is said of it."""

import pytest

from labweb.domain.disk_space import DiskRoomLevel, DiskSpace, Floors, check_room

GB = 10**9
FLOORS = Floors(warn_bytes=1.0 * GB, warn_ratio=0.05, floor_bytes=0.2 * GB)


def a_disk(free_gb: float, total_gb: float = 10.0, *, is_read_only: bool = False) -> DiskSpace:
    return DiskSpace(
        name="Host 1",
        free_bytes=round(free_gb * GB),
        total_bytes=round(total_gb * GB),
        is_read_only=is_read_only,
    )


@pytest.mark.parametrize(
    ("free_gb", "total_gb", "level"),
    [
        (1.0, 10.0, DiskRoomLevel.OK),
        (0.999, 10.0, DiskRoomLevel.LOW),
        (0.2, 10.0, DiskRoomLevel.LOW),
        (0.199, 10.0, DiskRoomLevel.FULL),
        (4.9, 100.0, DiskRoomLevel.LOW),  # under a twentieth
        (5.0, 100.0, DiskRoomLevel.OK),
        (10.0, 2000.0, DiskRoomLevel.LOW),  # a twentieth of a large disk counts up to 10 GiB
        (11.0, 2000.0, DiskRoomLevel.OK),
        (1.0, 0.0, DiskRoomLevel.OK),  # nobody knows how large it is
    ],
)
def test_a_disk_is_low_by_bytes_or_by_share_and_full_below_the_floor(
    free_gb: float, total_gb: float, level: DiskRoomLevel
) -> None:
    assert a_disk(free_gb, total_gb).level(FLOORS) is level


def test_what_is_left_and_what_follows_is_said() -> None:
    low = a_disk(0.6)
    assert low.headline() == "The disk of Host 1 has 0.6 GB left"
    assert low.consequence(FLOORS).startswith("Runs are not started below 0.2 GB. Free some space")
    assert a_disk(0.05).headline() == "The disk of Host 1 has 50 MB left"
    assert a_disk(0.05).consequence(FLOORS).startswith("No run is started below 0.2 GB.")


def test_a_disk_that_can_only_be_read_is_full_however_much_is_free() -> None:
    broken = a_disk(9.0, is_read_only=True)
    assert broken.level(FLOORS) is DiskRoomLevel.FULL
    assert broken.headline() == "The disk of Host 1 can only be read"
    assert "No run is started" in broken.consequence(FLOORS)


def test_only_full_disks_keep_a_run_from_being_started() -> None:
    found = check_room([a_disk(5.0), a_disk(0.6), a_disk(0.1)], FLOORS)
    assert [one.code for one in found] == ["run.disk_full"]
    assert "no run is started below 0.2 GB" in found[0].message
