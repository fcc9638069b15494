"""The potentiostat on its line, against bytes as its maker's manuals have them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError, Report
from drivers.characterization import palmsens_emstat_pico
from drivers.characterization._emstat import count_steps
from drivers.characterization._methodscript import LINEAR, decode_package, encode_number
from drivers.characterization.palmsens_emstat_pico import PalmsensEmstatPico
from drivers.load import call_action, load_driver, read_spec
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.common.instruments import csv_file
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play
from tests.drivers.wire import answering

IDENTITY = "> t\\n\n< tespico1400#Oct 10 2026 12:00:00\\nR*\\n\n"
HALT = "> \\nZ\\n\n< Z!0006\\n\n> e\\ncell_off\\n\\n\n< e\\n\\n\n"
FRONT = (
    "e\\nvar t\\nvar p\\nvar c\\nset_pgstat_chan 0\\nset_pgstat_mode 2\\n"
    "set_max_bandwidth 40\\nset_range ba 3m\\nset_autoranging ba 100n 3m\\n"
)
BACK = (
    "timer_get t\\npck_start\\npck_add t\\npck_add p\\npck_add c\\npck_end\\nendloop\\n"
    "on_finished:\\ncell_off\\n\\n\n"
)
SWEEP = (
    f"> {FRONT}set_range_minmax da 0 200m\\nset_e 200m\\ncell_on\\ntimer_start\\n"
    f"meas_loop_lsv p c 200m 0 100m 1\\n{BACK}"
)
FIRST = "Peb8000000 ;da8030D40u;ba8000064n,10,20A\\n"
POINTS = f"{FIRST}Peb8000064m;da80186A0u;ba7FFFF9Cn,12,20A\\nPeb80000C8m;da8000000 ;ba     nan\\n"
CV = {"first_v": 0.0, "vertex_1_v": 0.1, "vertex_2_v": 0.0, "step_v": 0.1, "cycles_count": 1}
LSV = {"first_v": 0.2, "last_v": 0.0, "step_v": 0.1, "rate_v_s": 1.0}


def sweep(play: Play, answer: str, more: str = "") -> Report:
    device = PalmsensEmstatPico(play(text=IDENTITY + SWEEP + f"< {answer}\n{more}"), {})
    device.connect()
    return device.sweep_linear(**LSV)


def test_a_sweep_is_a_table_with_units(play: Play, tmp_path: Path) -> None:
    report = sweep(play, f"e\\nM0000\\n{POINTS}*\\n\\n")
    (file,) = report.files
    assert (file.name, file.format, file.media_type) == ("linear_sweep.csv", "csv", "text/csv")
    path = tmp_path / file.name
    path.write_bytes(file.data)
    parsed = csv_file.read(path)
    columns = {column.name: column for column in parsed.tables[0]}
    assert [columns[name].unit for name in ("time", "potential", "current")] == ["s", "V", "A"]
    assert columns["time"].values == [0.0, 0.1, 0.2]
    assert columns["potential"].values == [0.2, 0.1, 0.0]
    assert columns["current"].values == [1e-7, -1e-7, None]
    assert report.evidence == {
        "technique": "linear_sweep",
        "points_count": 3,
        "last_potential_v": 0.0,
        "overload_count": 1,
        "min_current_ma": -0.0001,
        "max_current_ma": 0.0001,
    }


def test_flow_control_among_the_points_is_not_one(play: Play) -> None:
    report = sweep(play, f"\\x11e\\nM00\\x1300\\n{POINTS}\\x11*\\n\\n")
    assert report.evidence["points_count"] == 3


def test_a_script_that_is_refused_did_nothing(play: Play) -> None:
    with pytest.raises(RejectedError, match="line 9") as caught:
        sweep(play, "e!4001: Line 9, Col 1\\n")
    assert caught.value.effect is Effect.NONE


def test_a_busy_instrument_is_told_as_such(play: Play) -> None:
    with pytest.raises(RejectedError, match="busy") as caught:
        sweep(play, "e!0006\\n")
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(
    ("answer", "code", "effect"),
    [
        (
            "e\\nM0000\\nPeb8000000 ;da8030D40u;ba8000064n\\n!0032: Line 13\\n",
            "device.alarm",
            "partial",
        ),
        (
            "e\\nM0000\\nPeb8000000 ;da8030D40u;ba8000064n\\n*\\n\\n",
            "device.not_reached",
            "partial",
        ),
        ("e\\nM0005\\n", "device.frame", "unknown"),
        ("e\\nM0000\\nPeb8000000 ;ab8030D40u;ba8000064n\\n", "device.frame", "unknown"),
        ("e\\nM0000\\nPeb8000000 ;da8030D4\\n", "device.frame", "unknown"),
        ("e\\nM0000\\nPeb     nan;da8030D40u;ba8000064n\\n", "device.frame", "unknown"),
        ("e\\n\\n", "device.frame", "unknown"),
        (f"e\\nM0000\\n{POINTS}*\\n\\nM0000\\n", "device.frame", "unknown"),
    ],
)
def test_a_measurement_that_fails_ends_with_the_cell_off(
    play: Play, answer: str, code: str, effect: str
) -> None:
    with pytest.raises(DeviceError) as caught:
        sweep(play, answer, HALT)
    assert (caught.value.code, caught.value.effect.value) == (code, effect)


def test_no_answer_to_a_script_is_in_doubt_and_followed_by_a_halt(play: Play) -> None:
    with pytest.raises(DeviceTimeoutError) as caught:
        sweep(play, "", HALT)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_cell_that_stays_on_is_said(play: Play) -> None:
    stuck = "> \\nZ\\n\n< Z!0006\\n\n> e\\ncell_off\\n\\n\n< e!0001\\n\n"
    with pytest.raises(DeviceError) as caught:
        sweep(play, "e\\nM0000\\n!0032: Line 13\\n", stuck)
    assert caught.value.effect is Effect.UNKNOWN
    assert "not turned off" in caught.value.context["not_turned_off"]


def test_a_halt_waits_for_the_end_of_what_runs(play: Play) -> None:
    ended = "> \\nZ\\n\n< Peb8000000 ;ab8030D40u\\nZ\\n*\\n\\n\n> e\\ncell_off\\n\\n\n< e\\n\\n\n"
    device = PalmsensEmstatPico(play(text=IDENTITY + ended), {})
    device.connect()
    assert device.stop_measuring().evidence == {"is_cell_on": False}


def test_another_instrument_is_refused(play: Play) -> None:
    text = "> t\\n\n< tes4_lr1100#Jan 28 2022 11:04:43\\nR*\\n\n"
    with pytest.raises(RejectedError, match="no EmStat Pico"):
        PalmsensEmstatPico(play(text=text), {}).connect()


def test_the_same_instrument_has_to_go_on_answering(play: Play) -> None:
    other = IDENTITY.replace("2026", "2027")
    device = PalmsensEmstatPico(play(text=IDENTITY + IDENTITY + other), {})
    device.connect()
    assert device.is_connected()
    with pytest.raises(FrameError) as caught:
        device.is_connected()
    assert caught.value.effect is Effect.NONE


def test_cycles_are_counted(play: Play) -> None:
    loop = "meas_loop_cv p c 0 100m 0 100m 1 nscans(2)"
    text = (
        f"> {FRONT}set_range_minmax da 0 100m\\nset_e 0\\ncell_on\\ntimer_start\\n{loop}\\n{BACK}"
        "< e\\nM0005\\nC0000\\nPeb8000000 ;da8000000 ;ba8000064n\\n"
        "Peb8000064m;da8000064m;ba8000065n\\n-\\nC0001\\n"
        "Peb80000C8m;da8000000 ;ba8000064n\\nPeb800012Cm;da8000064m;ba8000065n\\n-\\n*\\n\\n\n"
    )
    device = PalmsensEmstatPico(play(text=IDENTITY + text), {})
    device.connect()
    way = {"first_v": 0.0, "vertex_1_v": 0.1, "vertex_2_v": 0.0, "step_v": 0.1, "rate_v_s": 1.0}
    (file,) = device.sweep_cyclic(**way, cycles_count=2).files
    rows = file.data.decode().splitlines()[3:]
    assert [row.split(",")[3] for row in rows] == ["1", "1", "2", "2"]
    assert (device.potential_v(), device.progress_ratio()) == (0.1, 1.0)
    assert device.current_ma() == pytest.approx(1.01e-4)


def test_an_open_circuit_is_read_with_the_cell_off(play: Play) -> None:
    text = (
        "> e\\nvar t\\nvar p\\nset_pgstat_chan 0\\nset_pgstat_mode 2\\nset_max_bandwidth 4\\n"
        "set_range ba 3m\\nset_autoranging ba 100n 3m\\ncell_off\\ntimer_start\\n"
        "meas_loop_ocp p 1 2\\ntimer_get t\\npck_start\\npck_add t\\npck_add p\\npck_end\\n"
        "endloop\\non_finished:\\ncell_off\\n\\n\n"
        "< e\\nM000B\\nPeb8000001 ;ab801E240u\\nPeb8000002 ;ab801E241u\\n*\\n\\n\n"
    )
    device = PalmsensEmstatPico(play(text=IDENTITY + text), {})
    device.connect()
    report = device.measure_open_circuit(2.0, 1.0)
    assert report.evidence["last_potential_v"] == 0.123457
    assert report.files[0].data.splitlines()[2] == b"time (s),potential (V),status (1)"
    assert device.current_ma() is None


@pytest.mark.parametrize(
    ("config", "name", "arguments"),
    [
        ({}, "hold_potential", {"potential_v": -1.3, "duration_s": 1.0, "interval_s": 0.1}),
        ({}, "hold_potential", {"potential_v": 0.5, "duration_s": 1.0, "interval_s": 0.02}),
        ({}, "hold_potential", {"potential_v": 0.5, "duration_s": 1.0, "interval_s": 2.0}),
        ({}, "hold_potential", {"potential_v": 0.5, "duration_s": 80000.0, "interval_s": 0.1}),
        ({"max_potential_v": 0.4}, "sweep_linear", {**LSV, "first_v": 0.5}),
        ({}, "sweep_linear", {**LSV, "first_v": 1.5, "last_v": -1.0}),
        ({}, "sweep_linear", {**LSV, "last_v": 0.2}),
        ({"mode": "high_speed"}, "sweep_linear", {**LSV, "first_v": 1.0, "last_v": -0.5}),
        ({}, "sweep_linear", {**LSV, "rate_v_s": 10.0}),
        ({}, "sweep_linear", {**LSV, "first_v": 0.12345678912}),
        ({}, "sweep_linear", {**LSV, "rate_v_s": 0.0016}),
        ({}, "sweep_linear", {**LSV, "last_v": -0.8, "step_v": 0.0001, "rate_v_s": 0.0000115}),
        ({}, "sweep_cyclic", {**CV, "rate_v_s": 0.0016}),
        ({}, "sweep_cyclic", {**CV, "rate_v_s": 0.01, "cycles_count": 1000, "vertex_1_v": 0.5}),
    ],
)
def test_what_it_cannot_measure_is_refused_before_a_byte_is_sent(
    play: Play, config: dict[str, Any], name: str, arguments: dict[str, Any]
) -> None:
    transport = play(text="")
    spec = read_spec("drivers.characterization.palmsens_emstat_pico")
    device = load_driver(spec.module, spec.class_name, spec.digest, transport, config)
    with pytest.raises(PreconditionError) as caught:
        call_action(device, name, arguments)
    assert caught.value.effect is Effect.NONE
    assert transport.sent == []


def test_the_slowest_sweeps_are_counted() -> None:
    assert count_steps(0.25, (0.0, 0.5), 0.25 / 60) == 2
    assert count_steps(0.0001, (0.0, 1.0, 0.0), 2 / 86_400) == 20_000
    with pytest.raises(PreconditionError, match="time of a step in s 250"):
        count_steps(0.25, (-1.0, 1.0), 1e-3)
    with pytest.raises(PreconditionError, match=r"time of the sweep in s 1\.6e"):
        count_steps(0.01, (0.0, 1.0, -1.0, 0.0), 0.0005, 200)


def test_numbers_that_are_none_are_not_written() -> None:
    assert encode_number(250.0) == "250"
    with pytest.raises(PreconditionError):
        encode_number(1e10)
    with pytest.raises(FrameError):
        decode_package("Qeb8000000 ;da8030D40u;ba8000064n", LINEAR, 1)


def test_what_was_recorded_is_read_alike(play: Play) -> None:
    device = PalmsensEmstatPico(play("emstat_pico"), {})
    device.connect()
    assert device.is_connected()
    assert device.measure_open_circuit(3.0, 1.0).evidence["last_potential_v"] == 0.022560965
    linear = device.sweep_linear(0.0, 0.4, 0.05, 0.1)
    assert linear.evidence["points_count"] == 9
    cyclic = device.sweep_cyclic(0.0, 0.4, 0.0, 0.1, 0.1, 2)
    cells = [row.split(",") for row in cyclic.files[0].data.decode().splitlines()[3:]]
    assert [cell[3] for cell in cells].count("2") == 8
    assert device.current_ma() == -0.00337536
    device.stop_measuring()


class Peer:
    """Answers a script with points that do not end, until it is told to."""

    def __init__(self) -> None:
        self.asked = b""
        self.is_on = False

    def __call__(self, request: bytes) -> bytes | None:
        self.asked += request
        if request == b"t\n":
            return b"tespico1400#Oct 10 2026 12:00:00\nR*\n"
        if b"meas_loop" in request:
            self.is_on = True
            return b"e\nM0007\nPeb8000000 ;da8000064m;ba8000064n\n"
        if request == b"\nZ\n":
            was_on, self.is_on = self.is_on, False
            return b"Z\n*\n\n" if was_on else b"Z!0006\n"
        return b"e\n\n"


Start = Callable[[Peer], PalmsensEmstatPico]


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    monkeypatch.setattr(palmsens_emstat_pico, "AFTER_ERROR_S", 0.01)
    with ExitStack() as stack:

        def run(peer: Peer) -> PalmsensEmstatPico:
            port = stack.enter_context(answering(peer))
            url = f"tcp://127.0.0.1:{port}"
            device = PalmsensEmstatPico(cast("ByteTransport", make_transport(url)), {})
            device.connect()
            stack.callback(device.close)
            return device

        yield run


def test_a_stop_turns_the_cell_off_and_tells_how_far_it_came(start: Start) -> None:
    peer = Peer()
    device = start(peer)
    timer = threading.Timer(0.2, device.stop)
    timer.start()
    with pytest.raises(DeviceStoppedError) as caught:
        device.hold_potential(0.1, 60.0, 1.0)
    timer.join()
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["points_count"] == 1
    assert not peer.is_on
    assert peer.asked.endswith(b"e\ncell_off\n\n")
    assert not device.is_measuring()
    assert device.progress_ratio() == pytest.approx(1 / 60)
    with pytest.raises(DeviceStoppedError):
        device.hold_potential(0.1, 60.0, 1.0)


def test_silence_in_the_middle_leaves_it_unknown(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(palmsens_emstat_pico, "ANSWER_S", 0.2)
    peer = Peer()
    device = start(peer)
    with pytest.raises(DeviceTimeoutError) as caught:
        device.hold_potential(0.1, 60.0, 0.1)
    assert caught.value.effect is Effect.UNKNOWN
    assert not peer.is_on
