"""Ten devices work while their driver is replaced, fails to build, and is rolled back."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from uuid import UUID, uuid5

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.crutd.operations import Read, to_json
from labweb.domain.enrollment.driver_bundle import digest_of, encode_bundle
from labweb.domain.messages.devices_and_drivers import DeviceConfig, DevicesFrame, WantDriver
from tests.workers.bench import SPACE, Server, a_device, a_do, until
from tests.workers.host.test_host import Running
from tests.workers.hub import Hub
from tests.workers.line.test_driver_store import TIMER, parts, version
from workers.base.host_key import create_key

LINES = ("virtual:a", "virtual:b", "virtual:c")
COUNT = 10
WORK_S = 0.3
ENDS = ("complete", "aborted", "in_doubt", "rejected", "stopped", "refused")


def a_timer(number: int) -> DeviceConfig:
    return a_device(
        LINES[number % len(LINES)],
        id=uuid5(SPACE, f"timer {number}"),
        key=f"timer_{number}",
        module=TIMER,
        class_name="HostTimer",
        digest=read_spec(TIMER).digest,
        config={},
        statuses={},
    )


class Lab:
    """The server of ten timers: each gets its next job the moment that it has done one."""

    def __init__(self, running: Running) -> None:
        self.running = running
        self.hub = running.hub
        self.devices = {device.id: device for device in self.hub.devices}
        self.sources: dict[str, dict[str, str]] = {}
        self.staged: dict[UUID, DeviceConfig] = {}
        self.jobs: dict[UUID, UUID] = {}
        self.given: set[int] = set()
        self.read_seq = 0
        self.read_frames = 0

    def bring(self, modules: dict[str, str]) -> str:
        digest = digest_of(modules)
        self.sources[digest] = modules
        return digest

    def tell(self, staged: list[DeviceConfig]) -> None:
        self.hub.devices = list(self.devices.values())
        epoch = self.hub.server.epoch
        self.hub.send(DevicesFrame(epoch=epoch, devices=self.hub.devices, staged=staged))

    def send_job(self, device: DeviceConfig) -> None:
        do = a_do(
            self.hub.server,
            device_id=device.id,
            driver_digest=self.devices[device.id].digest,
            action="wait",
            args={"duration_s": WORK_S},
            operation=to_json(Read(device_id=device.id)),
            resources=[],
        )
        self.jobs[do.action_id] = device.id
        self.hub.nudge(self.hub.server.sign(do))

    def turn(self) -> None:
        """Answer what came: sources that are asked for, and devices that are idle again."""
        frames = self.hub.frames[self.read_frames :]
        self.read_frames += len(frames)
        for frame in frames:
            if isinstance(frame, WantDriver):
                for part in parts(
                    self.hub.server,
                    encode_bundle(self.sources[frame.digest]),
                    frame.digest,
                    size=128 * 1024,
                ):
                    self.hub.send(part)
        while self.read_seq < self.hub.acked:
            self.read_seq += 1
            event = self.hub.events[self.read_seq]
            if event.kind == "complete" and event.action_id is not None:
                device_id = self.jobs[event.action_id]
                self.switch_idle(device_id)
                self.send_job(self.devices[device_id])

    def switch_idle(self, device_id: UUID) -> None:
        """Switch a device whose next version is ready; it acts no more, as the server has it."""
        waiting = self.staged.get(device_id)
        if waiting and str(device_id) in self.told("driver_ready", waiting.digest):
            self.devices[device_id] = self.staged.pop(device_id)
            self.tell(list(self.staged.values()))

    def until(self, condition: object, within_s: float = 90.0) -> float:
        assert callable(condition)
        began_s = time.monotonic()
        while not condition():
            assert time.monotonic() - began_s < within_s, self.summary()
            self.turn()
            time.sleep(0.02)
        return time.monotonic() - began_s

    def summary(self) -> str:
        refused = [
            one.body for one in list(self.hub.events.values()) if one.kind == "driver_refused"
        ]
        return f"{Counter(self.hub.kinds)} {refused[:2]}"

    def told(self, kind: str, digest: str) -> set[str]:
        return {
            str(one.body["device_id"])
            for one in list(self.hub.events.values())
            if one.kind == kind and one.body.get("digest") == digest
        }

    def done_on(self, digest: str) -> set[UUID]:
        """Devices that have completed a job on this version."""
        started = self.digests()
        return {
            self.jobs[one.action_id]
            for one in list(self.hub.events.values())
            if one.kind == "complete" and one.action_id and started[one.action_id] == digest
        }

    def digests(self) -> dict[UUID, str]:
        return {
            one.action_id: str(one.body["driver_digest"])
            for one in list(self.hub.events.values())
            if one.kind == "started" and one.action_id
        }

    def latest(self) -> dict[UUID, str]:
        """The version on which each device began its last job."""
        started = self.digests()
        return {self.jobs[action_id]: digest for action_id, digest in started.items()}

    def replace(self, digest: str) -> float:
        """Stage a version on every device and switch each that is ready, while jobs run."""
        began_s = time.monotonic()
        self.staged = {
            device_id: msgspec.structs.replace(device, digest=digest)
            for device_id, device in self.devices.items()
        }
        everybody = {str(one) for one in self.staged}
        self.tell(list(self.staged.values()))
        self.until(lambda: self.told("driver_ready", digest) & everybody)
        first_s = time.monotonic() - began_s
        self.until(lambda: not self.staged)
        return first_s


@pytest.fixture
def lab(valkey_socket: Path) -> Iterator[Lab]:
    with tempfile.TemporaryDirectory(prefix="rd") as name:
        folder = Path(name)
        key = create_key(folder / "host.key")
        hub = Hub(Server(), [a_timer(number) for number in range(COUNT)], key.public_base64)
        broker = f"redis+socket://{valkey_socket}?virtual_host=4"
        with hub.open():
            running = Running(folder, broker, hub, folder / "host.key")
            running.start()
            try:
                yield Lab(running)
            finally:
                running.stop()
                sys.stdout.write(running.log.read_text()[-6000:])


@pytest.mark.timeout(400)
def test_ten_devices_work_on_while_their_driver_is_replaced_refused_and_rolled_back(
    lab: Lab,
) -> None:
    first = read_spec(TIMER).digest
    everybody = set(lab.devices)
    until(lambda: lab.hub.heartbeats, within_s=60)
    lab.until(lambda: len(lab.hub.heartbeats[-1].lines) == len(LINES))
    for device in lab.devices.values():
        lab.send_job(device)
    lab.until(lambda: lab.done_on(first) == everybody)
    second = lab.bring(version("second"))
    took_s = lab.replace(second)
    swapped_s = lab.until(lambda: lab.done_on(second) == everybody)
    assert len(lab.told("driver_serving", second)) == COUNT
    sys.stdout.write(f"staged to ready: {took_s:.2f} s; all ten at work: {swapped_s:.2f} s more\n")
    broken = version("third")
    broken[TIMER] = (
        broken[TIMER]
        .replace("STEP", "")
        .replace("class HostTimer", "NOTHING = [][1]\n\n\nclass HostTimer")
    )
    third = lab.bring(broken)
    victim = next(iter(lab.devices.values()))
    lab.tell([msgspec.structs.replace(victim, digest=third)])
    lab.until(lambda: lab.told("driver_refused", third))
    lab.tell([])
    refused = next(one for one in list(lab.hub.events.values()) if one.kind == "driver_refused")
    assert refused.body["code"] == "driver.import"
    assert "IndexError" in refused.body["message"]
    before = len(lab.digests())
    lab.until(lambda: len(lab.digests()) > before + COUNT)
    lab.replace(first)
    lab.until(lambda: set(lab.latest().values()) == {first})
    _assert_nothing_failed(lab, [first, second, first])


def _assert_nothing_failed(lab: Lab, expected: list[str]) -> None:
    ends = Counter(kind for kind in lab.hub.kinds if kind in ENDS)
    assert set(ends) == {"complete"}, ends
    started = [one for _, one in sorted(lab.hub.events.items()) if one.kind == "started"]
    assert len(started) == len({one.action_id for one in started}), "nothing began twice"
    for device_id in lab.devices:
        digests = [
            str(one.body["driver_digest"])
            for one in started
            if one.action_id and lab.jobs[one.action_id] == device_id
        ]
        changes = [one for one, prev in zip(digests, [None, *digests], strict=False) if one != prev]
        assert changes == expected, f"each drains before the next begins: {changes}"
    sys.stdout.write(f"{ends['complete']} jobs on {COUNT} devices, none failed\n")
