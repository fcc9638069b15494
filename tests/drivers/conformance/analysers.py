"""The drivers of what measures: sensors, balances, chromatographs, battery cyclers."""

from __future__ import annotations

from tests.drivers.conformance.placed_models import Action, Case

CONDUCTIVITY = [
    Case(
        module="sensors.seeed_tds",
        model="modbus_tds",
        act=("measure", {}),
        status="conductivity_us_cm",
    ),
    Case(
        module="sensors.cronin_conductivity",
        model="conductivity_sensor",
        config={"full_scale_us_cm": 10_000.0},
        act=("measure", {}),
        status="conductivity_us_cm",
    ),
]

SENSORS = [
    Case(
        module="sensors.mettler_sics",
        model="mettler_sics",
        carrier="tcp",
        act=("weigh", {}),
        status="mass_mg",
    ),
    Case(
        module="sensors.seeed_ph",
        model="modbus_ph",
        act=("measure", {}),
        status="value_ph",
    ),
]

HALVES = {"line_1_ratio": 0.5, "line_2_ratio": 0.5, "line_3_ratio": 0.0, "line_4_ratio": 0.0}

TUBE = {"sample": "A-1", "solvent": "CDCl3", "acquisition_s": 3.2, "pulse_angle_deg": 90.0}

SPECTROMETERS = [
    Case(
        module="characterization.magritek_spinsolve",
        model="magritek_spinsolve",
        carrier="tcp",
        config={"silence_limit_s": 5.0},
        act=("measure", {**TUBE, "scan_count": 4, "repetition_s": 120.0}),
        verb="measure",
        beyond=(
            ("measure", {**TUBE, "scan_count": 3, "repetition_s": 120.0}),
            ("measure", {**TUBE, "scan_count": 4, "repetition_s": 2.0}),
        ),
        status="is_connected",
    )
]

VIAL = {"vial": "1", "sample": "a1"}


def _analyser(model: str, method: str, injection_ul: float, *beyond_ul: float) -> Case:
    """Return an instrument that injects from its vial 1."""

    def injecting(amount_ul: float) -> Action:
        return ("measure", {**VIAL, "method": method, "injection_ul": amount_ul})

    return Case(
        module=f"characterization.{model}",
        model=model,
        carrier="tcp",
        ports=("1", "waste"),
        act=injecting(injection_ul),
        verb="inject",
        beyond=tuple(injecting(amount_ul) for amount_ul in beyond_ul),
        status="running_state",
    )


ANALYSERS = [
    _analyser("lab_hplc", "standard", 5.0, 0.05, 101.0),
    _analyser("lab_gcms", "standard", 1.0, 0.05, 5.5),
    _analyser("lab_ms", "positive", 10.0, 0.5, 51.0),
]

CHROMATOGRAPHS = [
    Case(
        module="processing.buchi_c815",
        model="buchi_c815",
        carrier="tcp",
        config={"max_rate_ul_s": 1000.0, "max_pressure_kpa": 1000.0, "start_limit_s": 2.0},
        act=("start_flow", {"rate_ul_s": 500.0, **HALVES}),
        verb="pump",
        asks=4,
        beyond=(
            ("start_flow", {"rate_ul_s": 1001.0, **HALVES}),
            ("start_flow", {"rate_ul_s": 500.0, **HALVES, "line_3_ratio": 0.1}),
        ),
        status="pressure_kpa",
    )
]

CYCLERS = [
    Case(
        module="characterization.neware_bts",
        model="neware_bts",
        carrier="tcp",
        config={"device_index": 21, "subdevice_index": 1, "channel_index": 1, "poll_s": 0.02},
        act=(
            "start_test",
            {"protocol_path": "C:/p.xml", "backup_path": "C:/data", "barcode": "cell-1"},
        ),
        verb="test",
        is_instant=True,
        beyond=(
            (
                "start_test",
                {"protocol_path": "<p/>", "backup_path": "C:/data", "barcode": "cell-1"},
            ),
        ),
        status="voltage_v",
    )
]
