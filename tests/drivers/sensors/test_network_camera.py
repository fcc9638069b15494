"""A network camera over its real wire, with a bench that draws what stands on it."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from drivers.load import call_action, load_driver, read_spec, read_status
from drivers.sensors import network_camera
from drivers.sensors._sight import look_at, open_picture
from drivers.sensors.network_camera import NetworkCamera, decode_picture
from drivers.transports.http import HttpReply
from drivers.transports.urls import make_transport
from fixtures.instruments.sensors.photograph import drawn, exposed
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)
from tests.fixtures.hand_bench import a_document, a_vessel
from tests.fixtures.running import Process, until

MODULE = "drivers.sensors.network_camera"
SHELF: dict[str, Any] = {"place_tag": "shelf", "width_ratio": 0.5, "max_age_s": 0.5}
BENCH: dict[str, Any] = {**SHELF, "place_tag": "bench", "left_ratio": 0.5}
Make = Callable[..., NetworkCamera]
STREAM = "multipart/x-mixed-replace; boundary=frame"


@pytest.fixture(scope="module")
def process() -> Iterator[Process]:
    with TemporaryDirectory(prefix="lw") as name:
        folder = Path(name)
        camera = {
            "id": "eye",
            "model": "network_camera",
            "endpoint": "tcp:127.0.0.1:0",
            "settings": {"places": "shelf;bench", "tells_time": True},
        }
        vial = a_vessel("vial", 1000.0) | {"place": "shelf", "tag": "VIAL-7"}
        (folder / "bench.json").write_text(json.dumps(a_document(camera, vessels=[vial])))
        process = Process(folder)
        process.start("--speed", "1")
        yield process
        process.stop()


@pytest.fixture
def camera(process: Process, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    """Make connected cameras, and cure what a test did to the simulated one."""
    monkeypatch.setattr(network_camera, "ANSWER_S", 1.0)
    made: list[NetworkCamera] = []

    def make(**config: object) -> NetworkCamera:
        spec = read_spec(MODULE)
        url = f"http://127.0.0.1:{process.port_of('eye')}"
        driver = load_driver(
            MODULE, spec.class_name, spec.digest, make_transport(url), {**SHELF, **config}
        )
        assert isinstance(driver, NetworkCamera)
        made.append(driver)
        driver.connect()
        return driver

    yield make
    process.call("DELETE", "/instruments/eye/faults")
    until(lambda: bool(process.get("/instruments/eye")["plugged"]))
    for driver in made:
        driver.close()


def inflict(process: Process, fault: str, **options: object) -> None:
    status, answer = process.call("POST", "/instruments/eye/faults", {"fault": fault, **options})
    assert status == 201, answer


def test_a_vessel_is_seen_with_its_tag_and_the_picture_is_at_hand(camera: Make) -> None:
    eye = camera()
    seen = call_action(eye, "look", {}).evidence["sighting"]
    assert (seen["is_present"], seen["tag"], seen["media_type"]) == (True, "VIAL-7", "image/jpeg")
    assert seen["tag_confidence_ratio"] >= 0.9
    assert seen["presence_confidence_ratio"] >= 0.9
    picture = eye.picture(seen["image_sha256"])
    assert picture is not None
    assert hashlib.sha256(picture).hexdigest() == seen["image_sha256"]
    assert (eye.is_present(), eye.tag()) == (True, "VIAL-7")


def test_an_empty_place_is_seen_by_its_own_tag(process: Process) -> None:
    spec = read_spec(MODULE)
    url = f"http://127.0.0.1:{process.port_of('eye')}"
    eye = load_driver(MODULE, spec.class_name, spec.digest, make_transport(url), BENCH)
    eye.connect()
    try:
        seen = read_status(eye, "sighting")
        assert (seen["is_present"], seen["tag"]) == (False, "")
        assert seen["presence_confidence_ratio"] >= 0.9
    finally:
        eye.close()


def test_a_stream_gives_its_first_whole_picture(camera: Make) -> None:
    assert camera(path="/video.mjpg").sighting()["tag"] == "VIAL-7"


@pytest.mark.parametrize(
    ("fault", "options"),
    [("dark", {"ratio": 0.1}), ("dark", {}), ("blurred", {"radius_px": 4.0}), ("blurred", {})],
)
def test_a_poor_picture_is_not_sure(
    process: Process, camera: Make, fault: str, options: dict[str, float]
) -> None:
    eye = camera()
    inflict(process, fault, **options)
    seen = eye.sighting()
    assert seen["tag_confidence_ratio"] < 0.8
    assert seen["presence_confidence_ratio"] < 0.8
    assert seen["is_present"] is not False, "seeing nothing is not seeing that nothing is there"


@pytest.mark.parametrize(
    ("fault", "options", "error"),
    [
        ("no_answer", {}, DeviceTimeoutError),
        ("slow_reply", {"delay_s": 30.0}, DeviceTimeoutError),
        ("power_loss", {"for_s": 30.0}, DeviceTimeoutError),
        ("unplug", {}, UnreachableError),
        ("garbled", {"mode": "truncate"}, DeviceTimeoutError),
        ("busy", {}, RejectedError),
        ("truncated", {}, FrameError),
        ("wrong_type", {}, FrameError),
        ("oversized", {}, FrameError),
        ("frozen", {}, FrameError),
    ],
)
def test_a_camera_that_fails_tells_nothing(
    process: Process, camera: Make, fault: str, options: dict[str, Any], error: type[DeviceError]
) -> None:
    eye = camera()
    eye.sighting()
    inflict(process, fault, **options)
    with pytest.raises(error) as caught:
        call_action(eye, "look", {})
    assert caught.value.effect is Effect.NONE
    with pytest.raises(error):
        read_status(eye, "sighting")
    process.call("DELETE", "/instruments/eye/faults")
    until(lambda: bool(process.get("/instruments/eye")["plugged"]))
    assert eye.sighting()["tag"] == "VIAL-7", "it goes on once the fault is gone"


def test_a_picture_that_stands_still_is_told_by_a_camera_without_a_clock(
    process: Process, camera: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network_camera, "_check_age", lambda _reply, _age: None)
    eye = camera()
    eye.sighting()
    inflict(process, "frozen")
    with pytest.raises(FrameError, match="stood still"):
        eye.sighting()


def test_what_trickles_in_for_ever_is_cut_off(camera: Make, process: Process) -> None:
    eye = camera()
    inflict(process, "slow_reply", delay_s=30.0)
    began_s = time.monotonic()
    with pytest.raises(DeviceTimeoutError):
        eye.sighting()
    assert time.monotonic() - began_s < 3.0


@pytest.mark.parametrize("config", [{"path": "snapshot.jpg"}, {"place_tag": " "}])
def test_settings_that_name_nothing_are_refused(camera: Make, config: dict[str, str]) -> None:
    with pytest.raises(DefinitionError):
        camera(**config)


def a_reply(body: bytes, sort: str, **headers: str) -> HttpReply:
    return HttpReply(200, {"content-type": sort, **headers}, body)


@pytest.mark.parametrize(
    "reply",
    [
        a_reply(b"", "image/jpeg"),
        a_reply(b"x", ""),
        a_reply(b"x", "image/png"),
        a_reply(b"x" * (network_camera.MOST_BYTES + 1), "image/jpeg"),
        a_reply(b"--frame\r\n", STREAM),
        a_reply(b"--frame\r\nContent-Type: text/html\r\nContent-Length: 1\r\n\r\nx", STREAM),
        a_reply(b"--frame\r\nContent-Length: 9\r\n\r\nx", STREAM),
        a_reply(b"x", "multipart/x-mixed-replace"),
        a_reply(b"x", "image/jpeg", **{"date": "now", "last-modified": "then"}),
    ],
)
def test_a_reply_that_holds_no_picture_is_refused(reply: HttpReply) -> None:
    with pytest.raises(FrameError):
        decode_picture(reply, 2.0)


def test_a_part_without_a_length_ends_at_the_next_boundary() -> None:
    body = b"--frame\r\nContent-Type: image/jpeg\r\n\r\nabc\r\n--frame\r\n"
    assert decode_picture(a_reply(body, STREAM), 2.0) == b"abc"


def test_two_vessels_or_a_vessel_beside_its_places_tag_are_not_told_apart() -> None:
    picture = open_picture(exposed(drawn(["a", "b"], {"a": "V-1", "b": "V-2"})))
    both = look_at(picture, (0.0, 0.0, 1.0, 1.0), "a")
    assert (both.is_present, both.tag, both.tag_confidence_ratio) == (True, None, 0.0)
    picture = open_picture(exposed(drawn(["a", "b"], {"a": "V-1"})))
    beside = look_at(picture, (0.0, 0.0, 1.0, 1.0), "b")
    assert (beside.is_present, beside.presence_confidence_ratio) == (None, 0.0)


def test_a_vessel_without_a_tag_is_not_told_from_a_place_in_the_dark() -> None:
    picture = open_picture(exposed(drawn(["a"], {"a": None})))
    seen = look_at(picture, (0.0, 0.0, 1.0, 1.0), "a")
    assert (seen.is_present, seen.tag) == (None, None)
