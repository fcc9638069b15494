"""The same for the rules of clocks; `clocks.run` plays them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import msgspec

from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_link import host_clocks
from labweb.domain.runs.host_link.host_clocks import (
    Cause,
    ClockAnchor,
    Estimate,
    Exchange,
    Happened,
)
from tests.simulation.mutants import Mutant, Patch


def time_of_reception(patch: Patch) -> None:
    """A thing happened when the server heard of it."""

    def happened(told: Estimate, causes: Sequence[Cause], by_s: float) -> Happened:
        return Happened(by_s, told.uncertainty_s or 0.0)

    patch.setattr(host_clocks, "happened", happened)
    patch.setattr(
        host_clocks, "latest", lambda events, received_at_s: [received_at_s] * len(events)
    )


def raw_time_of_the_host(patch: Patch) -> None:
    """The clock that people set is believed as it is."""
    patch.setattr(host_clocks, "told_moment", lambda event: Estimate(event.at_s, 0.01))


def measured_wall_clock(patch: Patch) -> None:
    """The clock that people set is corrected by the last measure, though it was set since."""

    def read(anchor: ClockAnchor, at: HostMoment) -> Estimate:
        ahead_s = anchor.server_at_s - anchor.wall_s
        return Estimate(at.wall_s + ahead_s, anchor.error_s)

    patch.setattr(host_clocks, "_read", read)


def causes_forgotten(patch: Patch) -> None:
    """What came before does not bound what comes after."""
    real = host_clocks.happened

    def happened(told: Estimate, causes: Sequence[Cause], by_s: float) -> Happened:
        return real(told, [Cause(0.0)], by_s)

    patch.setattr(host_clocks, "happened", happened)


def reception_forgotten(patch: Patch) -> None:
    """A thing may have happened after the server heard of it."""
    patch.setattr(host_clocks, "latest", lambda events, received_at_s: [1e9] * len(events))


def starts_confused(patch: Patch) -> None:
    """A measure counts for every start of the machine."""

    def best_of(anchors: Iterable[ClockAnchor], at: HostMoment) -> ClockAnchor | None:
        return max(anchors, key=lambda one: one.server_at_s, default=None)

    patch.setattr(host_clocks, "best_of", best_of)


def clocks_run_alike(patch: Patch) -> None:
    """A measure of long ago is as good as one of now."""
    patch.setattr(host_clocks, "DRIFT_RATIO", 0.0)


def way_takes_no_time(patch: Patch) -> None:
    """A measure is exact, however long its answer took."""
    real = host_clocks.anchor_of

    def anchor_of(exchange: Exchange) -> ClockAnchor | None:
        found = real(exchange)
        return None if found is None else msgspec.structs.replace(found, error_s=0.0)

    patch.setattr(host_clocks, "anchor_of", anchor_of)


def only_bounds(patch: Patch) -> None:
    """Nothing is measured: all lies somewhere between its cause and its reception."""

    def told_moment(event: EdgeEvent) -> Estimate:
        return Estimate(event.at_s, None)

    patch.setattr(host_clocks, "told_moment", told_moment)


def doubt_not_widened(patch: Patch) -> None:
    """A time that its bounds have moved is as sure as before."""
    real = host_clocks.happened

    def happened(told: Estimate, causes: Sequence[Cause], by_s: float) -> Happened:
        found = real(told, causes, by_s)
        return replace(found, uncertainty_s=min(found.uncertainty_s, told.uncertainty_s or 0.0))

    patch.setattr(host_clocks, "happened", happened)


OF_CLOCKS: tuple[Mutant, ...] = (
    time_of_reception,
    raw_time_of_the_host,
    measured_wall_clock,
    causes_forgotten,
    reception_forgotten,
    starts_confused,
    clocks_run_alike,
    way_takes_no_time,
    only_bounds,
    doubt_not_widened,
)
