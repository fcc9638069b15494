"""Unit operations on solids: what is filtered off, what is dried."""

from __future__ import annotations

from labweb.domain.workflows.unit_operations.unit_operation import (
    Moves,
    StepMatter,
    UnitOperation,
    advanced,
    device,
    lots,
    optional,
    quantity,
    solids,
    vessel,
)

SOLID_STEPS = (
    UnitOperation(
        kind="filter",
        matter=StepMatter(moves=Moves.FILTRATE, source="vessel", target="target", stated="stays"),
        label="Filter",
        help="Draw all liquid of a filter off at its bottom; the solids stay on it as stated.",
        parameters=(
            vessel("vessel", "Filter", "Filter that is drawn empty."),
            vessel("target", "Filtrate to", "Vessel the liquid is poured into."),
            solids(
                "stays",
                "Stays",
                "What of each solid stays on the filter, by the keys of the lots: salt-1: all.",
            ),
            advanced(quantity("flow_rate", "flow_rate", "Flow rate", "How fast it is drawn.")),
            advanced(device("pump", ["syringe_pump"], "Pump", "The pump that must do it.")),
        ),
        clauses=("Filter {vessel} into {target}", " at {flow_rate}", " with {pump}"),
    ),
    UnitOperation(
        kind="dry",
        matter=StepMatter(
            moves=Moves.VAPOUR, source="vessel", target="receiver", stated="dries_off"
        ),
        label="Dry",
        help="Keep a vessel under vacuum for a time, then let air in.",
        parameters=(
            vessel("vessel", "Vessel", "Vessel that a vacuum controller is joined to."),
            quantity("pressure", "pressure", "Pressure", "Such as 50 mbar."),
            quantity("duration", "time", "Duration", "How long, such as 30 min."),
            optional(
                lots(
                    "dries_off",
                    "Dries off",
                    "What of each lot leaves, by its key: ether-1: all. Empty: no liquid is in it.",
                )
            ),
            optional(vessel("receiver", "Receiver", "Vessel that what dries off condenses in.")),
        ),
        clauses=(
            "Dry {vessel} at {pressure} for {duration}",
            ", into {receiver}",
        ),
    ),
)
"""In the order of the palette."""
