"""Writes the test: the driver against its simulated instrument, over the real transport."""

from __future__ import annotations

from string import Template
from typing import Any

from drivers.new.effects_table import EFFECTS
from drivers.new.order import DriverOrder
from drivers.new.role import DriverRole, RoleAction

_HEAD = Template('''\
"""$title against its simulated instrument."""

from collections.abc import Iterator
from typing import Any

import pytest

from drivers.load import read_status, read_statuses
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.placed_models import (
    Action,
    Bench,
    Case,
    Doing,
    do,
    impatient,
    running,
    sent_by,
)
from tests.fixtures.running import until

CASE = Case(
    module="$folder.$name", model="$name", carrier="$carrier", settings={"act_s": 25.0}
)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([CASE]) as bench:
        yield bench


def test_it_tells_what_its_role_tells(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        assert read_statuses(device) == $told


def test_a_silent_instrument_is_not_connected(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    bench.cure(CASE)
    bench.inflict(CASE, "no_answer")
    device = bench.driver(CASE)
    with pytest.raises(DeviceError) as caught:
        device.connect()
    assert (caught.value.code, caught.value.effect) == ("device.timeout", Effect.NONE)
    assert not device.transport.is_open


@pytest.mark.parametrize(
    ("mode", "code"), [("flip", "device.frame"), ("truncate", "device.timeout")]
)
def test_a_garbled_answer_is_never_a_value(
    bench: Bench, mode: str, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    with bench.connected(CASE) as device:
        bench.inflict(CASE, "garbled", mode=mode)
        with pytest.raises(DeviceError) as caught:
            $ask
        assert caught.value.code == code
''')

_ACTS = Template('''

ACTS: list[tuple[Action, dict[str, Any]]] = $acts
"""Each action, and what is told after it and those before."""
$moves

def test_each_action_does_what_its_role_says(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        for act, told in ACTS:
            report = do(device, act)
            assert {name: read_status(device, name) for name in told} == told$moved
''')

_MOVES = Template('''
MOVES = $moves
"""Microlitres that an action moves."""
''')

_MOVED = """
            assert report.moved_ul == MOVES.get(act[0])"""

_BEYOND = Template("""

@pytest.mark.parametrize("act", $beyond)
def test_what_is_out_of_range_is_refused_before_a_byte_is_sent(bench: Bench, act: Action) -> None:
    with bench.connected(CASE) as device:
        sent = sent_by(device)
        with pytest.raises(PreconditionError) as caught:
            do(device, act)
        assert caught.value.effect is Effect.NONE
        assert sent == []
""")

_LOST = Template("""

def test_a_lost_answer_is_never_followed_by_a_second_try(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    act: Action = $act
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE))
        bench.inflict(CASE, "no_answer", after_commands=$after, executes=True)
        error = Doing(device, act).failure()
        assert (error.code, error.effect) == ("device.timeout", Effect.$effect)
        assert len(bench.acts(CASE)) == before + 1
""")

_STOP = Template("""

def test_a_busy_instrument_starts_nothing(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE))
        bench.inflict(CASE, "busy")
        error = Doing(device, $act).failure()
        assert (error.code, error.effect) == ("device.rejected", Effect.NONE)
        assert len(bench.acts(CASE)) == before


def test_a_stop_ends_an_action_and_says_how_far_it_came(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE))
        doing = Doing(device, $act)
        until(lambda: len(bench.acts(CASE)) > before)
        device.stop()
        error = doing.failure()
        assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)$stopped
        assert bench.is_over(CASE)
""")

_STOPPED = """
        assert 0.0 <= error.context["moved_ul"] < act[1]["volume_ul"]"""


def suite_text(order: DriverOrder) -> str:
    """Write the test; imports that it does not need are left to be taken out."""
    role = order.role
    told = {tell.name: tell.at_first for tell in role.tells}
    ask = f'read_status(device, "{role.tells[0].name}")' if role.tells else "device.identify()"
    parts = [
        _HEAD.substitute(
            title=order.title,
            name=order.name,
            folder=order.folder,
            carrier=order.carrier,
            told=repr(told),
            ask=ask,
        )
    ]
    if role.acts:
        parts += [_acts_text(role, told), *_beyond_text(role), *_failures_text(role)]
    return "".join(parts)


def _acts_text(role: DriverRole, told: dict[str, Any]) -> str:
    acts = []
    for act in role.acts:
        effects = EFFECTS.get(role.name, {}).get(act.name, {})
        for name, (how, what) in effects.items():
            told[name] = _changed(told[name], how, what, act.samples)
        acts.append(((act.name, act.samples), dict(told)))
    moves = {act.name: act.samples["volume_ul"] for act in role.acts if act.operation == "transfer"}
    text = _ACTS.substitute(
        acts=repr(acts),
        moves=_MOVES.substitute(moves=repr(moves)) if moves else "",
        moved=_MOVED if moves else "",
    )
    return text if moves else text.replace("report = do(", "do(")


def _changed(value: Any, how: str, what: Any, given: dict[str, Any]) -> object:  # noqa: ANN401 - any JSON
    if how == "add":
        return value + given[what]
    if how == "subtract":
        return value - given[what]
    return what if how == "become" else given[what]


def _beyond_text(role: DriverRole) -> list[str]:
    beyond = [
        (act.name, {**act.samples, argument.name: type(argument.sample)(argument.span[1] + 1)})  # type: ignore[call-arg]
        for act in role.acts
        for argument in act.arguments
        if argument.span is not None
    ]
    beyond += [
        (act.name, {**act.samples, argument.name: "nothing_of_these"})
        for act in role.acts
        for argument in act.arguments
        if argument.choices
    ]
    return [_BEYOND.substitute(beyond=repr(beyond))] if beyond else []


def _failures_text(role: DriverRole) -> list[str]:
    act = _longest(role)
    shown = repr((act.name, act.samples))
    if act.operation == "read":
        return [_LOST.substitute(act=shown, after=0, effect="NONE")]
    lost = _LOST.substitute(act=shown, after=1, effect="UNKNOWN")
    is_transfer = act.operation == "transfer"
    stop = _STOP.substitute(act=shown, stopped=_STOPPED if is_transfer else "")
    if is_transfer:
        stop = stop.replace('act[1]["volume_ul"]', repr(act.samples["volume_ul"]))
    return [lost, stop]


def _longest(role: DriverRole) -> RoleAction:
    """Choose an action that acts and lasts: there is time to stop it."""

    def weight(act: RoleAction) -> tuple[bool, bool, bool]:
        names = act.samples
        return act.operation != "read", act.operation == "transfer", "duration_s" in names

    return max(role.acts, key=weight)
