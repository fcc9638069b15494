"""What is asked of a device by a library is kept as words, and answers again from them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from drivers.record import main as record_main
from drivers.replay import main as replay_main
from drivers.replay import replay
from drivers.transports.http import HttpTransport
from drivers.transports.modbus import RegisterTransport
from drivers.transports.replay import (
    RecordedExchange,
    TranscriptMismatchError,
    parse_transcript,
    render_transcript,
)
from drivers.transports.s7.transport import S7Transport
from drivers.transports.tapes import PlayingTape, RecordingTape, taped
from labweb.domain.errors import DeviceTimeoutError, Effect, FrameError, RejectedError
from tests.drivers.wire import answering

PH = "drivers.sensors.seeed_ph"
READ = bytes.fromhex("000000060103 0000 0002")
ANSWER = bytes.fromhex("000000070103 04 09d0 02bd")


def played(text: str, sort: str) -> tuple[PlayingTape, RegisterTransport | HttpTransport]:
    tape = PlayingTape(parse_transcript(text))
    line = taped(tape, sort)
    assert isinstance(line, RegisterTransport | HttpTransport)
    line.open()
    return tape, line


def registers(text: str) -> tuple[PlayingTape, RegisterTransport]:
    tape, line = played(text, "register")
    assert isinstance(line, RegisterTransport)
    return tape, line


def http(text: str) -> HttpTransport:
    line = played(text, "http")[1]
    assert isinstance(line, HttpTransport)
    return line


def test_registers_are_read_and_written_as_the_transcript_has_them() -> None:
    tape, line = registers("> read input 0 2\n< 2512 701\n> write 5 1 2\n< taken\n")
    assert line.read_registers(0, 2, table="input") == (2512, 701)
    assert tape.remaining == [b"write 5 1 2"]
    line.write_registers(5, [1, 2])
    assert tape.remaining == []
    with pytest.raises(TranscriptMismatchError):
        line.write_register(5, 1)


def test_an_error_that_was_recorded_comes_again() -> None:
    _, line = registers("> read holding 0 1\n! RejectedError none: illegal register address\n")
    with pytest.raises(RejectedError, match="illegal register address") as refused:
        line.read_registers(0, 1)
    assert refused.value.effect is Effect.NONE


def test_a_request_without_an_answer_is_met_with_silence() -> None:
    _, line = registers("> read holding 0 1\n")
    with pytest.raises(DeviceTimeoutError):
        line.read_registers(0, 1)


def test_a_reply_has_its_status_headers_and_body() -> None:
    text = '> GET /a\n< 404 {"content-type": "text/plain"}\\n\n< none\\n\\xff\n'
    reply = http(text).get("/a", timeout_s=1.0, longest_bytes=100)
    assert (reply.status, reply.content_type, reply.body) == (404, "text/plain", b"none\n\xff")


def test_a_body_that_is_too_long_is_refused_as_from_the_wire() -> None:
    with pytest.raises(FrameError):
        http("> GET /a\n< 200 {}\\n12345\n").get("/a", timeout_s=1.0, longest_bytes=4)


def test_a_random_name_stands_for_the_one_that_was_recorded() -> None:
    old, new = ("11111111-1111-4111-8111-111111111111", "22222222-2222-4222-8222-222222222222")
    text = f'> POST /run {{"key":"{old}"}}\n< 201 {{}}\\n{{"key":"{old}"}}\n> GET /run/{old}\n'
    line = http(text + "< 200 {}\\nok\n")
    asked = json.dumps({"key": new}, separators=(",", ":")).encode()
    reply = line.post("/run", asked, timeout_s=1.0, longest_bytes=100)
    assert json.loads(reply.body) == {"key": new}
    with pytest.raises(TranscriptMismatchError):
        line.get("/run/33333333-3333-4333-8333-333333333333", timeout_s=1.0, longest_bytes=100)
    assert line.get(f"/run/{new}", timeout_s=1.0, longest_bytes=100).body == b"ok"


class Block(S7Transport):
    """A controller of one block."""

    def __init__(self) -> None:
        super().__init__("s7://127.0.0.1:102/0/1", "127.0.0.1", 102, 0, 1)
        self.data = bytearray(8)
        self.is_locked = False

    def _open(self) -> None:
        """Nothing is opened."""

    def read(self, block: int, start: int, count: int) -> bytes:
        return bytes(self.data[start : start + count])

    def write(self, block: int, start: int, data: bytes) -> None:
        if self.is_locked:
            raise RejectedError("access is not allowed", context={"block": block})
        self.data[start : start + len(data)] = data


def test_what_is_recorded_of_a_controller_plays_again() -> None:
    def ask(line: S7Transport) -> Sequence[object]:
        line.write(10, 2, b"\x41\xa0")
        found = line.read(10, 0, 4)
        device.is_locked = True
        with pytest.raises(RejectedError) as refused:
            line.write(10, 0, b"\x00")
        return found, refused.value.message, refused.value.effect

    device, tape = Block(), RecordingTape()
    line = taped(tape, "s7", device)
    assert isinstance(line, S7Transport)
    told = ask(line)
    text = render_transcript(tape.exchanges, ["a controller"])
    assert "> read DB10 0 4\n< 000041a0\n" in text
    again = taped(PlayingTape(parse_transcript(text)), "s7")
    assert isinstance(again, S7Transport)
    assert list(ask(again)) == list(told)


def test_a_line_of_another_sort_is_not_taped() -> None:
    with pytest.raises(TypeError):
        taped(RecordingTape(), "register", Block())


@pytest.fixture
def sensor() -> Iterator[Callable[[bytes], int]]:
    """Serve a pH sensor on Modbus TCP; the registers it answers with are given."""
    stack = []

    def serve(answer: bytes) -> int:
        served = answering(lambda request: request[:2] + answer if request[2:] == READ else None)
        stack.append(served)
        return served.__enter__()

    yield serve
    for served in stack:
        served.__exit__(None, None, None)


def test_a_modbus_device_is_recorded_by_the_program_and_replayed_by_the_other(
    sensor: Callable[[bytes], int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "ph.txt"
    url = f"modbus+tcp://127.0.0.1:{sensor(ANSWER)}"
    assert record_main([PH, url, "--out", str(out), "value_ph", "measure"]) == 0
    text = out.read_text()
    assert "> read holding 0 2\n< 2512 701\n" in text
    assert "# config {}\n# value_ph() returned 7.01\n# measure() returned {" in text
    assert replay_main([str(out)]) == 0
    out.write_text(text.replace("< 2512 701\n", "< 2512 702\n"))
    assert replay_main([str(out)]) == 1
    assert "value_ph() returned 7.02; recorded was: value_ph() returned 7.01" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("> read holding 0 2", "> read holding 1 2"), "the transcript expects"),
        (("# value_ph() returned 7.01\n", ""), "not asked: b'read holding 0 2'"),
        (("< 2512 701", "< 2512 65535"), "sensor tells"),
    ],
)
def test_what_differs_in_a_replay_is_told(change: tuple[str, str], said: str) -> None:
    one = "> read holding 0 2\n< 2512 701\n"
    text = f"# {PH} 0\n# config {{}}\n# value_ph() returned 7.01\n{one}{one}"
    assert replay(text) == []
    (finding,) = replay(text.replace(*change))
    assert (finding.code, said in finding.message) == ("driver.replay", True), finding.message


def test_a_transcript_by_hand_is_not_replayed_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "hand.txt"
    path.write_text("# a balance\n# of somebody\n> SI\n< S S 1.0 g\n")
    assert replay_main([str(path)]) == 2
    assert "names no driver and settings" in capsys.readouterr().err


def test_an_error_in_a_transcript_is_written_in_one_line() -> None:
    exchange = RecordedExchange(">", b"read holding 0 1", b"", "FrameError unknown: two\nlines")
    text = render_transcript([exchange])
    assert text == "> read holding 0 1\n! FrameError unknown: two lines\n"
    assert parse_transcript(text)[0].failure == "FrameError unknown: two lines"
