"""Expansions that bring material in or move it."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import ROUND_DOWN, Decimal

from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import WASTE, BasicKind, BasicOperation
from labweb.domain.recipes.xdl.expansion.stir_heat_light_gas import stirring
from labweb.domain.recipes.xdl.unfolding.reagent_amounts import GRAIN

Operations = Iterator[BasicOperation]


def add(act: ActReading) -> Operations:
    """Add: stir when asked, then add liquid or solid. A solid is known by its mass."""
    yield from stirring(act, "vessel")
    yield from _dispense(act, "reagent", "volume")


def add_solid(act: ActReading) -> Operations:
    """AddSolid: stir when asked, then add in equal portions, spread over the time."""
    yield from stirring(act, "vessel")
    mass, time, portions = act.number("mass"), act.number("time"), act.rounds("portions")
    act.needs("the mass", mass)
    share = None if mass is None else mass / max(portions, 1)
    if share is not None and share >= GRAIN:
        share = share.quantize(GRAIN, ROUND_DOWN)
    for portion in range(portions):
        if mass is not None and share is not None and portion == portions - 1:
            # The last is what is left, so that all together are the mass.
            share = mass - share * portion
        if portion and time is not None:
            yield act.make(BasicKind.WAIT, seconds=time / (portions - 1))
        yield act.make(
            BasicKind.ADD_SOLID,
            reagent=act.text("reagent"),
            vessel=act.text("vessel"),
            mass_g=share,
            over_s=time if portions == 1 else None,
        )


def add_from_dispenser(act: ActReading) -> Operations:
    """AddSolidFromDispenser: a number of turns says no mass, so no ledger can follow it."""
    act.refuse("xdl.left_open", "turns of a dispenser say no mass: calibrate it and write AddSolid")
    yield from ()


def transfer(act: ActReading) -> Operations:
    """Transfer: move, then rinse the source into the target as often as asked."""
    source, target = act.text("from_vessel"), act.text("to_vessel")
    volume = act.number("volume")
    if not act.is_all("volume") and not act.is_all("amount"):
        act.needs("the volume", volume)
    if act.flag("stir_to_vessel"):
        yield act.make(BasicKind.START_STIR, vessel=target, speed_rpm=_stir_speed(act))
    yield act.make(
        BasicKind.TRANSFER,
        source=source,
        target=target,
        volume_ml=volume,
        through=act.text("through"),
        from_port=act.text("from_port"),
        to_port=act.text("to_port"),
        over_s=act.number("time"),
        aspirate_ml_min=act.number("aspiration_speed"),
        dispense_ml_min=act.number("dispense_speed"),
        is_viscous=act.flag("viscous"),
    )
    solvent, rinse = act.text("rinsing_solvent"), act.number("rinsing_volume")
    if not solvent:
        return
    act.needs("the rinsing_volume", rinse)
    for _ in range(act.count("rinsing_repeats")):
        yield act.make(BasicKind.ADD_LIQUID, reagent=solvent, vessel=source, volume_ml=rinse)
        yield act.make(BasicKind.TRANSFER, source=source, target=target)


def move(act: ActReading) -> Operations:
    """CMove: one move and nothing around it."""
    volume = act.number("volume")
    yield act.make(
        BasicKind.TRANSFER,
        source=act.text("from_vessel"),
        target=act.text("to_vessel"),
        volume_ml=volume,
        from_port=act.text("from_port"),
        to_port=act.text("to_port"),
        through=act.text("through"),
    )


def make_solution(act: ActReading) -> Operations:
    """MakeSolution: solids first, then the solvent."""
    solutes, masses = act.values.get("solute"), act.values.get("solute_mass")
    names = solutes if isinstance(solutes, tuple) else ()
    weights = masses if isinstance(masses, tuple) else ()
    if len(names) != len(weights):
        act.refuse("xdl.left_open", f"{len(names)} solutes have {len(weights)} masses")
        return
    for name, weight in zip(names, weights, strict=True):
        mass = getattr(weight, "exact", None)
        act.needs("one mass", mass)
        yield act.make(
            BasicKind.ADD_SOLID, reagent=str(name), vessel=act.text("vessel"), mass_g=mass
        )
    yield act.make(
        BasicKind.ADD_LIQUID,
        reagent=act.text("solvent"),
        vessel=act.text("vessel"),
        volume_ml=act.number("solvent_volume"),
    )


def reset_handling(act: ActReading) -> Operations:
    """ResetHandling: flush the transfer lines."""
    yield act.make(
        BasicKind.RINSE_LINES,
        solvent=act.text("solvent"),
        volume_ml=act.number("volume"),
        repeats=act.rounds(),
    )


def purge_backbone(act: ActReading) -> Operations:
    """PurgeBackbone: gas through the transfer lines."""
    yield act.make(BasicKind.FLUSH_LINES)


def clean_vessel(act: ActReading) -> Operations:
    """CleanVessel: solvent in, stirred, out to waste, as often as asked."""
    vessel, volume = act.text("vessel"), act.number("volume")
    act.needs("the volume", volume)
    temperature = act.window("temp") if "temp" in act.values else None
    yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=_stir_speed(act))
    if temperature is not None:
        setpoint, low, high = temperature
        yield act.make(BasicKind.SET_TEMPERATURE, vessel=vessel, temperature_c=setpoint)
        yield act.make(BasicKind.AWAIT_TEMPERATURE, vessel=vessel, low_c=low, high_c=high)
    for _ in range(act.rounds(default="clean_vessel.repeats")):
        yield act.make(
            BasicKind.ADD_LIQUID, reagent=act.text("solvent"), vessel=vessel, volume_ml=volume
        )
        yield act.make(BasicKind.WAIT, seconds=act.number("time", "clean_vessel.time"))
        yield act.make(BasicKind.TRANSFER, source=vessel, target=WASTE)
    if temperature is not None:
        yield act.make(BasicKind.STOP_TEMPERATURE, vessel=vessel)
    yield act.make(BasicKind.STOP_STIR, vessel=vessel)


def adjust_ph(act: ActReading) -> Operations:
    """AdjustPH: stir, and add in steps until the pH is read; never more than allowed."""
    vessel = act.text("vessel")
    yield act.make(BasicKind.START_STIR, vessel=vessel, speed_rpm=_stir_speed(act))
    yield act.make(
        BasicKind.ADJUST,
        vessel=vessel,
        reagent=act.text("reagent"),
        ph=act.number("pH"),
        step_ml=act.number("step_volume"),
        most_ml=act.number("max_volume"),
        tolerance=act.number("tolerance", "adjust_ph.tolerance"),
        mixing_s=act.number("mixing_time", "adjust_ph.mixing_time"),
    )


def _dispense(act: ActReading, reagent: str, volume: str) -> Operations:
    millilitres = act.number(volume)
    is_measured = millilitres is not None or act.is_all(volume)
    grams = None if is_measured else act.number("mass")
    if grams is not None:
        yield act.make(
            BasicKind.ADD_SOLID,
            reagent=act.text(reagent),
            vessel=act.text("vessel"),
            mass_g=grams,
            over_s=act.number("time"),
        )
        return
    if not act.is_all(volume):
        act.needs("the amount", millilitres)
    yield act.make(
        BasicKind.ADD_LIQUID,
        reagent=act.text(reagent),
        vessel=act.text("vessel"),
        volume_ml=millilitres,
        over_s=act.number("time"),
        rate_ml_min=act.number("speed"),
        aspirate_ml_min=act.number("aspiration_speed"),
        dispense_ml_min=act.number("dispense_speed"),
        is_dropwise=act.flag("dropwise"),
        is_viscous=act.flag("viscous"),
        through=act.text("through"),
        to_port=act.text("port"),
    )


def _stir_speed(act: ActReading) -> Decimal | None:
    return act.number("stir_speed", "stir_speed")
