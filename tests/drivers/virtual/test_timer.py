"""The host's own timer."""

from __future__ import annotations

import threading

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import call_action
from drivers.transports.urls import make_transport
from drivers.virtual.timer import HostTimer
from labweb.domain.errors import Effect, PreconditionError


def a_timer() -> HostTimer:
    return HostTimer(make_transport("virtual:timer"), {})  # type: ignore[arg-type]


def test_a_wait_takes_its_time() -> None:
    assert a_timer().wait(0.05).evidence["waited_s"] >= 0.05


def test_a_stopped_wait_ends_at_once_and_has_no_effect() -> None:
    timer = a_timer()
    stopper = threading.Timer(0.05, timer.stop)
    stopper.start()
    with pytest.raises(DeviceStoppedError) as caught:
        timer.wait(60.0)
    stopper.join()
    assert caught.value.effect is Effect.NONE
    assert caught.value.context["waited_s"] < 10


def test_a_negative_wait_is_refused_before_it_begins() -> None:
    with pytest.raises(PreconditionError):
        call_action(a_timer(), "wait", {"duration_s": -1.0})
