"""Expansions that part, wash, dry and purify."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import (
    BUFFER,
    KEPT,
    WASTE,
    BasicKind,
    BasicOperation,
)
from labweb.domain.recipes.xdl.expansion.stir_heat_light_gas import (
    return_to_room_temperature,
    to_temperature,
)

Operations = Iterator[BasicOperation]


def separate(act: ActReading) -> Operations:
    """Separate: shake out, let settle, draw off the phases; as often as asked.

    wash: the product stays in its phase, which is washed again. extract: the product goes into the
    solvent, and the other phase is extracted again. Without a solvent there is nothing to shake
    out: the phases are parted once.
    """
    separator = act.text("separation_vessel")
    yield from _into(act, act.text("from_vessel"), separator)
    rounds = act.rounds()
    if not act.text("solvent"):
        if rounds > 1:
            act.refuse("xdl.left_open", "Separate is repeated without a solvent to shake out with")
        rounds = 1
    is_wash = act.text("purpose") == "wash" and bool(act.text("solvent"))
    for turn in range(rounds):
        yield from _shaken(act, separator)
        yield from _parted(act, separator, is_wash=is_wash, turn=turn, rounds=rounds)


def _into(act: ActReading, source: str, separator: str) -> Operations:
    if source != separator:
        port = act.text("from_port")
        yield act.make(BasicKind.TRANSFER, source=source, target=separator, from_port=port)


def _shaken(act: ActReading, separator: str) -> Operations:
    solvent = act.text("solvent")
    if solvent:
        volume = act.number("solvent_volume", "separation.solvent_volume")
        yield act.make(BasicKind.ADD_LIQUID, reagent=solvent, vessel=separator, volume_ml=volume)
    yield from _mixed(act, separator)


def _mixed(act: ActReading, separator: str) -> Operations:
    """Shake what is in the separator: fast, then slowly, then let it settle."""
    fast = act.number("stir_speed", "separation.fast_stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=separator, speed_rpm=fast)
    yield act.make(BasicKind.WAIT, seconds=act.number("stir_time", "separation.fast_stir_time"))
    slow = act.number("slow_stir_speed", "separation.slow_stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=separator, speed_rpm=slow)
    yield act.make(
        BasicKind.WAIT, seconds=act.number("slow_stir_time", "separation.slow_stir_time")
    )
    yield act.make(BasicKind.STOP_STIR, vessel=separator)
    yield act.make(BasicKind.WAIT, seconds=act.number("settling_time", "separation.settling_time"))


def _parted(
    act: ActReading, separator: str, *, is_wash: bool, turn: int, rounds: int
) -> Operations:
    is_top, is_last = act.text("product_phase") == "top", turn == rounds - 1
    product_to, waste_to = act.text("to_vessel"), act.text("waste_phase_to_vessel", WASTE)
    through = act.text("through")
    if not is_last and is_wash:
        # The product phase is washed again: it stays, or comes back from a buffer.
        product_to, through = (separator, "") if is_top else (BUFFER, "")
    elif not is_last:
        waste_to = BUFFER if is_top else separator
    leaving = waste_to if is_wash else product_to
    if rounds > 1 and leaving == separator:
        # It is in the separator after the last round, and until then out of the way.
        product_to, waste_to = (product_to, KEPT) if is_wash else (KEPT, waste_to)
    upper, lower = (product_to, waste_to) if is_top else (waste_to, product_to)
    ports = {waste_to: act.text("waste_phase_to_port"), product_to: act.text("to_port")}
    ports = {name: port for name, port in ports.items() if name not in (BUFFER, KEPT, separator)}
    # What waits between two rounds is best in the vessel that the recipe has for it anyway.
    own = "to_vessel" if product_to == BUFFER else "waste_phase_to_vessel"
    waits_in = act.text(own) if BUFFER in (upper, lower) else ""
    yield act.make(
        BasicKind.SEPARATE_PHASES,
        vessel=separator,
        lower_to=lower,
        upper_to=upper,
        waits_in=waits_in if waits_in != separator else "",
        lower_through="" if is_top else through,
        upper_through=through if is_top else "",
        lower_port=ports.get(lower, ""),
        upper_port=ports.get(upper, ""),
    )
    if BUFFER in (upper, lower):
        yield act.make(BasicKind.TRANSFER, source=BUFFER, target=separator)
    if is_last and rounds > 1 and leaving == separator:
        yield act.make(BasicKind.TRANSFER, source=KEPT, target=separator)


def separate_phases(act: ActReading) -> Operations:
    """SeparatePhases: draw off what has settled."""
    yield act.make(
        BasicKind.SEPARATE_PHASES,
        vessel=act.text("separation_vessel"),
        lower_to=act.text("lower_phase_vessel"),
        upper_to=act.text("upper_phase_vessel"),
        lower_through=act.text("lower_phase_through"),
        upper_through=act.text("upper_phase_through"),
        lower_port=act.text("lower_phase_port"),
        upper_port=act.text("upper_phase_port"),
        conducting_phase=act.text("high_conductivity_phase"),
        step_ml=act.number("step_volume"),
    )


def shake_out(act: ActReading) -> Operations:
    """Wash and Extract: as Separate, with the purpose in the name."""
    separator, is_wash = act.text("separation_vessel"), act.name == "Wash"
    yield from _into(act, act.text("vessel"), separator)
    rounds = act.rounds()
    for turn in range(rounds):
        volume = act.number("volume")
        yield act.make(
            BasicKind.ADD_LIQUID, reagent=act.text("solvent"), vessel=separator, volume_ml=volume
        )
        yield from _mixed(act, separator)
        yield from _parted(act, separator, is_wash=is_wash, turn=turn, rounds=rounds)


def filter_off(act: ActReading) -> Operations:
    """Filter: draw the liquid off, then suck the solid dry."""
    vessel = act.text("vessel")
    if act.flag("stir"):
        speed = act.number("stir_speed", "filter.stir_speed")
        yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
    if "temp" in act.values:
        yield from to_temperature(act)
    yield act.make(
        BasicKind.DRAW_FILTRATE,
        vessel=vessel,
        target=act.text("filtrate_vessel", WASTE),
        volume_ml=act.number("volume"),
        aspirate_ml_min=act.number("aspiration_speed"),
    )
    yield act.make(BasicKind.STOP_STIR, vessel=vessel)
    yield from _sucked(act, vessel, "wait_time", "filter.vacuum_time")
    if "temp" in act.values and not act.flag("continue_heatchill"):
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def _sucked(act: ActReading, vessel: str, time: str, default: str) -> Operations:
    pressure = act.number("vacuum_pressure", "filter.vacuum_pressure")
    yield act.make(BasicKind.START_VACUUM, vessel=vessel, pressure_mbar=pressure)
    yield act.make(BasicKind.WAIT, seconds=act.number(time, default))
    yield act.make(BasicKind.STOP_VACUUM, vessel=vessel)


def wash_solid(act: ActReading) -> Operations:
    """WashSolid: solvent on, stirred, drawn off, sucked dry; as often as asked."""
    vessel = act.text("vessel")
    stir = act.values.get("stir", True)
    if "temp" in act.values:
        yield from to_temperature(act)
    for _ in range(act.rounds()):
        if stir is True:
            speed = act.number("stir_speed", "filter.stir_speed")
            yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
        volume = act.number("volume", "wash_solid.volume")
        yield act.make(
            BasicKind.ADD_LIQUID, reagent=act.text("solvent"), vessel=vessel, volume_ml=volume
        )
        if stir == "solvent":
            speed = act.number("stir_speed", "filter.stir_speed")
            yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
        yield act.make(BasicKind.WAIT, seconds=act.number("time", "wash_solid.time"))
        if stir == "solvent":
            yield act.make(BasicKind.STOP_STIR, vessel=vessel)
        target = act.text("filtrate_vessel", WASTE)
        yield act.make(BasicKind.DRAW_FILTRATE, vessel=vessel, target=target)
        if stir is True:
            yield act.make(BasicKind.STOP_STIR, vessel=vessel)
        yield from _sucked(act, vessel, "vacuum_time", "wash_solid.vacuum_time")
    if "temp" in act.values:
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def dry(act: ActReading) -> Operations:
    """Dry: vacuum on the solid, warm when asked."""
    vessel = act.text("vessel")
    yield act.make(BasicKind.STOP_STIR, vessel=vessel)
    if "temp" in act.values:
        yield from to_temperature(act)
    pressure = act.number("pressure", "dry.pressure")
    yield act.make(BasicKind.START_VACUUM, vessel=vessel, pressure_mbar=pressure)
    yield act.make(BasicKind.WAIT, seconds=act.number("time", "dry.time"))
    yield act.make(BasicKind.STOP_VACUUM, vessel=vessel)
    if "temp" in act.values and not act.flag("continue_heatchill"):
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def evaporate(act: ActReading) -> Operations:
    """Evaporate: rotate, lower, heat, evacuate; everything off again afterwards."""
    vessel = act.text("vessel")
    speed = act.number("stir_speed", "rotavap.rotation_speed")
    yield act.make(BasicKind.START_ROTATION, vessel=vessel, speed_rpm=speed)
    yield act.make(BasicKind.LOWER_FLASK, vessel=vessel)
    yield from to_temperature(act, default="rotavap.temperature")
    pressure, time = act.number("pressure"), act.number("time")
    is_manual = act.text("mode") == "manual"
    if is_manual:
        act.needs("the time", time)
    yield act.make(BasicKind.START_VACUUM, vessel=vessel, pressure_mbar=pressure)
    yield act.make(
        BasicKind.EVAPORATE, vessel=vessel, seconds=time, is_automatic=act.text("mode") == "auto"
    )
    yield act.make(BasicKind.STOP_VACUUM, vessel=vessel)
    yield act.make(BasicKind.RAISE_FLASK, vessel=vessel)
    yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
    yield act.make(BasicKind.STOP_ROTATION, vessel=vessel)


def filter_through(act: ActReading) -> Operations:
    """FilterThrough: over the filling, then elute the rest after it."""
    source, target, through = act.text("from_vessel"), act.text("to_vessel"), act.text("through")
    way = BUFFER if source == target else target
    yield act.make(BasicKind.TRANSFER, source=source, target=way, through=through)
    residence = act.number("residence_time")
    if residence is not None:
        yield act.make(BasicKind.WAIT, seconds=residence)
    solvent, volume = act.text("eluting_solvent"), act.number("eluting_volume")
    if solvent:
        act.needs("the eluting_volume", volume)
        for _ in range(act.count("eluting_repeats")):
            yield act.make(BasicKind.ADD_LIQUID, reagent=solvent, vessel=source, volume_ml=volume)
            yield act.make(BasicKind.TRANSFER, source=source, target=way, through=through)
    if way != target:
        yield act.make(BasicKind.TRANSFER, source=way, target=target)


def filter_to(act: ActReading) -> Operations:
    """FilterTo: all of it through a filter into another vessel."""
    yield act.make(
        BasicKind.TRANSFER,
        source=act.text("from_vessel"),
        target=act.text("to_vessel"),
        through=act.text("through"),
    )


def dry_dissolved(act: ActReading) -> Operations:
    """DryDissolved: over the drying agent, and the rinse after it."""
    source, target, through = act.text("from_vessel"), act.text("to_vessel"), act.text("through")
    yield act.make(BasicKind.TRANSFER, source=source, target=target, through=through)
    solvent, volume = act.text("rinsing_solvent"), act.number("rinsing_volume")
    if solvent:
        act.needs("the rinsing_volume", volume)
        yield act.make(BasicKind.ADD_LIQUID, reagent=solvent, vessel=source, volume_ml=volume)
        yield act.make(BasicKind.TRANSFER, source=source, target=target, through=through)


def run_column(act: ActReading) -> Operations:
    """RunColumn: over the column into the target; fractions are a matter of the rig."""
    yield act.make(
        BasicKind.RUN_COLUMN,
        source=act.text("from_vessel"),
        target=act.text("to_vessel"),
        through=act.text("column"),
        to_port=act.text("to_port"),
    )


def dissolve(act: ActReading) -> Operations:
    """Dissolve: solvent in, stir, warm when asked, for the time."""
    vessel, volume = act.text("vessel"), act.number("volume")
    act.needs("the amount of solvent", volume)
    yield act.make(
        BasicKind.ADD_LIQUID,
        reagent=act.text("solvent"),
        vessel=vessel,
        volume_ml=volume,
        to_port=act.text("port"),
        aspirate_ml_min=act.number("aspiration_speed"),
        dispense_ml_min=act.number("dispense_speed"),
    )
    speed = act.number("stir_speed", "stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
    if "temp" in act.values:
        yield from to_temperature(act)
    yield act.make(BasicKind.WAIT, seconds=act.number("time", "dissolve.time"))
    if "temp" in act.values:
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)


def precipitate(act: ActReading) -> Operations:
    """Precipitate: stir, come to the temperature, add what precipitates, wait."""
    vessel, reagent = act.text("vessel"), act.text("reagent")
    speed = act.number("stir_speed", "stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
    if "temp" in act.values:
        yield from to_temperature(act)
    if reagent:
        volume = act.number("volume")
        act.needs("the volume", volume)
        over = act.number("add_time")
        yield act.make(
            BasicKind.ADD_LIQUID, reagent=reagent, vessel=vessel, volume_ml=volume, over_s=over
        )
    time = act.number("time")
    if time is not None:
        yield act.make(BasicKind.WAIT, seconds=time)


def recrystallize(act: ActReading) -> Operations:
    """Recrystallize: dissolve hot, hold, cool undisturbed."""
    vessel, volume = act.text("vessel"), act.number("solvent_volume")
    yield act.make(
        BasicKind.ADD_LIQUID, reagent=act.text("solvent"), vessel=vessel, volume_ml=volume
    )
    speed = act.number("stir_speed", "stir_speed")
    yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=speed)
    act.needs("the dissolve_temp", act.values.get("dissolve_temp"))
    yield from to_temperature(act, "dissolve_temp")
    yield act.make(BasicKind.WAIT, seconds=act.number("time"))
    yield act.make(BasicKind.STOP_STIR, vessel=vessel)
    if "crystallize_temp" in act.values:
        yield from to_temperature(act, "crystallize_temp")
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
    else:
        yield from return_to_room_temperature(act)


def distill(act: ActReading) -> Operations:
    """Distill: heat, and collect what comes over."""
    vessel = act.text("vessel")
    pressure, time = act.number("pressure"), act.number("time")
    vapour = act.number("vapour_temp")
    if time is None and vapour is None:
        act.refuse(
            "xdl.left_open", "Distill says neither a time nor a vapour temperature to end at"
        )
    if pressure is not None:
        yield act.make(BasicKind.START_VACUUM, vessel=vessel, pressure_mbar=pressure)
    yield from to_temperature(act)
    yield act.make(
        BasicKind.COLLECT_DISTILLATE,
        vessel=vessel,
        target=act.text("to_vessel"),
        seconds=time,
        vapour_c=vapour,
    )
    yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
    if pressure is not None:
        yield act.make(BasicKind.STOP_VACUUM, vessel=vessel)


def centrifuge(act: ActReading) -> Operations:
    """Centrifuge: spin for the time; what is on top is for a later Transfer."""
    speed: Decimal | None = act.number("speed")
    yield act.make(
        BasicKind.SPIN,
        vessel=act.text("vessel"),
        speed_rpm=speed,
        acceleration_g=act.number("acceleration"),
        temperature_c=act.number("temp"),
        seconds=act.number("time"),
    )
