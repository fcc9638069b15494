"""The same for the rules of set-points that vanish; `vanishing.run` plays them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from labweb.domain.runs.halts import halted_setpoints, standing_setpoints, vanished_setpoints
from labweb.domain.runs.halts.standing_setpoints import StandingSetpoint
from tests.simulation.memory import MemoryWrite
from tests.simulation.mutants import Mutant, Patch
from tests.simulation.vanishing import VanishingHost


def nothing_is_watched(patch: Patch) -> None:
    """A completed action leaves nothing that is looked after."""
    patch.setattr(vanished_setpoints, "note_complete", lambda *_: None)


def watched_in_memory(patch: Patch) -> None:
    """What stands is forgotten when the program starts again."""
    real = VanishingHost.start

    def start(self: VanishingHost, *, is_cold: bool) -> None:
        self.disk.meta.pop(standing_setpoints.KEY, None)
        real(self, is_cold=is_cold)

    patch.setattr(VanishingHost, "start", start)


def loss_voids_nothing(patch: Patch) -> None:
    """What was set counts on in the record after its loss."""

    def gone_of(data: Mapping[str, Any], action: str) -> dict[str, None]:
        return {}

    patch.setattr(vanished_setpoints, "gone_of", gone_of)


def loss_is_told_again(patch: Patch) -> None:
    """What is told as lost is watched on."""
    real = standing_setpoints.put_stands

    def put(tx: MemoryWrite, device_id: Any, sort: str, one: StandingSetpoint | None) -> None:  # noqa: ANN401
        if one is not None:
            real(tx, device_id, sort, one)

    patch.setattr(vanished_setpoints, "put_stands", put)


def old_loss_counts(patch: Patch) -> None:
    """A loss is told of an action whose set-point another one has taken the place of."""
    real = vanished_setpoints.write_vanished

    def write(tx: MemoryWrite, device: Any, one: StandingSetpoint, *rest: Any) -> bool:  # noqa: ANN401
        standing_setpoints.put_stands(tx, device.id, "flow", one)
        return real(tx, device, one, *rest)

    patch.setattr(vanished_setpoints, "write_vanished", write)


def loss_while_another_acts(patch: Patch) -> None:
    """A reading counts though another action of its sort acts, or is in doubt."""
    real = vanished_setpoints.write_vanished

    def write(tx: MemoryWrite, *rest: Any) -> bool:  # noqa: ANN401 - as the rule
        with patch.context() as inner:
            inner.setattr(MemoryWrite, "open_rows", lambda _self: [])
            return real(tx, *rest)

    patch.setattr(vanished_setpoints, "write_vanished", write)


def watched_after_a_halt(patch: Patch) -> None:
    """What a halt took away is told as lost besides."""
    patch.setattr(halted_setpoints, "clear_stands", lambda *_: None)


OF_LOSSES: tuple[Mutant, ...] = (
    nothing_is_watched,
    watched_in_memory,
    loss_voids_nothing,
    loss_is_told_again,
    old_loss_counts,
    loss_while_another_acts,
    watched_after_a_halt,
)
