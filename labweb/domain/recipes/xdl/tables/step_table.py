"""Every step of XDL and its properties, and those that published recipes add to it.

One line per step: `name:sort`, then `!` for required and `=text` for the default that XDL
states. `a|b` is a choice, `a|` one of a single value. A default that XDL leaves to the platform is
not written here: it stands in the table of defaults.

Source:
    XDL standard 0.5, 1 and 2.0; step templates of the reference compiler (XDL 0.5.0); attributes
    and steps found in the recipes published with Science 2022, 377, 172 and by others.
"""

from __future__ import annotations

from collections.abc import Mapping

_STIR = "stir:bool={stir} stir_speed:rotation"
_PURPOSE_HEAT = "purpose:control-exotherm|reaction|unstable-reagent"
_PURPOSE_ADD = "purpose:neutralize|precipitate|dissolve|basify|acidify|dilute"

STANDARD: Mapping[str, str] = {
    "Add": "vessel:vessel! reagent:reagent! volume:volume_or_all mass:mass amount:amount"
    f" dropwise:bool=False speed:flow time:time {_STIR.format(stir=False)} viscous:bool=False"
    f" {_PURPOSE_ADD}",
    "AddSolid": "vessel:vessel! reagent:reagent! mass:mass mol:moles amount:amount time:time"
    f" portions:count=1 {_STIR.format(stir=False)}",
    "AddSolidFromDispenser": "vessel:vessel! dispenser:text turns:count! speed:count=100"
    f" driver:1|2=1 {_STIR.format(stir=False)}",
    "Transfer": "from_vessel:vessel! to_vessel:vessel! volume:volume_or_all amount:amount_or_all"
    " time:time viscous:bool=False rinsing_solvent:reagent rinsing_volume:volume"
    " rinsing_repeats:count"
    " solid:bool=False",
    "Separate": "purpose:wash|extract! product_phase:top|bottom! from_vessel:vessel!"
    " separation_vessel:vessel! to_vessel:vessel! waste_phase_to_vessel:vessel solvent:reagent"
    " solvent_volume:volume through:through repeats:count=1 stir_time:time stir_speed:rotation"
    " settling_time:time",
    "Filter": f"vessel:vessel! filtrate_vessel:vessel {_STIR.format(stir=True)} temp:temperature"
    " volume:volume continue_heatchill:bool=False",
    "FilterThrough": "from_vessel:vessel! to_vessel:vessel! through:through!"
    " eluting_solvent:reagent eluting_volume:volume eluting_repeats:count residence_time:time",
    "WashSolid": "vessel:vessel! solvent:reagent! volume:volume filtrate_vessel:vessel"
    " temp:temperature stir:stirring=True stir_speed:rotation time:time repeats:count=1",
    "Dry": "vessel:vessel! time:time pressure:pressure temp:temperature"
    " continue_heatchill:bool=False",
    "Evaporate": "vessel:vessel! pressure:pressure time:time temp:temperature stir_speed:rotation",
    "Dissolve": "vessel:vessel! solvent:reagent! volume:volume amount:amount temp:temperature"
    " time:time stir_speed:rotation",
    "Precipitate": "vessel:vessel! temp:temperature time:time stir_speed:rotation reagent:reagent"
    " volume:volume amount:amount add_time:time",
    "Crystallize": "vessel:vessel! ramp_time:time ramp_temp:temperature",
    "HeatChill": "vessel:vessel! temp:temperature! time:time!"
    f" {_STIR.format(stir=True)} {_PURPOSE_HEAT}",
    "HeatChillToTemp": "vessel:vessel! temp:temperature! active:bool=True"
    f" continue_heatchill:bool=True {_STIR.format(stir=True)} {_PURPOSE_HEAT}",
    "StartHeatChill": f"vessel:vessel! temp:temperature! {_PURPOSE_HEAT}",
    "StopHeatChill": "vessel:vessel!",
    "Stir": "vessel:vessel! time:time! stir_speed:rotation purpose:dissolve|"
    " continue_stirring:bool=False",
    "StartStir": "vessel:vessel! stir_speed:rotation purpose:dissolve|",
    "StopStir": "vessel:vessel!",
    "EvacuateAndRefill": "vessel:vessel! gas:gas repeats:count",
    "Purge": "vessel:vessel! time:time gas:gas pressure:pressure flow_rate:flow",
    "StartPurge": "vessel:vessel! pressure:pressure flow_rate:flow gas:gas",
    "StopPurge": "vessel:vessel!",
    "CleanVessel": "vessel:vessel! solvent:reagent! volume:volume temp:temperature repeats:count",
    "ResetHandling": "solvent:reagent volume:volume repeats:count",
    "RunColumn": "from_vessel:vessel! to_vessel:vessel! column:through!",
    "Irradiate": "vessel:vessel! time:time! wavelength:wavelength"
    " color:red|green|blue|white|UV365|UV395 temp:temperature"
    f" {_STIR.format(stir=True)} LED_power:power LED_intensity:percent cooling_power:percent",
    "Wait": "time:time!",
    "Repeat": "repeats:count",
    "Loop": "",
    "Async": "pid:pid on_finish:text",
    "Await": "pid:pid!",
    "Monitor": "target:vessel! quantity:temperature|pH! min:number max:number",
    "Confirm": "msg:text!",
    "Callback": "fn:text! args:text keyword_args:text",
}
"""Steps of the standard."""

FURTHER: Mapping[str, str] = {
    "HeatChillReturnToRT": f"vessel:vessel! {_STIR.format(stir=True)}",
    "Evacuate": "vessel:vessel! gas:gas repeats:count pressure:pressure",
    "SeparatePhases": "separation_vessel:vessel! lower_phase_vessel:vessel!"
    " upper_phase_vessel:vessel! lower_phase_through:through upper_phase_through:through"
    " dead_volume_through:through"
    " dead_volume_target:vessel lower_phase_port:port upper_phase_port:port"
    " high_conductivity_phase:top|bottom step_volume:volume",
    "FilterTo": "from_vessel:vessel! to_vessel:vessel! through:through",
    "SwitchVacuum": "vessel:vessel! port:port",
    "SwitchArgon": "vessel:vessel! port:port pressure:low|high",
    "CSwitchArgon": "pneumatic_controller:text! port:port! pressure:low|high!",
    "CConnect": "from_vessel:vessel! to_vessel:vessel! from_port:port to_port:port",
    "CMove": "from_vessel:vessel! to_vessel:vessel! volume:volume_or_all! from_port:port"
    " to_port:port through:through move_speed:flow aspiration_speed:flow dispense_speed:flow",
    "MakeSolution": "solute:reagents! solvent:reagent! solute_mass:masses! solvent_volume:volume!"
    " vessel:vessel!",
    "PurgeBackbone": "",
    "Recrystallize": "vessel:vessel! solvent:reagent! solvent_volume:volume! time:time"
    " dissolve_temp:temperature crystallize_temp:temperature",
    "Sonicate": "vessel:vessel! time:time! temp:temperature",
    "Wash": "vessel:vessel! solvent:reagent! volume:volume! separation_vessel:vessel!"
    " to_vessel:vessel! product_phase:top|bottom! repeats:count=1",
    "Extract": "vessel:vessel! solvent:reagent! volume:volume! separation_vessel:vessel!"
    " to_vessel:vessel! product_phase:top|bottom! repeats:count=1",
    "DryDissolved": "from_vessel:vessel! to_vessel:vessel! through:through! rinsing_solvent:reagent"
    " rinsing_volume:volume",
    "Distill": "vessel:vessel! to_vessel:vessel! temp:temperature! vapour_temp:temperature"
    " pressure:pressure time:time",
    "Reflux": f"vessel:vessel! time:time! temp:temperature! {_STIR.format(stir=True)}",
    "AdjustPH": "vessel:vessel! reagent:reagent! pH:ph! step_volume:volume! max_volume:volume!",
    "Centrifuge": "vessel:vessel! time:time! speed:rotation acceleration:rcf temp:temperature",
    "Hydrogenate": "vessel:vessel! time:time! pressure:pressure! temp:temperature"
    f" {_STIR.format(stir=True)}",
    "Microwave": "vessel:vessel! temp:temperature! time:time! power:power"
    f" {_STIR.format(stir=True)}",
}
"""Steps that published recipes and other systems use beside the standard."""

MEANS: Mapping[str, str] = {
    "HeatChillReturnToRT": "let the vessel come to room temperature, then stop heating or chilling",
    "Evacuate": "evacuate the vessel and fill it with inert gas, as EvacuateAndRefill",
    "SeparatePhases": "draw the phases of a separator off one after the other",
    "FilterTo": "move liquid through a filter material into another vessel",
    "SwitchVacuum": "connect the vessel to the vacuum line",
    "SwitchArgon": "connect the vessel to the inert gas line at low or high flow",
    "CSwitchArgon": "connect one port of a pneumatic controller to inert gas",
    "CConnect": "join two vessels by valves and leave them joined",
    "CMove": "one move of liquid by the pumps, without what an Add or a Transfer does around it",
    "MakeSolution": "dissolve weighed solids in a solvent (XDL of 2019)",
    "PurgeBackbone": "flush the transfer lines with inert gas",
    "Recrystallize": "dissolve hot, let crystallize cold",
    "Sonicate": "put the vessel into ultrasound",
    "Wash": "shake out with a liquid that does not take the product",
    "Extract": "shake out with a liquid that takes the product",
    "DryDissolved": "pass a solution over a drying agent",
    "Distill": "heat, and collect what condenses",
    "Reflux": "boil under a condenser",
    "AdjustPH": "add acid or base in portions until a pH is read",
    "Centrifuge": "spin",
    "Hydrogenate": "stir under hydrogen pressure",
    "Microwave": "heat by microwaves",
}
"""What each step beside the standard means."""

EXTENSIONS: Mapping[str, str] = {
    "Add": "port:port through:through move_speed:flow aspiration_speed:flow dispense_speed:flow"
    " prime_n_times:count priming_volume:volume confirm_solid:bool anticlogging:bool"
    " anticlogging_solvent:reagent anticlogging_solvent_volume:volume"
    " anticlogging_reagent_volume:volume flush_tubing:bool",
    "AddSolid": "confirm_solid:bool port:port",
    "RunColumn": "to_port:port",
    "Transfer": "from_port:port to_port:port through:through move_speed:flow aspiration_speed:flow"
    " dispense_speed:flow flush_tubing:bool stir_to_vessel:bool stir_from_vessel:bool"
    " stir_speed:rotation rinse_withdrawal_excess:number",
    "Separate": "from_port:port to_port:port waste_phase_to_port:port remove_dead_volume:bool"
    " dead_volume_through:through",
    "Filter": "wait_time:time aspiration_speed:flow anticlogging:bool",
    "WashSolid": "vacuum_time:time aspiration_speed:flow anticlogging:bool dry_under_vacuum:bool",
    "Dry": "aspiration_speed:flow waste_vessel:vessel",
    "Evaporate": "mode:auto|manual",
    "Dissolve": "port:port aspiration_speed:flow dispense_speed:flow",
    "HeatChillToTemp": "upper_temp_tolerance:temperature_difference"
    " lower_temp_tolerance:temperature_difference wait_recording_speed:number"
    " after_recording_speed:number",
    "Wait": "wait_recording_speed:number after_recording_speed:number",
    "Stir": "wait_recording_speed:number after_recording_speed:number",
    "HeatChillReturnToRT": "wait_recording_speed:number after_recording_speed:number",
    "CleanVessel": "dry:bool",
    "EvacuateAndRefill": "vacuum_pressure:pressure after_vacuum_wait_time:time"
    " after_inert_gas_wait_time:time",
    "FilterThrough": "move_speed:flow aspiration_speed:flow flush_cartridge_vessel:vessel",
}
"""Properties that real files add to steps of the standard."""

EXTENSION_MEANS: Mapping[str, str] = {
    "port": "port of the vessel that the liquid enters by",
    "from_port": "port the liquid leaves by",
    "to_port": "port the liquid enters by",
    "waste_phase_to_port": "port the waste phase enters by",
    "through": "cartridge, or its filling, that the liquid passes",
    "dead_volume_through": "cartridge that the liquid between the phases passes",
    "move_speed": "pump rate between pumps",
    "aspiration_speed": "pump rate while drawing",
    "dispense_speed": "pump rate while pushing",
    "prime_n_times": "how often the line is primed before",
    "priming_volume": "volume of each priming",
    "confirm_solid": "a person confirms that the solid is in",
    "anticlogging": "alternate with solvent so that nothing clogs",
    "anticlogging_solvent": "solvent against clogging",
    "anticlogging_solvent_volume": "solvent between two portions",
    "anticlogging_reagent_volume": "reagent in one portion",
    "flush_tubing": "push gas through the tube after the liquid",
    "stir_to_vessel": "stir the target meanwhile",
    "stir_from_vessel": "stir the source meanwhile",
    "stir_speed": "how fast that stirs",
    "rinse_withdrawal_excess": "factor by which a rinse is drawn beyond its volume",
    "remove_dead_volume": "draw off the liquid between the phases as waste",
    "wait_time": "how long vacuum is kept after the liquid is gone",
    "vacuum_time": "how long vacuum is kept after each wash",
    "dry_under_vacuum": "keep vacuum after the last wash",
    "waste_vessel": "where what drips off goes",
    "mode": "rotary evaporator stops by itself, or after the time",
    "upper_temp_tolerance": "how far above the temperature counts as reached",
    "lower_temp_tolerance": "how far below the temperature counts as reached",
    "wait_recording_speed": "frame rate of the camera while waiting",
    "after_recording_speed": "frame rate of the camera afterwards",
    "dry": "dry the vessel after cleaning",
    "vacuum_pressure": "pressure to evacuate to",
    "after_vacuum_wait_time": "how long vacuum is kept",
    "after_inert_gas_wait_time": "how long gas is let in",
    "flush_cartridge_vessel": "where the flush of the cartridge goes",
}
"""What each added property means."""

RENAMED: Mapping[str, Mapping[str, str]] = {
    "Separate": {"n_separations": "repeats", "product_bottom": "product_phase"},
    "Evaporate": {"rotavap_name": "vessel"},
    "Filter": {"filter_vessel": "vessel"},
    "WashSolid": {"repeat": "repeats", "stir_time": "time"},
    "FilterThrough": {"through_cartridge": "through"},
    "Dry": {"vacuum_pressure": "pressure", "drying_time": "time"},
    "Confirm": {"message": "msg"},
    "Loop": {},
}
"""Properties of XDL before 0.4 → what they are called since."""

RENAMED_VALUES: Mapping[str, Mapping[str, str]] = {
    "product_bottom": {"true": "bottom", "false": "top"},
}
"""Values that changed with the name."""

ONE_OF: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "Add": (("volume", "mass", "amount"),),
    "AddSolid": (("mass", "mol", "amount"),),
    "Dissolve": (("volume", "amount"),),
    "Irradiate": (("wavelength", "color"),),
    "Centrifuge": (("speed", "acceleration"),),
    "Monitor": (("min", "max"),),
}
"""Groups of which a step has at least one."""

AT_MOST_ONE: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "Add": (("volume", "amount"), ("mass", "amount")),
    "AddSolid": (("mass", "amount"), ("mol", "amount")),
    "Transfer": (("volume", "amount"),),
    "Dissolve": (("volume", "amount"),),
    "Precipitate": (("volume", "amount"),),
    "Centrifuge": (("speed", "acceleration"),),
}
"""Groups of which a step has at most one: two amounts would leave open which counts.

An Add with volume and mass adds the volume, as ever: XDL before 1.0 notes the mass beside it.
"""

PARENTS = frozenset({"Repeat", "Loop", "Async"})
"""Steps that hold steps."""

MONITORS = frozenset({"Monitor"})
"""Steps that end a Repeat."""

COMMON = "comment:text queue:text"
"""Properties of every step."""

REAGENT = (
    "name:text id:text inchi:text cas:text role:text=reagent preserve:bool=False"
    " use_for_cleaning:bool=False clean_with:reagent stir:bool=False temp:temperature"
    " atmosphere:text purity:percent solid:bool=False molecular_weight:molar_mass"
    " density:density concentration:concentration molecular_formula:formula comment:text"
    " last_minute_addition:reagent last_minute_addition_volume:volume cleaning_solvent:text"
    " incompatible_reagents:text"
)
"""Properties of a reagent; the last four come from XDL 0.3."""

COMPONENT = "id:text! type:text! chemical:text comment:text"
PARAMETER = "id:text! type:text! value:text min:text max:text comment:text"
METADATA = (
    "description:text publication:text smarts:text product:text product_inchi:text product_cas:text"
    " product_vessel:text reaction_class:text comment:text"
)
SYNTHESIS = (
    "id:text graph_sha256:text auto_clean:bool organic_cleaning_solvent:text"
    " aqueous_cleaning_solvent:text filter_dead_volume_method:text comment:text"
)
"""Attributes of a synthesis; those on cleaning come from XDL 0.1 to 0.3."""

EARLY_COMPONENTS: Mapping[str, str] = {
    "Reactor": "reactor",
    "Flask": "flask",
    "Filter": "filter",
    "Separator": "separator",
    "Rotavap": "rotavap",
    "Cartridge": "cartridge",
    "Column": "column",
    "Waste": "waste",
}
"""Elements that named hardware in 2019 → type of the component."""

PARAMETER_TYPES: Mapping[str, str] = {
    **{"volume": "volume", "mass": "mass", "time": "time", "temperature": "temperature"},
    **{"temp": "temperature", "pressure": "pressure", "rotation_speed": "rotation"},
    **{"stir_speed": "rotation", "amount": "amount", "mol": "moles", "wavelength": "wavelength"},
    **{"flow_rate": "flow", "speed": "flow", "int": "count", "integer": "count"},
    **{"float": "number", "number": "number", "str": "text", "string": "text", "bool": "bool"},
    **{"percentage": "percent", "power": "power"},
}
"""Types a Parameter may have → sort of its value."""

SECTIONS = ("Prep", "Reaction", "Workup", "Purification")
"""Parts of a Procedure, in the order of the work."""

SINCE: Mapping[str, tuple[str, str]] = {
    "Monitor": ("2.0", ""),
    "Irradiate": ("2.0", "color LED_power LED_intensity cooling_power"),
    "Transfer": ("2.0", "amount solid"),
    "Dissolve": ("2.0", "amount"),
    "Precipitate": ("2.0", "amount"),
    "Add": ("1.0", "amount mass"),
    "AddSolid": ("1.0", "amount"),
}
"""Step → version since which the properties count; no properties: the step itself."""

REAGENT_SINCE_1 = frozenset(
    {"solid", "molecular_weight", "density", "concentration", "molecular_formula"}
)
"""Properties of a reagent since 1.0."""
