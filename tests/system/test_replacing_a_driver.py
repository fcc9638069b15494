"""Ten pumps work behind five serial lines while their driver is replaced and rolled back."""

from __future__ import annotations

import logging
import shutil
import tempfile
import time
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import pytest

from tests.labs import lab_of_pumps
from tests.system.replacing import COUNT, LINES_COUNT, Deed, Versions, Work, deeds, told
from tests.system.stack import Stack, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

VOLUME_ML = 2
SPEED = 5.0
SLOW = {0: "1 mL/min"}
"""At this one pump acts for 24 s, half of which is longer than a version takes to be ready."""


@pytest.fixture
def stack() -> Iterator[Stack]:
    """Start a lab of ten pumps."""
    logging.getLogger("httpx").setLevel(logging.WARNING)
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        (folder / "lab.json").write_bytes(lab_of_pumps(COUNT, lines_count=LINES_COUNT))
        with running(folder / "data", lab=folder / "lab.json", speed=SPEED) as lab:
            yield lab
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def test_ten_pumps_fail_nothing_while_their_driver_is_replaced_refused_and_rolled_back(
    stack: Stack,
) -> None:
    versions = Versions(stack)
    first = versions.present()
    work = Work(stack, f"{VOLUME_ML} mL", SLOW)
    work.until(lambda: len({one.device for one in deeds(stack)}) == COUNT)
    second, _ = versions.bring(lambda text: f"{text}\n# second\n")
    work.until(lambda: any(work.numbers[one.device] in SLOW for one in _fresh(deeds(stack))))
    versions.give(second["id"])
    work.until(lambda: versions.all_have(second["id"]))
    work.until(lambda: _latest(deeds(stack)) == {second["digest"]})
    third, _ = versions.bring(_that_cannot_be_built)
    victim = versions.ids[0]
    versions.give(third["id"], [victim])
    work.until(lambda: versions.of_devices()[victim]["problem"])
    assert versions.of_devices()[victim]["version_id"] == second["id"]
    versions.give(first["id"])
    work.until(lambda: versions.all_have(first["id"]))
    work.until(lambda: _latest(deeds(stack)) == {first["digest"]})
    count = work.end()
    found = deeds(stack)
    assert len(found) == len({one.action_id for one in found}) == count, "each job began once"
    _assert_drained(found, [first["digest"], second["digest"], first["digest"]])
    assert _overlapping(found, told(stack, "driver_ready", second["digest"]))
    really = stack.volumes_ul()
    for device, number in work.numbers.items():
        moved_ul = VOLUME_ML * 1000 * len(work.runs[device])
        assert really[f"flask_{number}"] == pytest.approx(moved_ul, rel=0.002)


def _fresh(found: list[Deed]) -> list[Deed]:
    """Return what is under way and has at most half of the slow pump's time behind it."""
    return [one for one in found if not one.end and time.time() - one.began_at_s < 12]


def _that_cannot_be_built(text: str) -> str:
    head, _, rest = text.partition("class TricontinentC3000")
    return f"{head}NOTHING = [][1]\n\n\nclass TricontinentC3000{rest}"


def _latest(found: list[Deed]) -> set[str]:
    """Return the versions on which the devices began their last actions."""
    return set({one.device: one.digest for one in found}.values())


def _overlapping(found: list[Deed], ready_at_s: dict[str, float]) -> list[Deed]:
    """Return what was under way on the version before when the next one was ready."""
    return [
        one for one in found if one.began_at_s < ready_at_s[one.device] < (one.ended_at_s or 0.0)
    ]


def _assert_drained(found: list[Deed], expected: list[str]) -> None:
    """Each device went from version to version once, and ended what it did before it did."""
    assert {one.end for one in found} == {"complete"}
    for device in {one.device for one in found}:
        own = [one for one in found if one.device == device]
        assert [digest for digest, _ in groupby(own, key=lambda one: one.digest)] == expected
        ends = [one.ended_at_s or 0.0 for one in own]
        assert all(end <= after.began_at_s for end, after in zip(ends, own[1:], strict=False))
