"""What continuous pumps share: a volume delivered by rate and time, and never left running."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from drivers.base import DeviceStoppedError, Driver, Report, after_acting, before_acting
from drivers.connectors._motion import FULL_STROKE_S, POLL_S
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError

SHORTEST_S = 0.2
"""Shortest delivery: below it, starting and stopping weigh more than the flow."""


def check_delivery(volume_ul: float, rate_ul_s: float) -> float:
    """Return how long a delivery takes.

    Raises:
        PreconditionError: Too short to be measured by time, or longer than any limit.
    """
    duration_s = volume_ul / rate_ul_s
    if duration_s < SHORTEST_S:
        raise PreconditionError(
            f"{volume_ul:g} µL at {rate_ul_s:g} µL/s is over in {duration_s:.3f} s, "
            f"less than {SHORTEST_S:g} s",
            code="device.volume_too_small",
        )
    if duration_s > FULL_STROKE_S:
        raise PreconditionError(
            f"{volume_ul:g} µL at {rate_ul_s:g} µL/s takes over {FULL_STROKE_S:g} s",
            code="device.rate_out_of_range",
        )
    return duration_s


def refuse_if_running(is_running: Callable[[], bool | None]) -> None:
    """Refuse a delivery while the pump runs, or may: nobody could tell the two apart.

    Raises:
        RejectedError: It is not known to stand.
    """
    with before_acting():
        if is_running() is not False:
            raise RejectedError("the pump is not known to stand: stop it first")


def deliver(
    driver: Driver[Any, Any],
    *,
    volume_ul: float,
    rate_ul_s: float,
    begin: Callable[[], None],
    end: Callable[[], None],
    is_running: Callable[[], bool],
) -> Report:
    """Pump for as long as the volume takes at a rate that is already set, then stop.

    Whatever goes wrong on the way, the pump is told to stop once more.

    Raises:
        DeviceStoppedError: PARTIAL, `moved_ul` by the time that it ran.
        DeviceError: UNKNOWN: the pump stood on its way, or its link was lost.
    """
    duration_s = check_delivery(volume_ul, rate_ul_s)
    started_s = driver.now_s()
    try:
        begin()
        started_s = driver.now_s()
        with after_acting():
            _run(driver, started_s + duration_s, is_running)
            end()
    except DeviceError as error:
        _end_after(error, end)
        if isinstance(error, DeviceStoppedError):
            error.effect = Effect.PARTIAL
            error.context["moved_ul"] = _moved_ul(driver, rate_ul_s, started_s)
        raise
    ran_s = driver.now_s() - started_s
    moved_ul = _moved_ul(driver, rate_ul_s, started_s)
    evidence = {"duration_s": round(ran_s, 3), "rate_ul_s": round(rate_ul_s, 6)}
    return Report(moved_ul, evidence, resolution_ul=round(rate_ul_s * POLL_S, 3))


def _end_after(error: DeviceError, end: Callable[[], None]) -> None:
    """Stop a pump that may run; only where somebody asked for it does a failure to stop count."""
    if isinstance(error, DeviceStoppedError):
        with after_acting():
            end()
    elif error.effect is not Effect.NONE:
        with suppress(DeviceError):
            end()


def _run(driver: Driver[Any, Any], until_s: float, is_running: Callable[[], bool]) -> None:
    driver.pause(0)
    while (left_s := until_s - driver.now_s()) > 0:
        driver.pause(min(POLL_S, left_s))
        if driver.now_s() < until_s and not is_running():
            driver.pause(0)  # a stop stands the pump still before its own wait hears of it
            raise DeviceError("the pump stood before the volume was through")


def _moved_ul(driver: Driver[Any, Any], rate_ul_s: float, started_s: float) -> float:
    return round(rate_ul_s * (driver.now_s() - started_s), 3)
