"""The pipetting robot over HTTP: a server that keeps to its document, and one that does not."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from typing import Any, cast

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_status
from drivers.processing import _opentrons
from drivers.processing.opentrons_ot2 import OpentronsOt2
from drivers.transports.http import HttpTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    Effect,
    FrameError,
    LabError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.processing.ot2_server import Server
from tests.drivers.web import serving
from tests.fixtures.running import until

RACK = "opentrons/opentrons_96_tiprack_300ul/1"
PLATE = "opentrons/corning_96_wellplate_360ul_flat/2"
CONFIG: dict[str, Any] = {
    "pipette": "p300_single_gen2",
    "mount": "right",
    "deck": {"1": RACK, "2": PLATE},
    "min_volume_ul": 20.0,
    "max_volume_ul": 300.0,
    "max_rate_ul_s": 150.0,
    "poll_s": 0.005,
    "command_limit_s": 2.0,
}
OVER = {"source_slot": "2", "source_well": "A1", "target_slot": "2", "target_well": "B1"}
MOVE: dict[str, Any] = {**OVER, "volume_ul": 100.0, "rate_ul_s": 50.0}


Start = Callable[..., OpentronsOt2]


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def start(server: Server, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    monkeypatch.setattr(_opentrons, "ASK_S", 0.1)

    def answer(
        method: str, path: str, headers: Mapping[str, str], body: bytes
    ) -> tuple[int, bytes] | None:
        server.headers.append(headers.get("Opentrons-Version"))
        status, told = server.answer(method, path, json.loads(body or b"{}"))
        data = json.dumps(told).encode()
        spoilt = server.spoil(method, path, data)
        return None if spoilt is None else (spoilt[0] or status, spoilt[1] or data)

    with ExitStack() as stack:
        port = stack.enter_context(serving(answer))

        def run(*, is_ready: bool = True, **config: object) -> OpentronsOt2:
            transport = cast("HttpTransport", make_transport(f"http://127.0.0.1:{port}"))
            device = OpentronsOt2(transport, {**CONFIG, **config})
            device.connect()
            stack.callback(device.close)
            if is_ready:
                device.initialize()
                device.pick_up_tip("1", "A1")
            return device

        yield run


def lose(server: Server, kind: str, *, executes: bool = True) -> None:
    """Let the answer to a command of this sort not come; the robot does it, or has not heard."""

    def spoil(method: str, path: str, _: bytes) -> tuple[int, bytes] | None:
        is_it = method == "POST" and path.endswith("/commands")
        if is_it and server.commands and server.commands[-1]["commandType"] == kind:
            if not executes:
                server.commands.pop()
            return None
        return 0, b""

    server.spoil = spoil


def test_a_session_loads_pipette_and_deck_before_anything_moves(
    server: Server, start: Start
) -> None:
    robot = start()
    assert server.kinds() == ["loadPipette", "loadLabware", "loadLabware", "home", "pickUpTip"]
    assert server.commands[1]["params"] == {
        "namespace": "opentrons",
        "loadName": "opentrons_96_tiprack_300ul",
        "version": 1,
        "location": {"slotName": "1"},
    }
    assert set(server.headers) == {"3"}
    assert [one["intent"] for one in server.commands] == ["setup"] * 5
    assert len({one["key"] for one in server.commands}) == 5
    assert (robot.is_initialized(), robot.has_tip(), robot.tip_volume_ul()) == (True, True, 0.0)
    assert read_status(robot, "running_state") == "idle"


def test_a_transfer_is_drawn_and_given_once(server: Server, start: Start) -> None:
    robot = start()
    report = robot.transfer_liquid(**MOVE)
    drawn, given = server.commands[-2:]
    assert report.moved_ul == 100.0
    assert report.evidence["keys"] == [drawn["key"], given["key"]]
    assert drawn["params"] == {
        "pipetteId": "pip-1",
        "labwareId": "lab-2",
        "wellName": "A1",
        "volume": 100.0,
        "flowRate": 50.0,
        "wellLocation": {"origin": "bottom", "offset": {"x": 0, "y": 0, "z": 1.0}},
    }
    assert (given["commandType"], given["params"]["wellName"]) == ("dispense", "B1")
    assert robot.tip_volume_ul() == 0.0


def test_what_the_tip_holds_is_counted(server: Server, start: Start) -> None:
    robot = start()
    robot.action_id = "0198f3c2"
    assert robot.aspirate("2", "A1", 120.0, 60.0).moved_ul == 120.0
    assert server.commands[-1]["key"].startswith("0198f3c2.")
    with pytest.raises(PreconditionError, match="may take 2 s"):
        robot.dispense("2", "B1", 50.0, 24.9)
    assert robot.dispense("2", "B1", 50.0, 50.0).moved_ul == 50.0
    assert robot.tip_volume_ul() == pytest.approx(70.0)
    assert robot.drop_tip().evidence == {"held_ul": pytest.approx(70.0)}
    assert (robot.has_tip(), robot.tip_volume_ul()) == (False, 0.0)
    last = server.commands[-1]
    assert (last["commandType"], last["params"]["labwareId"]) == ("dropTip", "fixedTrash")


def test_newer_software_has_its_waste_as_an_area(server: Server, start: Start) -> None:
    server.labware = []
    robot = start()
    robot.drop_tip()
    assert server.kinds()[-2:] == ["moveToAddressableAreaForDropTip", "dropTipInPlace"]
    assert server.commands[-2]["params"]["addressableAreaName"] == "fixedTrash"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("aspirate", {"slot": "2", "well": "A1", "volume_ul": 10.0, "rate_ul_s": 50.0}),
        ("aspirate", {"slot": "2", "well": "A1", "volume_ul": 301.0, "rate_ul_s": 50.0}),
        ("aspirate", {"slot": "2", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 151.0}),
        ("aspirate", {"slot": "3", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 50.0}),
        ("aspirate", {"slot": "2", "well": "a1", "volume_ul": 50.0, "rate_ul_s": 50.0}),
        ("dispense", {"slot": "2", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 50.0}),
        ("aspirate", {"slot": "2", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 24.9}),
        ("transfer_liquid", {**MOVE, "rate_ul_s": 49.9}),
        ("transfer_liquid", {**MOVE, "target_well": "A1"}),
        ("transfer_liquid", {**MOVE, "volume_ul": 400.0}),
        ("pick_up_tip", {"slot": "1", "well": "B1"}),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    server: Server, start: Start, name: str, arguments: dict[str, Any]
) -> None:
    robot = start()
    before = len(server.headers)
    with pytest.raises(PreconditionError) as caught:
        getattr(robot, name)(**arguments)
    assert caught.value.effect is Effect.NONE
    assert len(server.headers) == before


def test_a_halt_between_drawing_and_giving_is_in_doubt(
    server: Server, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = start()
    real = _opentrons.OpentronsRobot.command

    def command(
        self: _opentrons.OpentronsRobot, kind: str, params: dict[str, Any], limit_s: float
    ) -> _opentrons.OpentronsCommand:
        done = real(self, kind, params, limit_s)
        if kind == "aspirate":
            server.runs[-1]["status"] = "running"
            robot.halt()
        return done

    monkeypatch.setattr(_opentrons.OpentronsRobot, "command", command)
    with pytest.raises(LabError) as caught:
        robot.transfer_liquid(**MOVE)
    assert caught.value.effect is Effect.UNKNOWN
    assert "dispense" not in server.kinds()
    assert server.runs[-1]["status"] == "stopped"
    assert (robot.is_initialized(), robot.has_tip(), robot.tip_volume_ul()) == (False, None, None)


def test_a_tip_is_used_once_in_a_session(server: Server, start: Start) -> None:
    robot = start()
    robot.drop_tip()
    with pytest.raises(PreconditionError, match="was used"):
        robot.pick_up_tip("1", "A1")
    with pytest.raises(PreconditionError, match="no tip"):
        robot.aspirate("2", "A1", 50.0, 50.0)
    robot.pick_up_tip("1", "B1")
    robot.aspirate("2", "A1", 50.0, 50.0)
    with pytest.raises(PreconditionError, match="empty it"):
        robot.transfer_liquid(**MOVE)


def test_nothing_is_done_without_a_session(server: Server, start: Start) -> None:
    robot = start(is_ready=False)
    with pytest.raises(PreconditionError, match="initialise"):
        robot.aspirate("2", "A1", 50.0, 50.0)
    assert (robot.has_tip(), robot.running_state()) == (None, "none")


@pytest.mark.parametrize("kind", ["aspirate", "dispense"])
def test_a_command_whose_answer_is_lost_is_found_by_its_key(
    server: Server, start: Start, kind: str
) -> None:
    robot = start()
    lose(server, kind)
    assert robot.transfer_liquid(**MOVE).moved_ul == 100.0
    assert server.kinds().count(kind) == 1


@pytest.mark.parametrize("spoilt", [b"{", b'{"data": {"id": "c"}}', b'{"data": {"key": 1}}'])
def test_an_answer_that_cannot_be_read_is_asked_for(
    server: Server, start: Start, spoilt: bytes
) -> None:
    robot = start()

    def spoil(method: str, path: str, _: bytes) -> tuple[int, bytes]:
        return (0, spoilt if method == "POST" and path.endswith("/commands") else b"")

    server.spoil = spoil
    assert robot.aspirate("2", "A1", 50.0, 50.0).moved_ul == 50.0
    assert server.kinds().count("aspirate") == 1


def test_a_command_that_the_robot_does_not_tell_of_is_in_doubt(
    server: Server, start: Start
) -> None:
    robot = start()
    lose(server, "aspirate", executes=False)
    with pytest.raises(DeviceError) as caught:
        robot.transfer_liquid(**MOVE)
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context["run"] == "run-0"
    assert len(caught.value.context["key"]) == 36
    assert (robot.has_tip(), robot.tip_volume_ul()) == (None, None)
    assert "aspirate" not in server.kinds()
    with pytest.raises(PreconditionError, match="nobody knows"):
        robot.dispense("2", "B1", 50.0, 50.0)


def test_a_command_that_fails_before_the_plunger_moves_did_nothing(
    server: Server, start: Start
) -> None:
    robot = start()
    server.errors["aspirate"] = "WellDoesNotExistError"
    with pytest.raises(RejectedError) as caught:
        robot.transfer_liquid(**{**MOVE, "source_well": "P24"})
    assert caught.value.effect is Effect.NONE
    assert (robot.has_tip(), robot.tip_volume_ul()) == (True, 0.0)


@pytest.mark.parametrize(
    ("kind", "error"),
    [("aspirate", "OverpressureError"), ("dispense", "X"), ("dispense", "WellDoesNotExistError")],
)
def test_half_a_transfer_is_in_doubt(server: Server, start: Start, kind: str, error: str) -> None:
    robot = start()
    server.errors[kind] = error
    with pytest.raises(DeviceError) as caught:
        robot.transfer_liquid(**MOVE)
    assert caught.value.effect is Effect.UNKNOWN
    assert server.kinds().count(kind) == 1


def test_a_refused_command_did_nothing(server: Server, start: Start) -> None:
    robot = start()
    server.runs[-1]["status"] = "stopped"
    with pytest.raises(RejectedError, match="already stopped") as caught:
        robot.transfer_liquid(**MOVE)
    assert caught.value.effect is Effect.NONE


def test_another_volume_than_was_asked_for_is_in_doubt(server: Server, start: Start) -> None:
    robot = start()
    real = server.answer

    def answer(method: str, path: str, body: dict[str, Any]) -> tuple[int, object]:
        if "volume" in body.get("data", {}).get("params", {}):
            body["data"]["params"]["volume"] = 99.0
        return real(method, path, body)

    server.answer = answer  # type: ignore[method-assign]
    with pytest.raises(FrameError) as caught:
        robot.aspirate("2", "A1", 100.0, 50.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_stop_ends_the_run_and_nobody_knows_the_tip(server: Server, start: Start) -> None:
    robot = start()
    server.holds = "aspirate"
    errors: list[DeviceError] = []

    def move() -> None:
        try:
            robot.transfer_liquid(**MOVE)
        except DeviceError as error:
            errors.append(error)

    moving = threading.Thread(target=move)
    moving.start()
    until(lambda: "aspirate" in server.kinds(), 3)
    robot.stop()
    moving.join(5)
    (error,) = errors
    assert isinstance(error, DeviceStoppedError)
    assert error.effect is Effect.UNKNOWN
    assert server.runs[-1]["status"] == "stopped"
    assert "dispense" not in server.kinds()
    assert (robot.is_initialized(), robot.has_tip()) == (False, None)
    robot.clear_stop()
    server.holds = ""
    robot.initialize()
    assert server.runs[-1]["id"] == "run-1"


def test_a_halt_of_a_robot_at_rest_sends_nothing(server: Server, start: Start) -> None:
    robot = start()
    robot.halt()
    assert server.runs[-1]["status"] == "idle"
    assert robot.is_initialized()


def test_a_command_that_does_not_end_is_stopped(server: Server, start: Start) -> None:
    robot = start(command_limit_s=0.5)
    server.holds = "aspirate"
    with pytest.raises(DeviceError) as caught:
        robot.aspirate("2", "A1", 25.0, 50.0)
    assert (caught.value.code, caught.value.effect) == ("device.slow", Effect.UNKNOWN)
    assert server.runs[-1]["status"] == "stopped"
    assert (robot.is_initialized(), robot.has_tip()) == (False, None)
    with pytest.raises(PreconditionError, match="initialise"):
        robot.drop_tip()


def test_a_robot_that_runs_something_else_is_left_alone(server: Server, start: Start) -> None:
    server.runs.append({"id": "theirs", "status": "running", "current": True})
    robot = start(is_ready=False)
    with pytest.raises(RejectedError, match="theirs") as caught:
        robot.initialize()
    assert caught.value.effect is Effect.NONE
    assert len(server.runs) == 1


def test_another_model_is_refused(server: Server, start: Start) -> None:
    server.model = "OT-3 Standard"
    with pytest.raises(RejectedError, match="OT-3"):
        start(is_ready=False)


def test_a_pipette_that_is_not_mounted_moves_nothing(server: Server, start: Start) -> None:
    server.errors["loadPipette"] = "FailedToLoadPipetteError"
    robot = start(is_ready=False)
    with pytest.raises(RejectedError) as caught:
        robot.initialize()
    assert caught.value.effect is Effect.NONE
    assert server.kinds() == ["loadPipette"]
    assert not robot.is_initialized()


@pytest.mark.parametrize("deck", [{"12": RACK}, {"1": "tiprack"}, {"1": "a/b/0"}])
def test_a_deck_that_is_none_is_refused(deck: dict[str, str]) -> None:
    transport = cast("HttpTransport", make_transport("http://127.0.0.1:9"))
    with pytest.raises(DefinitionError, match="deck"):
        OpentronsOt2(transport, {**CONFIG, "deck": deck})


def test_a_robot_that_is_off_is_not_reached() -> None:
    transport = cast("HttpTransport", make_transport("http://127.0.0.1:9"))
    with pytest.raises(UnreachableError) as caught:
        OpentronsOt2(transport, CONFIG).connect()
    assert caught.value.effect is Effect.NONE
