"""The drivers of what measures: sensors, balances, chromatographs, battery cyclers."""

from __future__ import annotations

from pathlib import Path

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
        no_busy="one letter is answered by one reading: it has nothing to be busy with",
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
        beyond=(
            ("show_itself", {"text": "", "shown_s": 1.0}),
            ("show_itself", {"text": 'B "2"', "shown_s": 1.0}),
            ("show_itself", {"text": "Balance at the window", "shown_s": 1.0}),
            ("show_itself", {"text": "B 2", "shown_s": 61.0}),
        ),
        status="mass_mg",
    ),
    Case(
        module="sensors.seeed_ph",
        model="modbus_ph",
        act=("measure", {}),
        status="value_ph",
    ),
    Case(
        module="sensors.simex_trs02a",
        model="simex_trs02a",
        no_busy="its table of errors has no word for being busy",
        act=("measure", {}),
        status="temperature_c",
    ),
    Case(
        module="sensors.bronkhorst_es_flow",
        model="bronkhorst_es_flow",
        no_busy="its exceptions are 02, 03 and 04: none says that it is busy",
        act=("measure", {}),
        status="flow_ul_s",
    ),
]

HALVES = {"line_1_ratio": 0.5, "line_2_ratio": 0.5, "line_3_ratio": 0.0, "line_4_ratio": 0.0}

TUBE = {"sample": "A-1", "solvent": "CDCl3", "acquisition_s": 3.2, "pulse_angle_deg": 90.0}

SPECTROMETERS = [
    Case(
        module="characterization.magritek_spinsolve",
        model="magritek_spinsolve",
        carrier="tcp",
        config={"silence_limit_s": 1.0},
        act=("measure", {**TUBE, "scan_count": 4, "repetition_s": 120.0}),
        verb="measure",
        beyond=(
            ("measure", {**TUBE, "scan_count": 3, "repetition_s": 120.0}),
            ("measure", {**TUBE, "scan_count": 4, "repetition_s": 2.0}),
        ),
        status="is_connected",
    )
]

SWEEP = {"first_v": -0.2, "last_v": 0.6, "step_v": 0.01, "rate_v_s": 0.01}

POTENTIOSTATS = [
    Case(
        module="characterization.palmsens_emstat_pico",
        model="emstat_pico",
        config={"max_potential_v": 1.0},
        settings={"couple": "emstat_pico_flask-lot:1"},
        act=("sweep_linear", SWEEP),
        verb="cell",
        asks=1,
        beyond=(
            ("sweep_linear", {**SWEEP, "last_v": 1.1}),
            ("sweep_linear", {**SWEEP, "first_v": -1.3}),
            ("sweep_linear", {**SWEEP, "rate_v_s": 10.0}),
            ("hold_potential", {"potential_v": 0.5, "duration_s": 1.0, "interval_s": 0.02}),
        ),
        status="is_connected",
    )
]

PLATE_READERS = [
    Case(
        module="characterization.molecular_devices_spectramax",
        model="spectramax",
        config={
            "model": "plus_384",
            "rest_temperature_c": 0.0,
            "max_wavelength_nm": 850,
            "move_limit_s": 2.0,
        },
        settings={"absorbing": "spectramax_flask-lot:1.5@450/40", "noise_au": 0.0},
        ports=("A1",),
        act=("read_absorbance", {"wavelengths_nm": [450, 600]}),
        verb="read",
        beyond=(
            ("read_absorbance", {"wavelengths_nm": [851]}),
            ("read_absorbance", {"wavelengths_nm": []}),
            ("reach_temperature", {"temperature_c": 46.0, "tolerance_c": 1.0}),
        ),
        status="temperature_c",
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

DECK = {
    "1": "opentrons/opentrons_96_tiprack_300ul/1",
    "2": "opentrons/nest_12_reservoir_15ml/1",
    "3": "opentrons/corning_96_wellplate_360ul_flat/1",
}
OVER = {"source_slot": "2", "source_well": "A1", "target_slot": "3", "target_well": "A1"}

LIQUID_HANDLERS = [
    Case(
        module="processing.opentrons_ot2",
        model="opentrons_ot2",
        carrier="tcp",
        config={
            "pipette": "p300_single_gen2",
            "mount": "left",
            "deck": DECK,
            "min_volume_ul": 20.0,
            "max_volume_ul": 300.0,
            "max_rate_ul_s": 200.0,
        },
        settings={"deck": ";".join(f"{n}:{text.split('/')[1]}" for n, text in DECK.items())},
        ports=("2.A1", "3.A1"),
        act=("initialize", {}),
        verb="home",
        is_unchecked=True,
        beyond=(
            ("aspirate", {"slot": "2", "well": "A1", "volume_ul": 50.0, "rate_ul_s": 50.0}),
            ("transfer_liquid", {**OVER, "volume_ul": 1001.0, "rate_ul_s": 50.0}),
            ("show_itself", {"text": "", "shown_s": 61.0}),
        ),
        status="running_state",
    )
]

TOKEN = Path(__file__).with_name("nobody.token")
POINTS = "0 1\n1 3\n2 5\n"

CLUSTERS = [
    Case(
        module="virtual.slurm_rest",
        model="slurm_rest",
        carrier="tcp",
        address=f"?token={TOKEN}",
        config={
            "user": "lab",
            "folder": "/scratch",
            "jobs": {
                "wait": "#!/bin/sh\nsleep 600\n",
                "fit": '#!/bin/sh\nfit polynomial 1 "$LABWEB_INPUT"\n',
                "fail": "#!/bin/sh\nexit 3\n",
            },
            "silence_limit_s": 0.5,
        },
        settings={"user": "lab", "token": TOKEN.read_text("ascii").strip()},
        act=("run_job", {"job": "wait", "input_text": POINTS, "limit_s": 900.0}),
        verb="job",
        asks=1,
        is_unchecked=True,
        beyond=(
            ("run_job", {"job": "other", "input_text": "", "limit_s": 900.0}),
            ("run_job", {"job": "wait", "input_text": "", "limit_s": 1.0}),
        ),
        status="is_available",
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
            ("show_itself", {"text": "", "shown_s": 0.5}),
        ),
        status="voltage_v",
    )
]
