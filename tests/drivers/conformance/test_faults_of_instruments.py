"""Each driver against the faults of its instrument: silence, noise, being busy, losing power."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from drivers.base import Driver
from drivers.load import read_status
from fixtures.instruments.models import MODELS
from labweb.domain.errors import (
    DeviceError,
    Effect,
    LabError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conformance.analysers import PLATE_READERS
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.deeds import Deed, deeds_of
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import (
    Action,
    Bench,
    Case,
    Doing,
    do,
    impatient,
    patient,
    running,
    sent_by,
)
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", EVERY, ids=lambda case: case.model)
GOES_ON = [*MOVERS, *PLATE_READERS]
"""Instruments that no halt keeps from ending what they have begun."""

ACTORS = [case for case in EVERY if case.verb]
BUSY = [case for case in EVERY if "busy" in MODELS[case.model].FAULTS and not case.refuses_late]
every_busy = pytest.mark.parametrize("case", BUSY, ids=lambda case: case.model)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(EVERY) as bench:
        yield bench


@every
def test_a_silent_instrument_is_not_connected_and_the_line_is_free_again(
    bench: Bench, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case)
    bench.cure(case)
    bench.inflict(case, "no_answer")
    device = bench.driver(case)
    with pytest.raises(DeviceError) as caught:
        device.connect()
    assert caught.value.effect is Effect.NONE
    assert not device.transport.is_open


@pytest.mark.parametrize(
    ("case", "mode"),
    [
        (case, mode)
        for case in EVERY
        for mode in ("flip", "truncate")
        if mode == "truncate" or not case.is_unchecked
    ],
    ids=lambda value: value.model if isinstance(value, Case) else value,
)
def test_a_garbled_answer_is_never_a_value(
    bench: Bench, case: Case, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case)
    with bench.connected(case) as device:
        patient(monkeypatch, case)
        assert isinstance(read_status(device, case.status), float | int | str)
        impatient(monkeypatch, case)
        bench.inflict(case, "garbled", mode=mode)
        with pytest.raises(DeviceError) as caught:
            read_status(device, case.status)
        assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(
    ("case", "index"),
    [(case, index) for case in EVERY for index in range(len(case.beyond))],
    ids=lambda value: value.model if isinstance(value, Case) else str(value),
)
def test_what_is_out_of_range_is_refused_before_a_byte_is_sent(
    bench: Bench, case: Case, index: int
) -> None:
    with bench.connected(case) as device:
        sent = sent_by(device)
        with pytest.raises(PreconditionError) as caught:
            do(device, case.beyond[index])
        assert caught.value.effect is Effect.NONE
        assert sent == []


@every_busy
def test_a_busy_instrument_starts_nothing(
    bench: Bench, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case)
    with bench.connected(case) as device:
        patient(monkeypatch, case)
        for act in case.ready:
            do(device, act)
        impatient(monkeypatch, case)
        before = len(bench.acts(case))
        bench.inflict(case, "busy")
        error = Doing(device, case.act).failure()
        assert error.effect is Effect.NONE
        assert len(bench.acts(case)) == before


@pytest.mark.parametrize(
    ("case", "after"),
    [
        (case, after)
        for case in ACTORS
        for after in ([1, 3] if case.is_instant else [1, 3, 5])
        if after <= case.asks
    ],
    ids=lambda value: value.model if isinstance(value, Case) else str(value),
)
def test_a_lost_answer_is_never_followed_by_a_second_try(
    bench: Bench, case: Case, after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case, 0.1)
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        bench.inflict(case, "no_answer", after_commands=after, executes=True)
        error = Doing(device, case.act).failure()
        started = len(bench.acts(case, case.verb)) - before
        assert started <= case.starts
        assert error.effect is not Effect.NONE or started == 0


@pytest.mark.parametrize("fault", ["power_loss", "no_answer"])
@pytest.mark.parametrize(
    ("case", "deed"),
    [(case, deed) for case in EVERY for deed in deeds_of(case)],
    ids=lambda value: value.model if isinstance(value, Case) else value.name,
)
def test_whatever_it_does_when_its_instrument_is_gone_nobody_knows_how_it_ended(
    bench: Bench, case: Case, deed: Deed, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case)  # a link that waits as long as when it was opened, too
    with bench.connected(case) as device:
        patient(monkeypatch, case)  # what comes before is done however slow the machine is
        if case in GOES_ON:  # what the last test began goes on to its end
            until(lambda: all(one["ending"] for one in bench.acts(case)))
        for one in deed.first:
            _prepare(device, one)
        act = deed.asked_of(device)
        going = _begun(bench, case, device, deed)
        before = Counter(one["verb"] for one in bench.acts(case))
        impatient(monkeypatch, case)
        is_silence = fault == "no_answer"
        bench.inflict(
            case, fault, for_s=1000.0, **deed.moment, **({"executes": True} if is_silence else {})
        )
        error = Doing(device, act).failure()
        assert bench.has_struck(case, fault), error
        assert error.effect is (Effect.NONE if deed.is_harmless else Effect.UNKNOWN), error
        started = Counter(one["verb"] for one in bench.acts(case)) - before
        assert all(count <= case.starts + case.closings for count in started.values())
        assert is_silence or all(one["ending"] for one in bench.acts(case))
        assert going is None or going.failure().effect is Effect.UNKNOWN


def _prepare(device: Driver[Any, Any], act: Action) -> None:
    """Do what comes before, again where the machine was too slow; what is so already is refused."""
    told: LabError | None = None
    for _ in range(5):
        try:
            do(device, act)
        except (PreconditionError, RejectedError):
            return
        except LabError as error:
            if error.code == "device.not_held":  # the fingers have closed, on nothing
                return
            told = error
            continue
        return
    raise AssertionError(f"{act[0]} did not succeed: {told}")


def _begun(bench: Bench, case: Case, device: Driver[Any, Any], deed: Deed) -> Doing | None:
    """Let begin what goes on while the fault strikes."""
    if deed.during is None:
        return None
    before = len(bench.acts(case, case.verb))
    doing = Doing(device, deed.during)
    until(lambda: len(bench.acts(case, case.verb)) > before)
    return doing
