"""What infusion pumps share: a stroke to a target volume that the pump itself counts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from drivers.base import Driver, Report, after_acting
from drivers.connectors._motion import limit_of, refuse_rate, refuse_slow_stroke, watch
from labweb.domain.errors import DeviceError, Effect, PreconditionError

TOLERANCE_RATIO = 0.01
"""How far the pump's count may lie from the target, of the volume that was asked for."""


@dataclass(frozen=True, slots=True)
class Barrel:
    """The syringe that is clamped in, and how fast its block goes."""

    syringe_ul: float
    diameter_mm: float
    slowest_mm_s: float
    fastest_mm_s: float

    def check(self, volume_ul: float, rate_ul_s: float) -> None:
        """Refuse what neither syringe nor drive can do.

        Raises:
            PreconditionError: More than the syringe holds, or a rate out of range.
        """
        if volume_ul > self.syringe_ul:
            raise PreconditionError(
                f"{volume_ul:g} µL was asked for; the syringe holds {self.syringe_ul:g} µL",
                code="device.stroke_out_of_range",
            )
        area_mm2 = math.pi * self.diameter_mm**2 / 4  # 1 mm³ is 1 µL
        refuse_rate(rate_ul_s, self.slowest_mm_s * area_mm2, self.fastest_mm_s * area_mm2)
        refuse_slow_stroke(volume_ul / rate_ul_s)


class InfusionTarget(NamedTuple):
    """What was set in the pump."""

    volume_ul: float
    rate_ul_s: float
    resolution_ul: float
    """How finely the pump counts."""


def run_to_target(
    driver: Driver[Any, Any],
    target: InfusionTarget,
    *,
    begin: Callable[[], None],
    is_idle: Callable[[], bool],
    counted_ul: Callable[[], float],
) -> Report:
    """Let the pump run to the target that was set, and prove by its count what moved.

    Raises:
        DeviceStoppedError: PARTIAL, `moved_ul` by the pump's count.
        DeviceError: UNKNOWN: it stood short of the target, and nobody here stopped it.
    """
    volume_ul, rate_ul_s, resolution_ul = target
    begin()
    with after_acting():
        watch(driver, is_idle, limit_of(volume_ul / rate_ul_s), lambda: {"moved_ul": counted_ul()})
        moved_ul = counted_ul()
        if abs(moved_ul - volume_ul) > max(TOLERANCE_RATIO * volume_ul, resolution_ul):
            raise DeviceError(
                f"the pump stands after {moved_ul:g} µL by its count, asked for {volume_ul:g} µL",
                code="device.not_reached",
                effect=Effect.UNKNOWN,
                context={"counted_ul": moved_ul},
            )
    return Report(moved_ul, {"rate_ul_s": rate_ul_s}, resolution_ul)
