"""The powder dispenser over TCP, against a peer that answers by the table of its commands."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError
from drivers.processing._quantos import decode_mass, decode_weight
from drivers.processing.mettler_quantos import MettlerQuantos
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DeviceError,
    Effect,
    FrameError,
    LabError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.wire import answering

HEAD = (
    'QRD 2 4 11 B\r\n<Dosing_Head_Data>\r\n<Substance>kcl</Substance>\r\n<Content Unit="mg">'
    '5000.00</Content>\r\n<Rem._quantity Unit="mg">400.00</Rem._quantity>\r\n'
    "</Dosing_Head_Data>\r\nQRD 2 4 11 A\r\n"
)
DOSED = (
    "QRD 2 4 12 B\r\n<Sample_Data>\r\n<Substance>kcl</Substance>\r\n<Lot_ID>l7</Lot_ID>\r\n"
    '<Sample_ID>a1</Sample_ID>\r\n<Content Unit="mg">50.12</Content>\r\n'
    "<Validity>valid</Validity>\r\n</Sample_Data>\r\nQRD 2 4 12 A\r\n"
)
DOSE: dict[str, Any] = {
    "substance": "kcl",
    "target_mg": 50.0,
    "tolerance_ratio": 0.01,
    "sample_id": "a1",
}


class Peer:
    """Answers as the table says, with some answers in place of others."""

    def __init__(self, **other: str | None) -> None:
        self.asked: list[str] = []
        self.weights = ["S S 0.00000 g", "S S 0.05012 g"]
        self.answers: dict[str, str | None] = {
            "I4": 'I4 A "B1"',
            "QRD 2 3 7": "QRD 2 3 7 2 A",
            "QRD 2 4 11": HEAD.removesuffix("\r\n"),
            "QRD 2 4 12": DOSED.removesuffix("\r\n"),
            "QRA 61 1": "QRA 61 1 B\r\nQRA 61 1 A",
            "QRA 61 4": "QRA 61 4 A",
            "QRA 60 7 3": "QRA 60 7 B\r\nQRA 60 7 A",
        }
        self.answers |= {name.replace("_", " "): value for name, value in other.items()}

    def __call__(self, request: bytes) -> bytes | None:
        command = request.decode().removesuffix("\r\n")
        self.asked.append(command)
        if command == "SI":
            has_dosed = "QRA 61 1" in self.asked
            return f"{self.weights[has_dosed]}\r\n".encode()
        told = self.answers.get(command, f"{command.rpartition(' ')[0]} A")
        return None if told is None else (f"{told}\r\n".encode() if told else b"")


Start = Callable[[Peer], MettlerQuantos]


@pytest.fixture
def start() -> Iterator[Start]:
    with ExitStack() as stack:

        def run(peer: Peer) -> MettlerQuantos:
            port = stack.enter_context(answering(peer))
            settings = {"poll_s": 0.005, "dose_limit_s": 0.5, "stable_limit_s": 0.3}
            device = MettlerQuantos(
                cast("ByteTransport", make_transport(f"tcp://127.0.0.1:{port}")), settings
            )
            device.connect()
            stack.callback(device.close)
            return device

        yield run


def test_a_dose_is_confirmed_by_the_balance(start: Start) -> None:
    peer = Peer()
    report = start(peer).dose(**DOSE)
    evidence = report.evidence
    assert evidence["dosed_mg"] == evidence["said_mg"] == 50.12
    (file,) = report.files
    assert (file.name, file.format, file.media_type) == ("a1.xml", "none", "application/xml")
    assert f"QRD 2 4 12 B\r\n{file.data.decode()}QRD 2 4 12 A\r\n" == DOSED
    assert (evidence["substance"], evidence["lot"], evidence["is_valid"]) == ("kcl", "l7", True)
    assert {"QRD 1 1 5 50.00", "QRD 1 1 6 1.0", "QRD 1 1 8 a1"} <= set(peer.asked)
    assert peer.asked.count("QRA 61 1") == 1


@pytest.mark.parametrize(
    "change",
    [
        {"substance": "nacl"},
        {"target_mg": 450.0},
        {"target_mg": 5001.0},
        {"target_mg": 0.05},
        {"tolerance_ratio": 0.5},
        {"sample_id": "a 1"},
        {"sample_id": "x" * 21},
    ],
)
def test_what_is_out_of_range_or_another_substance_is_not_dosed(
    start: Start, change: dict[str, Any]
) -> None:
    peer = Peer()
    with pytest.raises(PreconditionError):
        start(peer).dose(**{**DOSE, **change})
    assert "QRA 61 1" not in peer.asked


@pytest.mark.parametrize(
    "other",
    [
        {"QRD_2_3_7": "QRD 2 3 7 3 A"},
        {"QRD_2_3_7": "QRD 2 3 7 9 A"},
        {"QRD_2_4_11": "QRD 2 4 11 I 1"},
        {"QRD_1_1_9_0": "QRD 1 1 9 I 2"},
        {"QRA_61_1": "QRA 61 1 I 2"},
        {"QRA_61_1": "QRA 61 1 I 12"},
        {"QRA_61_1": "ES"},
    ],
)
def test_what_is_refused_at_once_has_no_effect(start: Start, other: dict[str, str]) -> None:
    with pytest.raises(LabError) as caught:
        start(Peer(**other)).dose(**DOSE)
    assert caught.value.effect is Effect.NONE


def test_a_bridge_in_the_head_tells_what_fell_until_then(start: Start) -> None:
    peer = Peer(QRA_61_1="QRA 61 1 B\r\nQRA 61 1 I 7")
    peer.weights[1] = "S S 0.02000 g"
    with pytest.raises(RejectedError, match="does not flow") as caught:
        start(peer).dose(**DOSE)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["dosed_mg"] == 20.0


def test_a_balance_that_disagrees_with_the_dispenser_leaves_the_mass_unknown(start: Start) -> None:
    peer = Peer()
    peer.weights[1] = "S S 0.04900 g"
    with pytest.raises(DeviceError) as caught:
        start(peer).dose(**DOSE)
    assert (caught.value.code, caught.value.effect) == ("device.not_confirmed", Effect.UNKNOWN)
    assert caught.value.context["dosed_mg"] == 49.0


def test_an_answer_without_a_document_leaves_the_mass_told_and_nothing_confirmed(
    start: Start,
) -> None:
    broken = DOSED.replace("QRD 2 4 12 B\r\n", "").removesuffix("\r\n")
    with pytest.raises(FrameError, match="no document") as caught:
        start(Peer(QRD_2_4_12=broken)).dose(**DOSE)
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context["dosed_mg"] == 50.12


def test_the_data_of_another_sample_confirm_nothing(start: Start) -> None:
    with pytest.raises(DeviceError) as caught:
        start(Peer(QRD_2_4_12=DOSED.replace("a1", "b2").removesuffix("\r\n"))).dose(**DOSE)
    assert caught.value.code == "device.not_confirmed"


@pytest.mark.parametrize("answer", ["QRA 61 1 B", None])
def test_silence_or_power_loss_in_a_dosing_is_unknown_and_is_not_sent_again(
    start: Start, answer: str | None
) -> None:
    peer = Peer(QRA_61_1=answer)
    with pytest.raises(DeviceError) as caught:
        start(peer).dose(**DOSE)
    assert caught.value.effect is Effect.UNKNOWN
    assert peer.asked.count("QRA 61 1") == 1


def test_a_stop_ends_a_dosing_and_tells_what_fell(start: Start) -> None:
    peer = Peer(QRA_61_1="QRA 61 1 B", QRA_61_4="QRA 61 4 A\r\nQRA 61 1 I 8")
    peer.weights[1] = "S S 0.01000 g"
    device = start(peer)
    timer = threading.Timer(0.15, device.stop)
    timer.start()
    with pytest.raises(DeviceStoppedError) as caught:
        device.dose(**DOSE)
    timer.join()
    assert "QRA 61 4" in peer.asked
    assert (caught.value.effect, caught.value.context["dosed_mg"]) == (Effect.PARTIAL, 10.0)


def test_a_weight_that_does_not_settle_starts_nothing(start: Start) -> None:
    peer = Peer()
    peer.weights[0] = "S D 0.00100 g"
    with pytest.raises(DeviceError) as caught:
        start(peer).dose(**DOSE)
    assert caught.value.effect is Effect.NONE
    assert "QRA 61 1" not in peer.asked


def test_a_door_that_does_not_open_is_told(start: Start) -> None:
    with pytest.raises(RejectedError, match="took too long"):
        start(Peer(QRA_60_7_3="QRA 60 7 B\r\nQRA 60 7 I 3")).open_door()
    with pytest.raises(DeviceError, match="does not stand"):
        start(Peer()).open_door()


def test_without_a_head_its_substance_is_none(start: Start) -> None:
    assert start(Peer()).head_mass_mg() == 400.0
    assert start(Peer(QRD_2_4_11="QRD 2 4 11 I 1")).head_substance() is None


@pytest.mark.parametrize("frame", [b"S S x g\r\n", b"S S 1.0 lb\r\n", b"\xff\r\n"])
def test_what_is_no_weight_is_refused(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_weight(frame)


@pytest.mark.parametrize("frame", [b'<M Unit="g">1</M>', b'<M Unit="mg">x</M>', b"", b"<M>1</M>"])
def test_what_is_no_mass_in_mg_is_refused(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_mass(frame, "M")
