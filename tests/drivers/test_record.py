"""What crosses a line is kept as a transcript that replays the same answers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.record import main
from drivers.sensors.mettler_sics import MettlerSics
from drivers.transports.replay import (
    RecordedExchange,
    Recording,
    ReplayTransport,
    parse_transcript,
    render_transcript,
)
from tests.drivers.wire import answering

BALANCE = "drivers.sensors.mettler_sics"
ANSWERS = {
    b"I4\r\n": b'I4 A "B0"\r\n',
    b"SI\r\n": b"S S      1.5 g\r\n",
    b"T\r\n": b"T S      1.5 g\r\n",
}


@pytest.fixture
def asked() -> list[bytes]:
    """What reached the instrument."""
    return []


@pytest.fixture
def port(asked: list[bytes]) -> Iterator[int]:
    """Serve a balance that rests under 1.5 g."""

    def answer(request: bytes) -> bytes:
        asked.append(request)
        return ANSWERS.get(request, b"ES\r\n")

    with answering(answer) as number:
        yield number


def run(port: int, out: Path, *more: str) -> int:
    return main([BALANCE, f"tcp://127.0.0.1:{port}", "--out", str(out), *more])


def test_a_recorded_line_replays_the_same_answers(port: int, tmp_path: Path) -> None:
    out = tmp_path / "balance.txt"
    assert run(port, out, "mass_mg", "weigh", "tare={}") == 0
    text = out.read_text()
    assert "# weigh() returned " in text
    assert '"mass_mg":1500.0' in text
    transport = ReplayTransport.from_file(out)
    device = MettlerSics(transport, {})
    device.connect()
    assert device.mass_mg() == 1500.0
    assert device.weigh().evidence == {"mass_mg": 1500.0}
    assert device.tare().evidence == {"tare_mg": 1500.0}
    assert transport.remaining == []
    device.close()


@pytest.mark.parametrize(
    ("more", "code"),
    [
        (["nothing"], "driver.no_action"),
        (["weigh={"], "driver.arguments"),
        (['weigh={"volume_ul": 1}'], "driver.arguments"),
        (["--config", '{"poll_s": "soon"}'], "driver.config"),
    ],
)
def test_what_does_not_fit_is_told_before_anything_is_sent(
    port: int,
    asked: list[bytes],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    code: str,
) -> None:
    out = tmp_path / "balance.txt"
    assert run(port, out, *more) == 2
    assert code in capsys.readouterr().err
    assert asked == []
    assert not out.exists()


def test_a_transcript_is_never_overwritten(port: int, asked: list[bytes], tmp_path: Path) -> None:
    out = tmp_path / "balance.txt"
    out.write_text("mine")
    assert run(port, out, "mass_mg") == 2
    assert (out.read_text(), asked) == ("mine", [])


def test_a_call_that_fails_is_kept_up_to_there(tmp_path: Path) -> None:
    def answer(request: bytes) -> bytes:
        return ANSWERS[request] if request == b"I4\r\n" else b"S +\r\n"

    out = tmp_path / "balance.txt"
    with answering(answer) as number:
        assert run(number, out, "mass_mg", "weigh") == 1
    kept = parse_transcript(out.read_text())
    assert [one.request for one in kept] == [b"I4\r\n", b"SI\r\n"]
    assert "# ended by " in out.read_text()


def test_pieces_of_an_answer_belong_together() -> None:
    recording = Recording()
    for direction, data in (("out", b"a"), ("in", b"1"), ("in", b"2"), ("out", b"b")):
        recording(direction, data)  # type: ignore[arg-type]
    assert recording.exchanges == [
        RecordedExchange(">", b"a", b"12"),
        RecordedExchange(">", b"b", b""),
    ]


@given(st.lists(st.tuples(st.binary(min_size=1, max_size=20), st.binary(max_size=20))))
def test_any_bytes_come_back_from_a_transcript(crossed: list[tuple[bytes, bytes]]) -> None:
    exchanges = [RecordedExchange(">", request, reply) for request, reply in crossed]
    text = render_transcript(exchanges, ["one head\nof two lines"])
    assert parse_transcript(text) == exchanges
