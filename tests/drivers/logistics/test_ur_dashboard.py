"""The dashboard server against its published answers, and a simulated arm that plays programs."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from drivers.logistics.ur_dashboard import UrDashboard, whole_answer
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import Bench, Doing, do, impatient, running
from tests.drivers.conftest import Play
from tests.fixtures.running import until

CASE = next(case for case in MOVERS if case.model == "ur_dashboard")
PICK = ("run_program", {"program": "pick.urp"})


def ask(command: str, answer: str) -> str:
    return f"> {command}\\n\n< {answer}\\n\n"


FINE = ask("safetystatus", "Safetystatus: NORMAL")
READY = ask("robotmode", "Robotmode: RUNNING") + FINE + ask("running", "Program running: false")


def arm(transport: object) -> UrDashboard:
    return UrDashboard(transport, {"programs": ["pick.urp", "gone.urp"], "poll_s": 0.005})  # type: ignore[arg-type]


def test_the_greeting_of_a_fresh_connection_is_no_answer(play: Play) -> None:
    text = "> robotmode\\n\n< Connected: Universal Robots Dashboard Server\\nRobotmode: IDLE\\n\n"
    assert arm(play(text=text)).robot_mode() == "IDLE"
    assert whole_answer(b"Connected: Universal Robots Dashboard Server\n") is None


def test_the_words_of_older_controllers_are_understood(play: Play) -> None:
    assert arm(play(text=ask("running", "Robot running: True"))).is_running() is True


def test_a_robot_without_power_plays_nothing(play: Play) -> None:
    with pytest.raises(RejectedError, match="POWER_OFF") as caught:
        arm(play(text=ask("robotmode", "Robotmode: POWER_OFF"))).run_program("pick.urp")
    assert caught.value.effect is Effect.NONE


def test_a_program_that_the_controller_has_not_is_refused(play: Play) -> None:
    text = READY + ask("load gone.urp", "File not found: gone.urp")
    with pytest.raises(RejectedError, match="not found"):
        arm(play(text=text)).run_program("gone.urp")


def test_a_program_that_is_not_listed_is_not_even_loaded(play: Play) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError, match="not listed"):
        arm(transport).run_program("other.urp")
    assert transport.sent == []


def test_a_protective_stop_leaves_it_unknown(play: Play) -> None:
    text = (
        READY
        + ask("load pick.urp", "Loading program: pick.urp")
        + ask("play", "Starting program")
        + ask("safetystatus", "Safetystatus: PROTECTIVE_STOP")
        + ask("stop", "Stopped")
    )
    with pytest.raises(DeviceError, match="PROTECTIVE_STOP") as caught:
        arm(play(text=text)).run_program("pick.urp")
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.UNKNOWN)


def test_a_garbled_answer_is_a_frame_error(play: Play) -> None:
    with pytest.raises(FrameError):
        arm(play(text=ask("running", "Program walking: true"))).is_running()


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    """Run an arm that a person has switched on."""
    switched_off = replace(CASE, settings={**CASE.settings, "is_released": False})
    with running([switched_off]) as bench:
        with bench.connected(CASE) as device:
            assert isinstance(device, UrDashboard)
            device._ask("power on")
            until(lambda: device.robot_mode() == "IDLE")
            device._ask("brake release")
            until(lambda: device.robot_mode() == "RUNNING")
        yield bench


def test_a_program_is_played_to_its_end(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE, "program"))
        do(device, PICK)
        assert len(bench.acts(CASE, "program")) == before + 1
        assert bench.is_over(CASE, "program")


def test_a_stop_ends_the_program_and_nobody_knows_how_far_it_came(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE, "program"))
        doing = Doing(device, PICK)
        until(lambda: len(bench.acts(CASE, "program")) > before)
        device.stop()
        error = doing.failure()
        assert (error.code, error.effect) == ("device.stopped", Effect.UNKNOWN)
        until(lambda: bench.is_over(CASE, "program"), 1)


def test_silence_in_mid_program_is_unknown_and_not_played_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE, "program"))
        doing = Doing(device, PICK)
        until(lambda: len(bench.acts(CASE, "program")) > before)
        bench.inflict(CASE, "no_answer")
        assert doing.failure().effect is Effect.UNKNOWN
        assert len(bench.acts(CASE, "program")) == before + 1
