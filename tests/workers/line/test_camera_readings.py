"""A camera of another line guards an action and confirms it: which samples and pictures count."""

from __future__ import annotations

import contextlib
import hashlib
import threading
import time
from collections.abc import Iterator
from uuid import uuid4

import pytest

from tests.workers.bench import Host, PumpProcess
from tests.workers.line.test_executor import a_condition, run
from workers.base.valkey_store import StatusSample, ValkeyStore

CAMERA = uuid4()
PICTURE = b"what the camera took"
IMAGE = hashlib.sha256(PICTURE).hexdigest()


def seen(store: ValkeyStore, *, tag: str, confidence: float) -> None:
    """Have a camera of another line tell what it sees."""
    store.put_picture(IMAGE, PICTURE)
    now_s = time.monotonic()
    values = {"tag_text": tag, "confidence_ratio": confidence, "image_sha256": IMAGE}
    store.put(
        "camera", [StatusSample(str(CAMERA), name, 0.0, now_s, v) for name, v in values.items()], 1
    )


@contextlib.contextmanager
def watched(store: ValkeyStore, *, tag: str, confidence: float) -> Iterator[None]:
    """Have a camera of another line look again and again, as it does."""
    is_over = threading.Event()

    def look() -> None:
        while not is_over.wait(0.05):
            seen(store, tag=tag, confidence=confidence)

    seen(store, tag=tag, confidence=confidence)
    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


VISION = a_condition(
    name="camera.tag",
    device_id=CAMERA,
    status="tag_text",
    equals="VIAL-7",
    confidence_status="confidence_ratio",
    min_confidence=0.9,
    image_status="image_sha256",
    is_sensor=True,
)


def test_a_camera_that_sees_the_tag_lets_a_transfer_start_and_keeps_its_image(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    confirm = {**VISION, "timeout_s": 5.0}
    with watched(store, tag="VIAL-7", confidence=0.97):
        action_id = run(host, store, pre=[VISION], post=[confirm])
    assert host.state(action_id) == "complete"
    assert pump.moves == ["A300"]
    body = host.last(action_id)
    assert body["verification"] == "sensed"
    assert body["post"][0]["evidence"]["image_sha256"] == IMAGE
    assert body["post"][0]["evidence"]["confidence"] == 0.97


@pytest.mark.parametrize(("tag", "confidence"), [("VIAL-8", 0.97), ("VIAL-7", 0.6)])
def test_a_camera_that_sees_another_tag_or_is_not_sure_guards_a_transfer(
    host: Host, store: ValkeyStore, pump: PumpProcess, tag: str, confidence: float
) -> None:
    seen(store, tag=tag, confidence=confidence)
    action_id = run(host, store, pre=[VISION])
    assert host.state(action_id) == "rejected"
    assert pump.moves == []


def test_a_picture_from_before_the_act_confirms_nothing(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    seen(store, tag="VIAL-7", confidence=0.97)
    action_id = run(host, store, pre=[VISION], post=[VISION])
    assert host.state(action_id) == "in_doubt"
    assert host.last(action_id)["post"][0]["verdict"] == "unobservable"


def test_what_may_stay_unconfirmed_is_complete_and_says_that_nobody_saw_it(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    action_id = run(host, store, post=[{**VISION, "may_stay_unconfirmed": True}])
    assert host.state(action_id) == "complete"
    body = host.last(action_id)
    assert (body["verification"], body["code"]) == ("unconfirmed", "edge.unconfirmed")
    assert body["message"].startswith("not confirmed: ")
    assert pump.moves == ["A300"]


MASS = a_condition(
    name="balance.mass_arrived",
    device_id=CAMERA,
    status="mass_mg",
    change=100.0,
    tolerance=1.0,
    stable_status="is_stable",
    timeout_s=0.3,
    is_sensor=True,
)


@contextlib.contextmanager
def weighing(store: ValkeyStore, *, is_stable: bool) -> Iterator[None]:
    """Have a balance of another line tell its mass again and again."""
    is_over = threading.Event()

    def tell() -> None:
        while True:
            now_s = time.monotonic()
            values = {"mass_mg": 100.0, "is_stable": is_stable}
            rows = [
                StatusSample(str(CAMERA), name, 0.0, now_s, value) for name, value in values.items()
            ]
            store.put("balance", rows, 1)
            if is_over.wait(0.05):
                return

    thread = threading.Thread(target=tell)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def test_a_balance_that_never_settles_leaves_the_transfer_in_doubt(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    with weighing(store, is_stable=False):
        action_id = run(host, store, post=[MASS])
    assert host.state(action_id) == "in_doubt"
    body = host.last(action_id)
    assert (body["code"], body["message"]) == ("balance.mass_arrived", "mass has not settled")
    assert pump.moves == ["A300"]


def test_a_transfer_is_not_begun_when_its_balance_cannot_be_read(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    action_id = run(host, store, post=[MASS])
    assert host.state(action_id) == "rejected"
    assert "was not begun" in host.last(action_id)["message"]
    assert pump.moves == []
    action_id = run(host, store, post=[{**MASS, "may_stay_unconfirmed": True}], resources=[])
    assert host.state(action_id) == "complete"
    assert host.last(action_id)["verification"] == "unconfirmed"


def test_a_verdict_whose_picture_is_gone_tells_nothing(
    host: Host, store: ValkeyStore, pump: PumpProcess
) -> None:
    now_s = time.monotonic()
    values = {"tag_text": "VIAL-7", "confidence_ratio": 0.97, "image_sha256": "cd" * 32}
    store.put(
        "camera", [StatusSample(str(CAMERA), name, 0.0, now_s, v) for name, v in values.items()], 1
    )
    action_id = run(host, store, pre=[VISION])
    assert host.state(action_id) == "rejected"
    assert pump.moves == []
