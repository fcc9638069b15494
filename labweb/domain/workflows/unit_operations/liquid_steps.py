"""The steps that move liquid with a syringe pump, and what lets a confirmation stay out."""

from __future__ import annotations

from dataclasses import replace

from labweb.domain.workflows.unit_operations.unit_operation import (
    Moves,
    StepMatter,
    UnitOperation,
    advanced,
    device,
    port,
    portion,
    quantity,
    solids,
    switch,
    vessel,
)

MAY_STAY_UNCONFIRMED = "may_stay_unconfirmed"

UNCONFIRMED = switch(
    MAY_STAY_UNCONFIRMED,
    "May stay unconfirmed",
    "If the confirmation cannot be read: ticked, the step is complete and marked as unconfirmed; "
    "not ticked, the step is in doubt and a person is asked.",
)
UNCONFIRMED_CLAUSE = f", which may stay unconfirmed{{{MAY_STAY_UNCONFIRMED}}}"
"""Stands in the sentence of a step whose switch is on."""

TRANSFER = UnitOperation(
    kind="transfer",
    matter=StepMatter(moves=Moves.LIQUID, source="source", target="target"),
    label="Transfer",
    help="Move liquid from one vessel to another with a syringe pump.",
    parameters=(
        vessel("source", "From", "Vessel the liquid is drawn from."),
        vessel("target", "To", "Vessel the liquid is poured into."),
        portion("volume", "Volume", "How much is moved, such as 5 mL, or all."),
        advanced(
            quantity(
                "flow_rate",
                "flow_rate",
                "Flow rate",
                "How fast; a full syringe in 20 s when left empty.",
            )
        ),
        replace(
            solids(
                "solids",
                "Solids that go along",
                "What of each solid goes along with the liquid, dissolved or suspended, by the "
                "keys of the lots: salt-1: 200 mg.",
            ),
            is_advanced=True,
        ),
        port("source_port", "From"),
        port("target_port", "To"),
        advanced(device("through", ["cartridge"], "Through", "Cartridge on its way.")),
        advanced(
            device(
                "pump",
                ["syringe_pump"],
                "Pump",
                "The pump that must do it; the one that wastes least when left empty.",
            )
        ),
        advanced(
            quantity(
                "accuracy",
                "share",
                "Accuracy",
                "Largest expanded uncertainty (k = 2) of the volume, such as 1 %; a pump "
                "whose calibration does not reach it is refused.",
            )
        ),
        advanced(
            device(
                "confirm_with",
                ["balance"],
                "Confirm with",
                "Balance that carries the target and must see the mass arrive.",
            )
        ),
        advanced(UNCONFIRMED),
    ),
    clauses=(
        "Transfer {volume} from {source} to {target}",
        " out of port {source_port}",
        " into port {target_port}",
        " through {through}",
        " at {flow_rate}",
        " with {pump}",
        " to within {accuracy}",
        ", confirmed by {confirm_with}",
        UNCONFIRMED_CLAUSE,
    ),
)

EMPTY_SYRINGE = UnitOperation(
    kind="empty_syringe",
    matter=StepMatter(unproved="where the liquid in the syringe came from is not followed"),
    label="Empty the syringe",
    help="Push out everything a syringe holds by the record, in one stroke.",
    parameters=(
        device("pump", ["syringe_pump"], "Pump", "The pump whose syringe is emptied."),
        vessel("target", "Into", "Vessel the liquid is poured into."),
        advanced(
            quantity(
                "flow_rate",
                "flow_rate",
                "Flow rate",
                "How fast; a full syringe in 20 s when left empty.",
            )
        ),
    ),
    clauses=("Empty the syringe of {pump} into {target}", " at {flow_rate}"),
)
