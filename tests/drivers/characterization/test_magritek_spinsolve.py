"""The spectrometer over TCP, against a peer that answers by the table of its messages."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError
from drivers.characterization import magritek_spinsolve
from drivers.characterization._spinsolve import decode_messages, encode_message
from drivers.characterization.magritek_spinsolve import MagritekSpinsolve
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DeviceError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.wire import answering

RUN: dict[str, Any] = {
    "sample": "a1",
    "solvent": "CDCl3",
    "scan_count": 4,
    "acquisition_s": 3.2,
    "repetition_s": 10.0,
    "pulse_angle_deg": 90.0,
}


def told(*bodies: str) -> bytes:
    return b"".join(
        encode_message(f'<StatusNotification timestamp="11:21:49">{body}</StatusNotification>')
        for body in bodies
    )


RUNNING = '<State protocol="1D EXTENDED+" status="Running" dataFolder=""/>'
PROGRESS = '<Progress protocol="1D EXTENDED+" percentage="40" secondsRemaining="9"/>'
READY = '<State protocol="1D EXTENDED+" status="Ready" dataFolder="/data/a1"/>'
DONE = '<Completed protocol="1D EXTENDED+" completed="true" successful="true"/>'
STOPPING = '<State protocol="1D EXTENDED+" status="Stopping" dataFolder=""/>'
ENDED = '<Completed protocol="1D EXTENDED+" completed="false" successful="false"/>'
SHIMMED = (
    '<QuickShimResponse error=""><LineWidth>{}</LineWidth><BaseWidth>9.5</BaseWidth>'
    "<SystemIsReady>{}</SystemIsReady></QuickShimResponse>"
)


class Peer:
    """Answers as the table says; `start` is what a start brings, None hangs up."""

    def __init__(self, start: bytes | None = None, *, connected: str = "true") -> None:
        self.start = start
        self.connected = connected
        self.kept: dict[str, str] = {}
        self.takes = True
        self.ending = b""
        """What an abort brings."""

        self.asked = ""

    def __call__(self, request: bytes) -> bytes | None:
        self.asked += request.decode()
        reply = b""
        for body in re.findall(r"<Message>(.*?)</Message>", request.decode()):
            part = self.answer(body)
            if part is None:
                return None
            reply += part
        return reply

    def answer(self, body: str) -> bytes | None:
        if body.startswith("<HardwareRequest"):
            return encode_message(
                f"<HardwareResponse><ConnectedToHardware>{self.connected}</ConnectedToHardware>"
                "<SpinsolveType>Spinsolve 80</SpinsolveType></HardwareResponse>"
            )
        if found := re.match(r"<Set><(\w+)>(.*?)</", body):
            self.kept[found[1]] = found[2] if self.takes else "another"
            return b""
        if found := re.match(r"<GetRequest><(\w+)/>", body):
            name = found[1]
            return told(PROGRESS) + encode_message(
                f"<GetResponse><{name}>{self.kept[name]}</{name}></GetResponse>"
            )
        if body.startswith("<Estimate"):
            return encode_message('<EstimateDurationResponse durationInSeconds="45" error=""/>')
        return self.ending if body == "<Abort/>" else self.start


Start = Callable[[Peer], MagritekSpinsolve]


@pytest.fixture
def start() -> Iterator[Start]:
    with ExitStack() as stack:

        def run(peer: Peer) -> MagritekSpinsolve:
            port = stack.enter_context(answering(peer))
            device = MagritekSpinsolve(
                cast("ByteTransport", make_transport(f"tcp://127.0.0.1:{port}")),
                {"silence_limit_s": 0.5},
            )
            device.connect()
            stack.callback(device.close)
            return device

        yield run


def test_a_measurement_ends_with_the_folder_of_its_files(start: Start) -> None:
    peer = Peer(told(RUNNING, PROGRESS, READY, DONE))
    device = start(peer)
    assert device.measure(**RUN).evidence["data_folder"] == "/data/a1"
    assert peer.kept == {"Sample": "a1", "Solvent": "CDCl3"}
    assert '<Option name="RepetitionTime" value="10"/>' in peer.asked
    assert (device.progress_ratio(), device.is_measuring()) == (0.4, False)


@pytest.mark.parametrize(
    "change",
    [
        {"scan_count": 3},
        {"acquisition_s": 1.0},
        {"repetition_s": 2.0},
        {"pulse_angle_deg": 91.0},
        {"sample": ""},
        {"sample": "a<b"},
    ],
)
def test_what_the_spectrometer_does_not_have_starts_nothing(
    start: Start, change: dict[str, Any]
) -> None:
    peer = Peer(told(RUNNING, READY, DONE))
    with pytest.raises(PreconditionError):
        start(peer).measure(**{**RUN, **change})
    assert "<Start" not in peer.asked


def test_a_busy_spectrometer_refuses_without_effect(start: Start) -> None:
    busy = told('<Error protocol="1D EXTENDED+" error="Instrument is busy"/>')
    with pytest.raises(RejectedError, match="busy") as caught:
        start(Peer(busy)).measure(**RUN)
    assert caught.value.effect is Effect.NONE


def test_a_sample_name_that_was_not_taken_starts_nothing(start: Start) -> None:
    peer = Peer(told(RUNNING, READY, DONE))
    peer.takes = False
    with pytest.raises(RejectedError, match="after writing") as caught:
        start(peer).measure(**RUN)
    assert caught.value.effect is Effect.NONE
    assert "<Start" not in peer.asked


def test_a_cable_that_is_out_starts_nothing(start: Start) -> None:
    peer = Peer(told(RUNNING, READY, DONE), connected="false")
    with pytest.raises(RejectedError, match="not connected"):
        start(peer).measure(**RUN)
    assert "<Start" not in peer.asked


@pytest.mark.parametrize("last", [ENDED, '<Error protocol="1D EXTENDED+" error="broken"/>'])
def test_a_measurement_that_failed_halfway_has_no_folder(start: Start, last: str) -> None:
    with pytest.raises(DeviceError) as caught:
        start(Peer(told(RUNNING, PROGRESS, last))).measure(**RUN)
    assert caught.value.effect is Effect.PARTIAL


@pytest.mark.parametrize("brought", [told(RUNNING, PROGRESS), None, told(RUNNING)[:-5]])
def test_silence_power_loss_or_half_a_document_is_unknown(
    start: Start, brought: bytes | None
) -> None:
    peer = Peer(brought)
    with pytest.raises(DeviceError) as caught:
        start(peer).measure(**RUN)
    assert caught.value.effect is Effect.UNKNOWN
    assert peer.asked.count("<Start") == 1


def test_a_measurement_without_a_folder_is_not_taken(start: Start) -> None:
    with pytest.raises(FrameError, match="names no folder"):
        start(Peer(told(RUNNING, READY.replace("/data/a1", ""), DONE))).measure(**RUN)


def test_a_stop_aborts_what_is_measured_and_waits_until_all_is_over(start: Start) -> None:
    peer = Peer(told(RUNNING))
    peer.ending = told(STOPPING, ENDED)
    device = start(peer)
    timer = threading.Timer(0.15, device.stop)
    timer.start()
    with pytest.raises(DeviceStoppedError, match="nothing of it is stored") as caught:
        device.measure(**RUN)
    timer.join()
    assert caught.value.effect is Effect.PARTIAL
    assert "<Abort/>" in peer.asked


def test_a_stop_whose_end_is_not_told_is_unknown(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(magritek_spinsolve, "ENDED_S", 0.2)
    peer = Peer(told(RUNNING))
    peer.ending = told(STOPPING)
    device = start(peer)
    timer = threading.Timer(0.15, device.stop)
    timer.start()
    with pytest.raises(DeviceStoppedError, match="has not said it ended") as caught:
        device.measure(**RUN)
    timer.join()
    assert caught.value.effect is Effect.UNKNOWN


def test_ending_what_is_measured_waits_until_all_is_over(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(magritek_spinsolve, "STOPPING_S", 0.2)
    monkeypatch.setattr(magritek_spinsolve, "ENDED_S", 0.2)
    peer = Peer()
    device = start(peer)
    assert device.stop_measuring().evidence == {"was_measuring": False}
    peer.ending = told(STOPPING, ENDED)
    assert device.stop_measuring().evidence == {"was_measuring": True}
    peer.ending = told(STOPPING)
    with pytest.raises(DeviceError, match="does not say that it has ended") as caught:
        device.stop_measuring()
    assert caught.value.effect is Effect.UNKNOWN


def test_a_shim_tells_its_lines_and_one_that_does_not_converge_is_told(start: Start) -> None:
    good = told(RUNNING, DONE) + encode_message(SHIMMED.format("0.4", "true"))
    assert start(Peer(good)).shim("quick").evidence["line_width_hz"] == 0.4
    wide = told(RUNNING, DONE) + encode_message(SHIMMED.format("40.0", "false"))
    with pytest.raises(DeviceError) as caught:
        start(Peer(wide)).shim("quick")
    assert caught.value.code == "device.not_reached"


@pytest.mark.parametrize("data", [b"\xff", b"<Message>", b"ok", b"<Message><Message></Message>"])
def test_what_is_no_document_is_refused(data: bytes) -> None:
    with pytest.raises(FrameError):
        decode_messages(data)


def test_a_share_that_is_off_hinders_no_status_and_no_halt_and_nothing_begins() -> None:
    """The computer with the files is off; the spectrometer itself answers."""
    peer = Peer(told(RUNNING, READY, DONE))
    with socket.create_server(("127.0.0.1", 0)) as free:
        off = free.getsockname()[1]
    with answering(peer) as port:
        line = make_transport(f"tcp://127.0.0.1:{port}?share={off}")
        device = MagritekSpinsolve(
            cast("ByteTransport", line), {"silence_limit_s": 0.5, "data_root": "/data"}
        )
        device.connect()
        assert not device.is_measuring()
        with pytest.raises(UnreachableError) as caught:
            device.measure(**RUN)
        assert caught.value.effect is Effect.NONE
        assert "<Start" not in peer.asked
        device.halt()
        ends_s = time.monotonic() + 5
        while "<Abort" not in peer.asked and time.monotonic() < ends_s:
            time.sleep(0.02)
        assert "<Abort" in peer.asked
        device.close()
