"""Every unit operation: its needs, conditions before and after, effect on contents, hazards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from labweb.domain.recipes.xdl.expansion import (
    add_and_transfer,
    separate_and_purify,
    stir_heat_light_gas,
)
from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation, ContentsEffect


class Need(StrEnum):
    """What a rig must offer at the vessel."""

    STIRRER = "stirrer"
    THERMOSTAT = "heater or chiller that covers the temperature"
    VACUUM = "vacuum"
    INERT_GAS = "inert gas"
    GAS = "the gas"
    FILTER = "filter"
    SEPARATOR = "separator with a top and a bottom port"
    ROTAVAP = "rotary evaporator"
    CARTRIDGE = "cartridge with the filling"
    COLUMN = "column"
    LAMP = "lamp of the colour"
    ULTRASOUND = "ultrasound"
    CENTRIFUGE = "centrifuge"
    MICROWAVE = "microwave"
    CONDENSER = "condenser"
    PRESSURE_VESSEL = "vessel that bears the pressure"
    SENSOR = "sensor of the quantity"
    LIQUID_ROUTE = "route for liquid"
    PERSON = "person, or a dispenser of solids"


class VesselState(StrEnum):
    """What is true of a vessel before or after."""

    HOLDS_ENOUGH = "the source holds as much"
    HAS_ROOM = "the target has room for it"
    HOLDS_SOLID = "the vessel holds a solid"
    HOLDS_LIQUID = "the vessel holds liquid"
    HOLDS_TWO_PHASES = "the vessel holds two liquid phases"
    NOT_UNDER_PRESSURE = "the vessel is at ambient pressure"
    STIRRED = "the vessel is stirred"
    NOT_STIRRED = "the vessel is not stirred"
    AT_TEMPERATURE = "the vessel is at the temperature"
    NOT_HEATED = "the vessel is neither heated nor chilled"
    UNDER_GAS = "the vessel is under the gas"
    UNDER_VACUUM = "the vessel is under vacuum"
    EMPTY = "the vessel is empty"
    DRY = "what is in the vessel is dry"
    CLEAN = "the vessel is clean"
    BELOW_BOILING = "the temperature is below the boiling point, or a condenser is on"
    PARTED = "each part is where the step says"
    KNOWN = "the reading is on record"
    NOTHING = ""


class Hazard(StrEnum):
    """What a person should think of."""

    EXOTHERM = "heat of reaction or mixing"
    OVERFLOW = "overflow or foam"
    OVERPRESSURE = "pressure in a closed vessel"
    IMPLOSION = "glass under vacuum"
    FIRE = "flammable vapour near a hot part"
    COLD = "cold surfaces; liquids that freeze in a line"
    HOT = "hot surfaces"
    LIGHT = "strong or ultraviolet light"
    GAS_RELEASE = "gas set free"
    HYDROGEN = "hydrogen"
    DUST = "dust while a solid is weighed in"
    PEROXIDES = "peroxides when ethers are boiled down"
    LOSS = "product in the wrong phase"
    SPIN = "rotating mass out of balance"


Expand = Callable[[ActReading], Iterator[BasicOperation]]


@dataclass(frozen=True, slots=True)
class Operation:
    """One unit operation as data."""

    expand: Expand | None
    """None: it holds other steps and is not itself an operation."""

    needs: tuple[Need, ...] = ()
    before: tuple[VesselState, ...] = ()
    after: tuple[VesselState, ...] = ()
    effect: ContentsEffect = ContentsEffect.NONE
    hazards: tuple[Hazard, ...] = ()


_N, _S, _H, _E = Need, VesselState, Hazard, ContentsEffect
_a, _c, _i = add_and_transfer, stir_heat_light_gas, separate_and_purify
_HEATING = (_H.HOT, _H.OVERPRESSURE, _H.FIRE, _H.COLD)
_HEAT_NEEDS = (_N.THERMOSTAT, _N.STIRRER)
_SUCK = (_N.FILTER, _N.VACUUM)

OPERATIONS: Mapping[str, Operation] = {
    "Add": Operation(
        _a.add,
        (_N.LIQUID_ROUTE,),
        (_S.HOLDS_ENOUGH, _S.HAS_ROOM, _S.NOT_UNDER_PRESSURE),
        (),
        _E.ADDS,
        (_H.EXOTHERM, _H.OVERFLOW, _H.GAS_RELEASE),
    ),
    "AddSolid": Operation(
        _a.add_solid,
        (_N.PERSON,),
        (_S.HAS_ROOM, _S.NOT_UNDER_PRESSURE),
        (),
        _E.ADDS,
        (_H.EXOTHERM, _H.DUST, _H.GAS_RELEASE),
    ),
    "AddSolidFromDispenser": Operation(
        _a.add_from_dispenser, (_N.PERSON,), (_S.HAS_ROOM,), (), _E.ADDS, (_H.EXOTHERM, _H.DUST)
    ),
    "Transfer": Operation(
        _a.transfer,
        (_N.LIQUID_ROUTE,),
        (_S.HOLDS_ENOUGH, _S.HAS_ROOM, _S.NOT_UNDER_PRESSURE),
        (),
        _E.MOVES,
        (_H.EXOTHERM, _H.OVERFLOW),
    ),
    "CMove": Operation(
        _a.move, (_N.LIQUID_ROUTE,), (_S.HOLDS_ENOUGH, _S.HAS_ROOM), (), _E.MOVES, (_H.OVERFLOW,)
    ),
    "MakeSolution": Operation(
        _a.make_solution,
        (_N.PERSON, _N.LIQUID_ROUTE),
        (_S.HAS_ROOM,),
        (_S.HOLDS_LIQUID,),
        _E.ADDS,
        (_H.EXOTHERM, _H.DUST),
    ),
    "Dissolve": Operation(
        _i.dissolve,
        (_N.LIQUID_ROUTE, _N.STIRRER, _N.THERMOSTAT),
        (_S.HOLDS_SOLID, _S.HAS_ROOM),
        (_S.HOLDS_LIQUID, _S.STIRRED),
        _E.ADDS,
        (_H.EXOTHERM, *_HEATING),
    ),
    "Precipitate": Operation(
        _i.precipitate,
        (_N.STIRRER, _N.THERMOSTAT, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.HOLDS_SOLID, _S.STIRRED),
        _E.ADDS,
        (_H.EXOTHERM, _H.COLD),
    ),
    "Crystallize": Operation(
        _c.crystallize,
        (_N.THERMOSTAT,),
        (_S.HOLDS_LIQUID,),
        (_S.HOLDS_SOLID, _S.AT_TEMPERATURE, _S.NOT_STIRRED),
        _E.CHANGES,
        (_H.COLD,),
    ),
    "Recrystallize": Operation(
        _i.recrystallize,
        (_N.LIQUID_ROUTE, _N.STIRRER, _N.THERMOSTAT),
        (_S.HOLDS_SOLID, _S.HAS_ROOM, _S.BELOW_BOILING),
        (_S.HOLDS_SOLID, _S.NOT_HEATED),
        _E.ADDS,
        _HEATING,
    ),
    "Stir": Operation(
        _c.stir, (_N.STIRRER,), (_S.HOLDS_LIQUID,), (_S.NOT_STIRRED,), _E.CHANGES, (_H.EXOTHERM,)
    ),
    "StartStir": Operation(
        _c.start_stir, (_N.STIRRER,), (), (_S.STIRRED,), _E.CHANGES, (_H.EXOTHERM,)
    ),
    "StopStir": Operation(_c.stop_stir, (_N.STIRRER,), (), (_S.NOT_STIRRED,)),
    "HeatChill": Operation(
        _c.heat_chill,
        _HEAT_NEEDS,
        (_S.HOLDS_LIQUID, _S.BELOW_BOILING),
        (_S.NOT_HEATED,),
        _E.CHANGES,
        (_H.EXOTHERM, *_HEATING),
    ),
    "HeatChillToTemp": Operation(
        _c.heat_chill_to_temp,
        _HEAT_NEEDS,
        (_S.HOLDS_LIQUID, _S.BELOW_BOILING),
        (_S.AT_TEMPERATURE,),
        _E.CHANGES,
        _HEATING,
    ),
    "HeatChillReturnToRT": Operation(
        _c.return_to_room_temperature, _HEAT_NEEDS, (), (_S.NOT_HEATED,), _E.CHANGES
    ),
    "StartHeatChill": Operation(
        _c.start_heat_chill, (_N.THERMOSTAT,), (_S.BELOW_BOILING,), (), _E.CHANGES, _HEATING
    ),
    "StopHeatChill": Operation(_c.stop_heat_chill, (_N.THERMOSTAT,), (), (_S.NOT_HEATED,)),
    "Reflux": Operation(
        _c.reflux,
        (*_HEAT_NEEDS, _N.CONDENSER),
        (_S.HOLDS_LIQUID,),
        (_S.NOT_HEATED,),
        _E.CHANGES,
        (_H.EXOTHERM, *_HEATING),
    ),
    "Microwave": Operation(
        _c.microwave,
        (_N.MICROWAVE, _N.PRESSURE_VESSEL),
        (_S.HOLDS_LIQUID,),
        (),
        _E.CHANGES,
        (_H.OVERPRESSURE, _H.HOT),
    ),
    "Sonicate": Operation(
        _c.sonicate, (_N.ULTRASOUND,), (_S.HOLDS_LIQUID,), (), _E.CHANGES, (_H.HOT,)
    ),
    "Irradiate": Operation(
        _c.irradiate,
        (_N.LAMP, _N.STIRRER, _N.THERMOSTAT),
        (_S.HOLDS_LIQUID,),
        (),
        _E.CHANGES,
        (_H.LIGHT, _H.HOT),
    ),
    "Hydrogenate": Operation(
        _c.hydrogenate,
        (_N.PRESSURE_VESSEL, _N.GAS, _N.INERT_GAS, _N.STIRRER),
        (_S.HOLDS_LIQUID, _S.NOT_UNDER_PRESSURE),
        (_S.UNDER_GAS,),
        _E.CHANGES,
        (_H.HYDROGEN, _H.OVERPRESSURE, _H.FIRE),
    ),
    "EvacuateAndRefill": Operation(
        _c.evacuate_and_refill,
        (_N.VACUUM, _N.INERT_GAS),
        (_S.NOT_UNDER_PRESSURE,),
        (_S.UNDER_GAS,),
        _E.REMOVES,
        (_H.IMPLOSION, _H.OVERFLOW),
    ),
    "Evacuate": Operation(
        _c.evacuate_and_refill,
        (_N.VACUUM, _N.INERT_GAS),
        (_S.NOT_UNDER_PRESSURE,),
        (_S.UNDER_GAS,),
        _E.REMOVES,
        (_H.IMPLOSION, _H.OVERFLOW),
    ),
    "Purge": Operation(
        _c.purge, (_N.GAS,), (_S.NOT_UNDER_PRESSURE,), (_S.UNDER_GAS,), _E.NONE, (_H.OVERPRESSURE,)
    ),
    "StartPurge": Operation(
        _c.start_purge, (_N.GAS,), (), (_S.UNDER_GAS,), _E.NONE, (_H.OVERPRESSURE,)
    ),
    "StopPurge": Operation(_c.stop_purge, (_N.GAS,)),
    "SwitchVacuum": Operation(
        _c.switch_vacuum, (_N.VACUUM,), (), (_S.UNDER_VACUUM,), _E.REMOVES, (_H.IMPLOSION,)
    ),
    "SwitchArgon": Operation(
        _c.switch_argon, (_N.INERT_GAS,), (), (_S.UNDER_GAS,), _E.NONE, (_H.OVERPRESSURE,)
    ),
    "CSwitchArgon": Operation(
        _c.switch_argon, (_N.INERT_GAS,), (), (_S.UNDER_GAS,), _E.NONE, (_H.OVERPRESSURE,)
    ),
    "CConnect": Operation(_c.connect, (_N.LIQUID_ROUTE,)),
    "Separate": Operation(
        _i.separate,
        (_N.SEPARATOR, _N.STIRRER, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED, _S.NOT_STIRRED),
        _E.SPLITS,
        (_H.GAS_RELEASE, _H.LOSS),
    ),
    "SeparatePhases": Operation(
        _i.separate_phases,
        (_N.SEPARATOR, _N.LIQUID_ROUTE),
        (_S.HOLDS_TWO_PHASES,),
        (_S.PARTED,),
        _E.SPLITS,
        (_H.LOSS,),
    ),
    "Wash": Operation(
        _i.shake_out,
        (_N.SEPARATOR, _N.STIRRER, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED,),
        _E.SPLITS,
        (_H.GAS_RELEASE, _H.LOSS),
    ),
    "Extract": Operation(
        _i.shake_out,
        (_N.SEPARATOR, _N.STIRRER, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED,),
        _E.SPLITS,
        (_H.GAS_RELEASE, _H.LOSS),
    ),
    "Filter": Operation(
        _i.filter_off,
        (*_SUCK, _N.STIRRER),
        (_S.HOLDS_SOLID,),
        (_S.PARTED, _S.NOT_STIRRED),
        _E.SPLITS,
        (_H.IMPLOSION, _H.LOSS),
    ),
    "WashSolid": Operation(
        _i.wash_solid,
        (*_SUCK, _N.STIRRER, _N.LIQUID_ROUTE),
        (_S.HOLDS_SOLID, _S.HAS_ROOM),
        (_S.PARTED, _S.NOT_STIRRED),
        _E.SPLITS,
        (_H.IMPLOSION, _H.LOSS),
    ),
    "Dry": Operation(
        _i.dry, (_N.VACUUM,), (_S.HOLDS_SOLID,), (_S.DRY,), _E.REMOVES, (_H.IMPLOSION, _H.HOT)
    ),
    "DryDissolved": Operation(
        _i.dry_dissolved,
        (_N.CARTRIDGE, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.DRY,),
        _E.MOVES,
        (_H.LOSS,),
    ),
    "Evaporate": Operation(
        _i.evaporate,
        (_N.ROTAVAP, _N.VACUUM),
        (_S.HOLDS_LIQUID,),
        (_S.NOT_HEATED,),
        _E.REMOVES,
        (_H.IMPLOSION, _H.OVERFLOW, _H.PEROXIDES, _H.HOT),
    ),
    "FilterThrough": Operation(
        _i.filter_through,
        (_N.CARTRIDGE, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED,),
        _E.MOVES,
        (_H.OVERPRESSURE, _H.LOSS),
    ),
    "FilterTo": Operation(
        _i.filter_to,
        (_N.FILTER, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED,),
        _E.MOVES,
        (_H.OVERPRESSURE, _H.LOSS),
    ),
    "RunColumn": Operation(
        _i.run_column,
        (_N.COLUMN, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.PARTED,),
        _E.SPLITS,
        (_H.OVERPRESSURE, _H.LOSS),
    ),
    "Distill": Operation(
        _i.distill,
        (_N.THERMOSTAT, _N.CONDENSER),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.NOT_HEATED,),
        _E.SPLITS,
        (_H.PEROXIDES, *_HEATING),
    ),
    "Centrifuge": Operation(
        _i.centrifuge, (_N.CENTRIFUGE,), (_S.HOLDS_LIQUID,), (_S.PARTED,), _E.SPLITS, (_H.SPIN,)
    ),
    "AdjustPH": Operation(
        _a.adjust_ph,
        (_N.SENSOR, _N.STIRRER, _N.LIQUID_ROUTE),
        (_S.HOLDS_LIQUID, _S.HAS_ROOM),
        (_S.STIRRED, _S.KNOWN),
        _E.ADDS,
        (_H.EXOTHERM, _H.GAS_RELEASE, _H.OVERFLOW),
    ),
    "CleanVessel": Operation(
        _a.clean_vessel,
        (_N.LIQUID_ROUTE, _N.STIRRER),
        (_S.EMPTY, _S.HAS_ROOM),
        (_S.EMPTY, _S.CLEAN, _S.NOT_STIRRED),
        _E.REMOVES,
    ),
    "ResetHandling": Operation(_a.reset_handling, (_N.LIQUID_ROUTE,), (), (), _E.REMOVES),
    "PurgeBackbone": Operation(_a.purge_backbone, (_N.INERT_GAS,)),
    "Wait": Operation(_c.wait),
    "Monitor": Operation(_c.monitor, (_N.SENSOR,), (), (_S.KNOWN,)),
    "Confirm": Operation(_c.confirm, (_N.PERSON,), (), (_S.KNOWN,)),
    "Await": Operation(_c.await_async),
    "Repeat": Operation(None),
    "Loop": Operation(None),
    "Async": Operation(None),
    "Callback": Operation(None),
}
"""Unit operation by the name of its step."""
