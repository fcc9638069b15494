"""Unit operations of synthesis: what reacts, parts into layers, boils off, stands under gas."""

from __future__ import annotations

from labweb.domain.workflows.unit_operations.unit_operation import (
    Moves,
    ParameterSort,
    StepMatter,
    StepParameter,
    UnitOperation,
    advanced,
    device,
    later,
    lots,
    optional,
    port,
    quantity,
    text,
    vessel,
)

REACT = UnitOperation(
    kind="react",
    matter=StepMatter(
        moves=Moves.REACTION,
        source="vessel",
        target="vessel",
        stated="consumed",
        unproved="it changes solids or gases alone, which are not followed",
    ),
    label="React",
    help="Let a vessel stand until its reaction is over, and record what came of it.",
    parameters=(
        vessel("vessel", "Vessel", "Vessel in which it happens."),
        quantity("duration", "time", "Duration", "How long it takes, such as 2 h."),
        StepParameter(
            name="consumed",
            sort=ParameterSort.AMOUNTS,
            label="Consumed",
            help="What reacts of each lot, by its key: acid-1: 40 uL.",
        ),
        text("product", "Product", "Key of the new lot; no other lot has it."),
        text("material", "Of material", "Key of a material of the lab."),
        optional(quantity("volume", "volume", "Volume made", "For a liquid product.")),
        optional(quantity("mass", "mass", "Mass made", "For a solid product.")),
        optional(
            quantity(
                "residue",
                "mass",
                "Residue",
                "Mass of what was made beside the product; the masses must agree.",
            )
        ),
        optional(
            lots(
                "beside",
                "Made beside it",
                "Other lots, by their new keys: amount and key of a material: 27 mL thf.",
            )
        ),
        optional(
            text("basis", "Yield on", "Key of the lot that gives one of product for one of it.")
        ),
        text("reason", "Known from", "How the amounts are known, such as NMR of run 12."),
    ),
    clauses=(
        "Let {vessel} react for {duration} to {product}",
        ", {volume}",
        ", {mass}",
        ", residue {residue}",
    ),
)

CHEMISTRY_STEPS = (
    UnitOperation(
        kind="start_stir",
        label="Keep stirring",
        help="Stir a vessel from now on; a later step stops it.",
        parameters=(
            vessel("vessel", "Vessel", "Vessel on a stirrer."),
            quantity("stir_speed", "speed", "Speed", "Such as 400 rpm."),
        ),
        clauses=("Keep stirring {vessel} at {stir_speed}",),
    ),
    UnitOperation(
        kind="stop_stir",
        label="Stop stirring",
        help="Stop stirring a vessel; what heats or chills it goes on.",
        parameters=(vessel("vessel", "Vessel", "Vessel on a stirrer."),),
        clauses=("Stop stirring {vessel}",),
    ),
    UnitOperation(
        kind="stop_heat",
        label="Stop heating",
        help="Switch off what heats or chills a vessel; a stirrer goes on.",
        parameters=(vessel("vessel", "Vessel", "Vessel on a heater or chiller."),),
        clauses=("Stop heating {vessel}",),
    ),
    UnitOperation(
        kind="await_temperature",
        label="Wait for a temperature",
        help="Go on once a vessel is warm or cold by itself, as its heater or chiller reads it.",
        parameters=(
            vessel("vessel", "Vessel", "Vessel on a heater or chiller, which is not switched."),
            optional(
                quantity("lowest", "temperature", "At least", "Such as 18 °C; empty: however cold.")
            ),
            optional(
                quantity("highest", "temperature", "At most", "Such as 25 °C; empty: however warm.")
            ),
        ),
        clauses=(
            "Wait for the temperature of {vessel}",
            ", at least {lowest}",
            ", at most {highest}",
        ),
    ),
    UnitOperation(
        kind="separate",
        matter=StepMatter(moves=Moves.LAYER, source="vessel", target="target", stated="lower"),
        label="Draw the lower layer",
        help="Let two layers part, and draw the lower one out at the bottom.",
        parameters=(
            vessel("vessel", "Vessel", "Separator in which they part."),
            vessel("target", "Lower layer to", "Vessel the lower layer is poured into."),
            later(
                lots(
                    "lower",
                    "Lower layer",
                    "What of each lot lies in it, by its key: brine-1: all, thf-1: 2 mL.",
                )
            ),
            quantity("settle_for", "time", "Settle for", "How long they part, such as 5 min."),
            port("target_port", "Lower layer to"),
            advanced(device("through", ["cartridge"], "Through", "Cartridge on its way.")),
            advanced(quantity("flow_rate", "flow_rate", "Flow rate", "How fast it is drawn.")),
            advanced(device("pump", ["syringe_pump"], "Pump", "The pump that must do it.")),
        ),
        clauses=(
            "Let {vessel} settle for {settle_for}, draw its lower layer to {target}",
            " into port {target_port}",
            " through {through}",
            " at {flow_rate}",
            " with {pump}",
        ),
    ),
    UnitOperation(
        kind="evaporate",
        matter=StepMatter(
            moves=Moves.VAPOUR, source="vessel", target="receiver", stated="boils_off"
        ),
        label="Evaporate",
        help="Boil solvents off a rotating flask under vacuum, into the receiving flask.",
        parameters=(
            vessel("vessel", "Vessel", "Flask on a rotary evaporator."),
            vessel("receiver", "Receiver", "Flask that its vapour condenses into."),
            quantity("temperature", "temperature", "Bath", "Such as 40 °C."),
            quantity("pressure", "pressure", "Pressure", "Such as 50 mbar."),
            quantity("speed", "speed", "Rotation", "Such as 120 rpm."),
            quantity("duration", "time", "Duration", "How long, such as 30 min."),
            later(
                lots("boils_off", "Boils off", "What of each lot leaves, by its key: ether-1: all.")
            ),
        ),
        clauses=("Evaporate {vessel} at {temperature} and {pressure} for {duration}",),
    ),
    UnitOperation(
        kind="evacuate_refill",
        label="Evacuate and refill",
        help="Draw the air out of an empty vessel and let a gas in, several times.",
        parameters=(
            vessel("vessel", "Vessel", "Vessel behind a gas valve."),
            device("gas", ["bottle"], "Gas", "Bottle of the gas, at a port of that valve."),
            quantity("pressure", "pressure", "Pressure", "Down to, such as 20 mbar."),
            StepParameter(
                name="rounds", sort=ParameterSort.TEXT, label="Times", help="How often, such as 3."
            ),
            optional(
                quantity("vacuum_for", "time", "Vacuum for", "Keep it evacuated so long each time.")
            ),
            optional(quantity("gas_for", "time", "Gas for", "Let the gas in so long each time.")),
        ),
        clauses=(
            "Evacuate {vessel} to {pressure} and refill it with {gas}, {rounds} times",
            ", vacuum for {vacuum_for}",
            ", gas for {gas_for}",
        ),
    ),
    UnitOperation(
        kind="push_gas",
        matter=StepMatter(moves=Moves.GAS, source="gas", target="target"),
        label="Push with gas",
        help="Push a gas through a syringe into a vessel, with what is left in the tube to it.",
        parameters=(
            device("gas", ["bottle"], "Gas", "Bottle of the gas, at a valve of the pump."),
            vessel("target", "Into", "Vessel that it is pushed into."),
            quantity("volume", "volume", "Volume", "How much gas, such as 2 mL."),
            advanced(
                quantity(
                    "flow_rate",
                    "flow_rate",
                    "Flow rate",
                    "How fast; a full syringe in 20 s when left empty.",
                )
            ),
            advanced(device("pump", ["syringe_pump"], "Pump", "The pump that must do it.")),
        ),
        clauses=("Push {volume} of {gas} into {target}", " at {flow_rate}", " with {pump}"),
    ),
)
"""In the order of the palette."""
