"""What strokes are made of: a valve turned, the plunger moved, and the checks of both."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from uuid import UUID

from labweb.domain.crutd.operations import Operation, TransferLiquid, Update
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.units import parse, render_volume
from labweb.domain.workflows.passes.devices.calibration_correction import largest_stroke_nl
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, MassCheck
from labweb.domain.workflows.passes.liquids.pump_choice import Leg, ValveTurn
from labweb.domain.workflows.passes.role_requirements import setting
from labweb.domain.workflows.workflow_file import Step

FULL_STROKE_S = 20.0
"""Without a flow rate, a full syringe takes this long, or the pump's fastest if longer."""

TURN_S = 2.0
"""Estimate for one turn of a valve."""

SYRINGE_TOLERANCE_RATIO = 0.001
"""The plunger may be off by 0.1 % of the syringe, or one step if that is more."""

FINENESS_RATIO = 0.01
"""A stroke that whole steps miss by more than this is refused."""


@dataclass(frozen=True, kw_only=True)
class Strokes:
    """Makes the jobs of one step's strokes; a job that is refused is None."""

    step: Step
    drafting: Drafting
    device: AdmittedDevice
    syringe_nl: int
    stroke_nl: int
    """Largest volume of one stroke: of the syringe, and of its calibration where it has one."""

    rate_ul_s: float
    mass_check: MassCheck | None = None
    is_gas: bool = False
    """What is moved is no matter of the record: each stroke begins with an empty syringe."""

    def draw(self, operation: TransferLiquid, leg: Leg, text: str = "") -> list[DraftJob | None]:
        """Turn the valves on the way, then draw into the syringe."""
        turns = [self._turn(turn, text) for turn in leg.turns]
        return [*turns, self._move("aspirate", operation, leg, text)]

    def push(self, operation: TransferLiquid, leg: Leg, text: str = "") -> list[DraftJob | None]:
        """Turn the valves on the way, then push out of the syringe."""
        turns = [self._turn(turn, text) for turn in leg.turns]
        return [*turns, self._move("dispense", operation, leg, text)]

    def pass_on(
        self, operation: TransferLiquid, leg: Leg, receiver: Strokes, text: str = ""
    ) -> list[DraftJob | None]:
        """Turn the valves between two syringes, then push as the next one draws."""
        turns = [self._turn(turn, text) for turn in leg.turns]
        give = self._move("dispense", operation, leg, text)
        received = Update(resource_id=operation.target_id, data={})
        receive = receiver._move("aspirate", operation, leg, text, booked=received)
        given = None if give is None else replace(give, meets_next=True)
        return [*turns, given, receive]

    def _turn(self, turn: ValveTurn, text: str) -> DraftJob | None:
        name = self.drafting.name(turn.node_id)
        return self.drafting.job(
            self.step,
            turn.device,
            "select_port",
            {"port_index": turn.port_index},
            sentence=f"Turn {name} to port {turn.port_index}{text}",
            locks=(turn.node_id,),
            estimate_s=TURN_S,
        )

    def _move(
        self,
        action: str,
        operation: TransferLiquid,
        leg: Leg,
        text: str,
        booked: Operation | None = None,
    ) -> DraftJob | None:
        device, drafting = self.device, self.drafting
        is_draw = action == "aspirate"
        amount_ul = operation.amount_nl / 1000
        far = operation.source_id if is_draw else operation.target_id
        verb = "Aspirate" if is_draw else "Dispense"
        way = "from" if is_draw else "into"
        place = "source" if is_draw else "target"
        pre = [_is_initialized(device)]
        pre += [_at_port(turn, f"pump.valve_at_{place}") for turn in leg.turns]
        pre.append(self._syringe_holds(0.0 if is_draw else amount_ul, "pump.syringe_before"))
        check = None if is_draw else self.mass_check
        seen = set() if check is None else {check.node_id, *check.balance.nodes.values()}
        return drafting.job(
            self.step,
            device,
            action,
            {"volume_ul": amount_ul, "rate_ul_s": self.rate_ul_s},
            sentence=f"{verb} {render_volume(operation.amount_nl)} {way} "
            f"{drafting.name(far)}{text}",
            operation=_of_gas(operation, is_draw=is_draw) if self.is_gas else booked or operation,
            pre=pre,
            post=[self._syringe_holds(amount_ul if is_draw else 0.0, "pump.syringe_volume")],
            locks={*leg.route.resource_ids, *(t.node_id for t in leg.turns), *seen}
            | {node for turn in leg.turns for node in turn.device.nodes.values()},
            estimate_s=amount_ul / self.rate_ul_s,
            mass_check=check,
        )

    def _syringe_holds(self, volume_ul: float, name: str) -> Condition:
        return Condition(
            name=name,
            device_id=self.device.id,
            status="volume_ul",
            low=volume_ul,
            high=volume_ul,
            tolerance=syringe_tolerance_ul(self.device, self.syringe_nl),
        )


def _of_gas(operation: TransferLiquid, *, is_draw: bool) -> Update:
    """Return what the record keeps of a stroke of gas: nothing, but the syringe had to be empty."""
    syringe = operation.target_id if is_draw else operation.source_id
    return Update(resource_id=syringe, data={}, needs_empty=True)


def _is_initialized(device: AdmittedDevice) -> Condition:
    return Condition(
        name="pump.is_initialized", device_id=device.id, status="is_initialized", equals=True
    )


def _at_port(turn: ValveTurn, name: str) -> Condition:
    return Condition(
        name=name, device_id=turn.device.id, status="port_index", equals=turn.port_index
    )


def syringe_tolerance_ul(device: AdmittedDevice, syringe_nl: int) -> float:
    """Return how far the plunger may stand from where it should, as a volume."""
    syringe_ul = syringe_nl / 1000
    steps = setting(device, "steps_full_count")
    one_step_ul = syringe_ul / steps if steps else 0.0
    return max(SYRINGE_TOLERANCE_RATIO * syringe_ul, one_step_ul)


def check_fineness(
    step: Step,
    drafting: Drafting,
    device: AdmittedDevice,
    syringe_nl: int,
    amounts_nl: Iterable[int],
) -> None:
    """Note a finding for a stroke that the plunger's steps cannot measure to a hundredth."""
    steps = setting(device, "steps_full_count")
    if not steps:
        return
    one_step_nl = syringe_nl / steps
    for amount_nl in sorted(set(amounts_nl)):
        reached_nl = round(amount_nl / one_step_nl) * one_step_nl
        if abs(reached_nl - amount_nl) > FINENESS_RATIO * amount_nl:
            message = (
                f"{device.name} moves in steps of {one_step_nl / 1000:.3g} µL and would move "
                f"{reached_nl / 1000:.4g} µL instead of {amount_nl / 1000:.4g} µL: more than "
                "1 % off; ask for another volume or use a smaller syringe"
            )
            drafting.refuse(step, "plan.too_fine", message, "params.volume")
            return


def make_strokes(
    step: Step,
    drafting: Drafting,
    device: AdmittedDevice,
    pump_id: UUID,
    mass_check: MassCheck | None = None,
    *,
    is_gas: bool = False,
) -> Strokes | None:
    """Find the syringe's volume and the rate of a step; note what is wrong and return None."""
    syringe_nl = _syringe(step, drafting, device, pump_id)
    rate_ul_s = None if syringe_nl is None else _rate(step, drafting, device, syringe_nl)
    if syringe_nl is None or rate_ul_s is None:
        return None
    return Strokes(
        step=step,
        drafting=drafting,
        device=device,
        syringe_nl=syringe_nl,
        stroke_nl=largest_stroke_nl(device, syringe_nl),
        rate_ul_s=rate_ul_s,
        mass_check=mass_check,
        is_gas=is_gas,
    )


def _syringe(step: Step, drafting: Drafting, device: AdmittedDevice, pump_id: UUID) -> int | None:
    """Return the syringe's volume, on which the ledger and the driver must agree."""
    state = drafting.view.state(pump_id)
    name = drafting.name(pump_id)
    capacity_nl = None if state is None else state.capacity_nl
    if not capacity_nl or capacity_nl <= 0:
        message = f"nobody stated how much the syringe of {name} holds: set capacity_ul"
        drafting.refuse(step, "crutd.unknown_capacity", message, "params.pump")
        return None
    set_ul = setting(device, "syringe_ul")
    if set_ul is not None and round(set_ul * 1000) != capacity_nl:
        message = (
            f"{name} holds {render_volume(capacity_nl)} by its resource and "
            f"{set_ul / 1000:.2f} mL by its driver's settings: make them agree"
        )
        drafting.refuse(step, "plan.syringe_disagrees", message, "params.pump")
        return None
    return capacity_nl


def _rate(step: Step, drafting: Drafting, device: AdmittedDevice, syringe_nl: int) -> float | None:
    fastest = setting(device, "max_rate_ul_s")
    if "flow_rate" not in step.params:
        rate_ul_s = syringe_nl / 1000 / FULL_STROKE_S
        return rate_ul_s if fastest is None else min(rate_ul_s, fastest)
    rate_ul_s = parse(step.params["flow_rate"], "flow_rate")
    if fastest is not None and rate_ul_s > fastest:
        message = f"{device.name} moves at most {fastest:g} µL/s; asked for {rate_ul_s:g} µL/s"
        drafting.refuse(step, "plan.too_fast", message, "params.flow_rate", max_ul_s=fastest)
        return None
    return rate_ul_s


def dead_volume_notes(*legs: Leg) -> tuple[str, ...]:
    """Say which tubes on the way have a dead volume that nobody stated."""
    keys = dict.fromkeys(key for leg in legs for key in leg.route.unknown_keys)
    return tuple(f"Dead volume of connection {key} is unknown and counts as zero" for key in keys)
