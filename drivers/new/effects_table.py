"""What an action of a role leaves in what the simulated instrument tells, by role and action.

`take`: the argument of this name. `become`: this value. `add`, `subtract`, `count`: the argument's
part that was done. An action that is not here changes nothing that is told.
"""

Effect = tuple[str, object]

EFFECTS: dict[str, dict[str, dict[str, Effect]]] = {
    "agv": {"drive_to": {"station": ("take", "station")}},
    "balance": {
        "tare": {"mass_mg": ("become", 0.0), "is_stable": ("become", True)},
        "weigh": {"is_stable": ("become", True)},
    },
    "battery_tester": {
        "start_test": {"channel_state": ("become", "working"), "cycle_index": ("become", 1)},
        "await_end": {"channel_state": ("become", "finished")},
        "stop_test": {"channel_state": ("become", "stopped")},
    },
    "chromatography": {
        "start_flow": {
            "rate_setpoint_ul_s": ("take", "rate_ul_s"),
            "is_running": ("become", True),
        },
        "stop_flow": {"is_running": ("become", False)},
        "select_position": {"position": ("take", "position")},
        "collect": {"collects_to": ("take", "target")},
    },
    "compute": {
        "run_job": {"job_state": ("become", "COMPLETED"), "is_running": ("become", False)},
        "cancel_job": {"is_running": ("become", False)},
    },
    "continuous_pump": {
        "start_flow": {
            "rate_setpoint_ul_s": ("take", "rate_ul_s"),
            "is_running": ("become", True),
        },
        "stop_flow": {"is_running": ("become", False)},
        "deliver": {
            "rate_setpoint_ul_s": ("take", "rate_ul_s"),
            "is_running": ("become", False),
        },
    },
    "furnace": {
        "ramp_to": {
            "temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
            "is_heating": ("become", True),
        },
        "hold": {
            "temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
            "is_heating": ("become", True),
        },
        "stop_heating": {"is_heating": ("become", False)},
    },
    "gantry": {
        "move_to": {
            "x_mm": ("take", "x_mm"),
            "y_mm": ("take", "y_mm"),
            "z_mm": ("take", "z_mm"),
        },
    },
    "gripper": {
        "initialize": {"is_initialized": ("become", True)},
        "grip": {"width_mm": ("take", "width_mm"), "is_holding": ("become", True)},
        "release": {"width_mm": ("take", "width_mm"), "is_holding": ("become", False)},
    },
    "heater_stirrer": {
        "heat_to": {
            "temperature_c": ("take", "temperature_c"),
            "plate_temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
        },
        "stir": {
            "speed_rpm": ("take", "speed_rpm"),
            "speed_setpoint_rpm": ("take", "speed_rpm"),
        },
        "stop_stirring": {"speed_rpm": ("become", 0.0)},
        "hold": {
            "temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
        },
    },
    "infusion_pump": {
        "infuse": {"infused_ul": ("count", "volume_ul")},
        "withdraw": {"withdrawn_ul": ("count", "volume_ul")},
    },
    "injection_valve": {"select_position": {"position": ("take", "position")}},
    "liquid_handler": {
        "initialize": {
            "is_initialized": ("become", True),
            "has_tip": ("become", False),
            "tip_volume_ul": ("become", 0.0),
        },
        "pick_up_tip": {"has_tip": ("become", True), "tip_volume_ul": ("become", 0.0)},
        "drop_tip": {"has_tip": ("become", False), "tip_volume_ul": ("become", 0.0)},
        "aspirate": {"tip_volume_ul": ("add", "volume_ul")},
        "dispense": {"tip_volume_ul": ("subtract", "volume_ul")},
    },
    "plate_reader": {
        "open_drawer": {"is_drawer_open": ("become", True)},
        "close_drawer": {"is_drawer_open": ("become", False)},
    },
    "potentiostat": {
        "measure_open_circuit": {"progress_ratio": ("become", 1.0)},
        "hold_potential": {
            "potential_v": ("take", "potential_v"),
            "progress_ratio": ("become", 1.0),
        },
        "sweep_linear": {
            "potential_v": ("take", "last_v"),
            "progress_ratio": ("become", 1.0),
        },
        "sweep_cyclic": {
            "potential_v": ("take", "first_v"),
            "progress_ratio": ("become", 1.0),
        },
        "stop_measuring": {"is_measuring": ("become", False)},
    },
    "powder_dispenser": {
        "dose": {"is_door_open": ("become", False), "mass_mg": ("add", "target_mg")},
        "open_door": {"is_door_open": ("become", True)},
        "close_door": {"is_door_open": ("become", False)},
    },
    "power_supply": {
        "supply": {
            "voltage_v": ("take", "voltage_v"),
            "current_ma": ("take", "current_ma"),
            "voltage_setpoint_v": ("take", "voltage_v"),
            "current_setpoint_ma": ("take", "current_ma"),
        },
        "stop_supply": {"voltage_v": ("become", 0.0), "current_ma": ("become", 0.0)},
    },
    "pump": {
        "initialize": {"is_initialized": ("become", True), "volume_ul": ("become", 0.0)},
        "aspirate": {"volume_ul": ("add", "volume_ul")},
        "dispense": {"volume_ul": ("subtract", "volume_ul")},
    },
    "rotary_evaporator": {
        "heat_bath_to": {
            "bath_temperature_c": ("take", "temperature_c"),
            "bath_setpoint_c": ("take", "temperature_c"),
        },
        "rotate": {
            "speed_rpm": ("take", "speed_rpm"),
            "speed_setpoint_rpm": ("take", "speed_rpm"),
        },
        "stop_rotating": {"speed_rpm": ("become", 0.0)},
    },
    "separator": {
        "stir": {"speed_rpm": ("become", 0.0)},
        "drain_lower_phase": {"is_drain_closed": ("become", True)},
        "close_drain": {"is_drain_closed": ("become", True)},
        "confirm_drain_closed": {"is_drain_closed": ("become", True)},
    },
    "shaker": {
        "shake": {"speed_rpm": ("take", "speed_rpm")},
        "stop_shaking": {"speed_rpm": ("become", 0.0)},
    },
    "stirrer": {
        "stir": {
            "speed_rpm": ("take", "speed_rpm"),
            "speed_setpoint_rpm": ("take", "speed_rpm"),
        },
        "stop_stirring": {"speed_rpm": ("become", 0.0)},
    },
    "storage": {
        "initialize": {"is_ready": ("become", True)},
        "store_plate": {"has_plate_at_transfer": ("become", False)},
        "retrieve_plate": {"has_plate_at_transfer": ("become", True)},
    },
    "temperature_controller": {
        "reach_temperature": {"temperature_c": ("take", "temperature_c")},
        "hold": {"temperature_c": ("take", "temperature_c")},
    },
    "thermostat": {
        "reach_temperature": {
            "temperature_c": ("take", "temperature_c"),
            "bath_temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
            "is_controlling": ("become", True),
        },
        "hold": {
            "temperature_c": ("take", "temperature_c"),
            "temperature_setpoint_c": ("take", "temperature_c"),
            "is_controlling": ("become", True),
        },
        "stop_control": {"is_controlling": ("become", False)},
    },
    "vacuum_controller": {
        "evacuate_to": {
            "pressure_kpa": ("take", "pressure_kpa"),
            "pressure_setpoint_kpa": ("take", "pressure_kpa"),
            "is_pumping": ("become", True),
        },
        "stop_pump": {"is_pumping": ("become", False)},
        "vent": {"pressure_kpa": ("become", 101.3), "is_pumping": ("become", False)},
    },
    "analyser": {
        "measure": {"is_measuring": ("become", False), "progress_ratio": ("become", 1.0)},
        "stop_measuring": {"is_measuring": ("become", False)},
    },
    "spectrometer": {
        "measure": {"is_measuring": ("become", False), "progress_ratio": ("become", 1.0)},
        "stop_measuring": {"is_measuring": ("become", False)},
    },
    "valve": {"select_port": {"port_index": ("take", "port_index")}},
}

STANDING: dict[str, object] = {
    "is_running": False,
    "is_driving": False,
    "is_controlling": False,
    "is_heating": False,
    "is_moving": False,
    "is_pumping": False,
    "speed_rpm": 0.0,
    "voltage_v": 0.0,
    "current_ma": 0.0,
}
"""What a simulated instrument tells once it was halted, where its role tells it."""
