"""What each role is asked to do while its instrument falls silent or loses its power."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from drivers.base import Driver
from drivers.load import read_spec, read_status
from tests.drivers.conformance.placed_models import Action, Case


@dataclass(frozen=True, kw_only=True)
class Deed:
    """One action, and the moment in it at which the fault strikes."""

    act: Action

    first: tuple[Action, ...] = ()
    """What is done before, while the instrument is well; what is so already, it refuses."""

    during: Action | None = None
    """What goes on meanwhile, on a thread of its own: it begins while the instrument is well."""

    reading: str = ""
    """Status whose value is its `temperature_c`: where it stands by then."""

    below_k: float = 0.0
    """How far below that: what is set so already has nothing to begin."""

    is_harmless: bool = False
    """It changes nothing but what is told: whatever fails, nothing was done."""

    after: int | None = None
    """It strikes in the answer behind so many; None: as the instrument begins or ends something."""

    @property
    def name(self) -> str:
        return self.act[0]

    def asked_of(self, device: Driver[Any, Any]) -> Action:
        """Return the action with all its arguments."""
        name, arguments = self.act
        if not self.reading:
            return self.act
        wanted_c = read_status(device, self.reading) - self.below_k
        return name, {**arguments, "temperature_c": round(wanted_c, 1)}

    @property
    def moment(self) -> dict[str, Any]:
        """Say to the simulated instrument when."""
        return {"in_act": True} if self.after is None else {"after_commands": self.after}


def _alone(*names: str, after: int | None = None) -> tuple[Deed, ...]:
    return tuple(Deed(act=(name, {}), after=after) for name in names)


WARM: Action = ("heat_to", {"temperature_c": 40.0, "tolerance_c": 5.0})
STIR: Action = ("stir", {"speed_rpm": 300.0})
TEMPER: Action = ("reach_temperature", {"temperature_c": 40.0, "tolerance_c": 5.0})
RAMP: Action = ("ramp_to", {"temperature_c": 40.0, "ramp_k_min": 0.0, "tolerance_c": 5.0})
BATH: Action = ("heat_bath_to", {"temperature_c": 40.0, "tolerance_c": 5.0})
ROTATE: Action = ("rotate", {"speed_rpm": 100.0})
SHAKE: Action = ("shake", {"speed_rpm": 500.0, "ramp_s": 1.0})
EVACUATE: Action = ("evacuate_to", {"pressure_kpa": 60.0, "tolerance_kpa": 5.0})
SUPPLY: Action = ("supply", {"voltage_v": 2.0, "current_ma": 3000.0})
MEASURE: Action = ("measure", {})
STORE: Action = ("store_plate", {"slot_index": 1})
RETRIEVE: Action = ("retrieve_plate", {"slot_index": 1})
GRIP: Action = ("grip", {"width_mm": 10.0, "speed_mm_s": 50.0, "force_n": 50.0})
JOB: Action = ("run_job", {"job": "wait", "input_text": "0 1", "limit_s": 900.0})
OFTEN = {"duration_s": 100.0, "interval_s": 0.1}
SWEEP = {"first_v": -0.2, "step_v": 0.01, "rate_v_s": 0.01}
HOME: Action = ("initialize", {})
PICK: Action = ("pick_up_tip", {"slot": "1", "well": "A1"})
STROKE = {"volume_ul": 50.0, "rate_ul_s": 50.0}
DRAW: Action = ("aspirate", {"slot": "2", "well": "A1", **STROKE})
GIVE: Action = ("dispense", {"slot": "3", "well": "A1", **STROKE})
MOVE: Action = (
    "transfer_liquid",
    {
        **{"source_slot": "2", "source_well": "A1", "target_slot": "3", "target_well": "A1"},
        **STROKE,
    },
)
HOLDING = Deed(act=("hold", {"duration_s": 5.0, "tolerance_c": 8.0}), reading="temperature_c")
CONTROLLING = (
    Deed(act=TEMPER),
    replace(HOLDING, first=(TEMPER,), below_k=6.0),
    Deed(act=("stop_control", {}), first=(TEMPER,)),
)
FLOW: Action = (
    "start_flow",
    {
        "rate_ul_s": 500.0,
        "line_1_ratio": 0.5,
        "line_2_ratio": 0.5,
        "line_3_ratio": 0.0,
        "line_4_ratio": 0.0,
    },
)

DEEDS: dict[str, tuple[Deed, ...]] = {
    "heater_stirrer": (
        Deed(act=WARM),
        HOLDING,
        Deed(act=("stop_heating", {}), first=(WARM,)),
        Deed(act=STIR),
        Deed(act=("stop_stirring", {}), first=(STIR,)),
    ),
    "stirrer": (Deed(act=STIR), Deed(act=("stop_stirring", {}), first=(STIR,))),
    "rotary_evaporator": (
        Deed(act=BATH),
        Deed(act=("stop_heating", {}), first=(BATH,)),
        Deed(act=ROTATE),
        Deed(act=("stop_rotating", {}), first=(ROTATE,)),
        Deed(act=("raise_flask", {}), first=(("lower_flask", {}),)),
        Deed(act=("lower_flask", {}), first=(("raise_flask", {}),)),
    ),
    "thermostat": CONTROLLING,
    "temperature_controller": CONTROLLING,
    "shaker": (
        Deed(act=SHAKE),
        Deed(act=("stop_shaking", {}), first=(SHAKE,)),
        Deed(act=("lock_plate", {}), first=(("unlock_plate", {}),)),
        Deed(act=("unlock_plate", {}), first=(("lock_plate", {}),)),
    ),
    "furnace": (
        Deed(act=RAMP),
        HOLDING,
        Deed(act=("stop_heating", {}), first=(RAMP,)),
        Deed(act=("acknowledge_alarm", {}), after=0, is_harmless=True),
    ),
    "vacuum_controller": (
        Deed(act=EVACUATE, first=(("vent", {}),)),
        Deed(act=("stop_pump", {}), after=0),
        Deed(act=("vent", {}), first=(EVACUATE,)),
    ),
    "separator": (
        Deed(act=("stir", {"speed_rpm": 300.0, "duration_s": 5.0})),
        Deed(act=("drain_lower_phase", {"volume_ul": 2000.0, "reading": "falls"})),
        *_alone("close_drain", "confirm_drain_closed", after=0),
    ),
    "power_supply": (Deed(act=SUPPLY), Deed(act=("stop_supply", {}), first=(SUPPLY,))),
    "chromatography": (
        Deed(act=FLOW),
        Deed(act=("stop_flow", {}), first=(FLOW,)),
        Deed(
            act=("select_position", {"position": "separation"}),
            first=(("select_position", {"position": "load"}),),
        ),
        Deed(act=("collect", {"target": "waste"}), after=1),
    ),
    "storage": (
        *_alone("initialize"),
        Deed(act=STORE, first=(("initialize", {}), RETRIEVE)),
        Deed(act=RETRIEVE, first=(("initialize", {}), STORE)),
    ),
    "arm": (
        Deed(act=("run_program", {"program": "pick.urp"})),
        *_alone("stop_program", after=0),
    ),
    "agv": (Deed(act=("drive_to", {"station": "LM3"})), *_alone("stop_driving", after=0)),
    "gripper": (
        *_alone("initialize"),
        Deed(act=GRIP, first=(("initialize", {}),)),
        Deed(
            act=("release", {"width_mm": 60.0, "speed_mm_s": 50.0}),
            first=(("initialize", {}), GRIP),
        ),
    ),
    "gantry": (
        *_alone("initialize"),
        Deed(
            act=("move_to", {"x_mm": -50.0, "y_mm": -50.0, "z_mm": -20.0, "speed_mm_s": 10.0}),
            first=(("initialize", {}),),
        ),
        *_alone("stop_moving", after=0),
    ),
    "balance": (
        Deed(act=("tare", {}), after=1),
        Deed(act=("weigh", {}), after=0, is_harmless=True),
    ),
    "showing": (
        Deed(act=("show_itself", {"text": "B 2", "shown_s": 1.0}), after=0, is_harmless=True),
    ),
    "ph_sensor": (Deed(act=MEASURE, after=0, is_harmless=True),),
    "temperature_sensor": (Deed(act=MEASURE, after=0, is_harmless=True),),
    "flow_sensor": (Deed(act=MEASURE, after=0, is_harmless=True),),
    "conductivity_sensor": (Deed(act=MEASURE, after=0, is_harmless=True),),
    "spectrometer": (Deed(act=("shim", {"extent": "quick"})),),
    "analyser": _alone("stop_measuring", after=0),
    "potentiostat": (
        Deed(act=("measure_open_circuit", OFTEN), after=0),
        Deed(act=("hold_potential", {"potential_v": 0.5, **OFTEN})),
        Deed(act=("sweep_linear", {**SWEEP, "last_v": 0.6})),
        Deed(
            act=(
                "sweep_cyclic",
                {**SWEEP, "vertex_1_v": 0.6, "vertex_2_v": -0.4, "cycles_count": 2},
            )
        ),
        *_alone("stop_measuring", after=0),
    ),
    "plate_reader": (
        Deed(
            act=("read_absorbance", {"wavelengths_nm": [450, 600]}), first=(("close_drawer", {}),)
        ),
        Deed(act=("open_drawer", {}), first=(("close_drawer", {}),)),
        Deed(act=("close_drawer", {}), first=(("open_drawer", {}),)),
    ),
    "liquid_handler": (
        Deed(act=HOME),
        Deed(act=PICK, first=(HOME,)),
        Deed(act=("drop_tip", {}), first=(HOME, PICK)),
        Deed(act=DRAW, first=(HOME, PICK)),
        Deed(act=GIVE, first=(HOME, PICK, DRAW)),
        Deed(act=MOVE, first=(HOME, PICK)),
    ),
    "compute": (Deed(act=JOB), Deed(act=("cancel_job", {}), during=JOB)),
    "battery_tester": (
        *_alone("stop_test"),
        Deed(act=("await_end", {"duration_s": 60.0}), after=0, is_harmless=True),
    ),
}
"""What every driver of a role does; what a model does in its own words is its case's own act."""


NOT_MET = {
    ("magritek_spinsolve", "stop_measuring"): "an abort is answered only while it measures: "
    "silence is what it says when it has nothing to end, and none of it touches matter"
}
"""What cannot be told from its opposite on the wire, by model and action, with the reason."""


def deeds_of(case: Case) -> Iterator[Deed]:
    """List what a driver is asked for: the deeds of its roles, and its case's own act."""
    spec = read_spec(case.dotted)
    found = {deed.name: deed for role in spec.roles for deed in DEEDS.get(role, ())}
    if case.act[0] not in found:
        found[case.act[0]] = Deed(act=case.act)
    for name, deed in found.items():
        own = case.act if case.act[0] == "start_test" and name == "stop_test" else None
        yield replace(deed, first=(own,)) if own else deed
