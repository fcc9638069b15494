"""Drivers that others wrote and published accept the simulated instruments as real ones.

They run in an environment of their own, made from the group `third-party` of the lock file,
because they ask for older packages than the project does. Where it cannot be made, the tests
skip; under CI they fail.
"""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from fixtures.instruments.models import MODELS
from tests.fixtures.hand_bench import Json, a_document, a_vessel, an_instrument
from tests.fixtures.running import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

TCP = (
    *("knauer_azura_compact", "knauer_valve", "neware_bts", "tti_pl"),
    "magritek_spinsolve",
)
SERIAL = (
    *("hamilton_ml600", "harvard_elite_11", "huber_pb", "heidolph_hei_connect"),
    *("vacuubrand_cvc3000", "runze_sy01", "cytomat", "bioshake", "new_era_ne1000"),
    *("tdk_genesys", "spectramax"),
)
DRIVE_S = 120.0


def placed(model: str, endpoint: str) -> Json:
    kind = MODELS[model]
    entry = an_instrument(model) | {"id": model, "endpoint": endpoint}
    if kind.ATTACHES == "ports":
        names = kind.port_names({})
        far = "3" if model == "runze_sy01" else names[1] if len(names) > 1 else ""
        ports = {names[0]: {"vessel": "bottle"}}
        entry["attached"] = {"ports": ports | ({far: {"vessel": "flask"}} if far else {})}
    return entry


@pytest.fixture(scope="module")
def process() -> Iterator[Process]:
    with TemporaryDirectory(prefix="lw") as name:
        folder = Path(name)
        entries = [placed(model, f"pty:{folder}/{model}") for model in SERIAL]
        entries += [placed(model, "tcp:127.0.0.1:0") for model in TCP]
        reader = next(entry for entry in entries if entry["model"] == "spectramax")
        reader["settings"] = {"absorbing": "well-lot:1.5@450", "noise_au": 0.0}
        reader["attached"] = {"ports": {"A1": {"vessel": "well"}}}
        bottle = a_vessel("bottle", 40_000.0)
        document = a_document(
            *entries, vessels=[bottle, a_vessel("flask"), a_vessel("well", 161.0)]
        )
        (folder / "bench.json").write_text(json.dumps(document))
        process = Process(folder)
        process.start("--speed", "20")
        yield process
        process.stop()


def drive(python: Path, process: Process, model: str) -> dict[str, Any]:
    """Let the driver of others do what `drive.py` has for the model."""
    address = str(process.folder / model)
    if model in TCP:
        address = f"127.0.0.1:{process.port_of(model)}"
    script = Path(__file__).with_name("drive.py")
    done = subprocess.run(
        [str(python), str(script), model, address],
        cwd=process.folder,
        capture_output=True,
        text=True,
        timeout=DRIVE_S,
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND ")]
    assert lines, done.stderr[-3000:]
    found: dict[str, Any] = json.loads(lines[-1].removeprefix("FOUND "))
    return found


def state_of(process: Process, model: str) -> dict[str, Any]:
    found: dict[str, Any] = process.get(f"/instruments/{model}")["state"]
    return found


def volume_ul(process: Process, vessel: str) -> float:
    return float(process.get("/world")["vessels"][vessel]["volume_nl"]) / 1000


def test_flowchem_moves_liquid_with_a_hamilton_ml600(python: Path, process: Process) -> None:
    before_ul = volume_ul(process, "flask")
    found = drive(python, process, "hamilton_ml600")
    assert (found["pumps"], found["angle"]) == (1, 135)
    assert found["volume_ml"] == pytest.approx(2.0, abs=0.001)
    assert volume_ul(process, "flask") - before_ul == pytest.approx(2000, abs=1)


def test_flowchem_moves_liquid_with_a_runze_pump(python: Path, process: Process) -> None:
    before_ul = volume_ul(process, "flask")
    found = drive(python, process, "runze_sy01")
    assert found == {"volume_ml": pytest.approx(2.0, abs=0.001), "refused": True}
    assert volume_ul(process, "flask") - before_ul == pytest.approx(2000, abs=1)


def test_flowchem_draws_with_a_harvard_pump(python: Path, process: Process) -> None:
    found = drive(python, process, "harvard_elite_11")
    assert found["rate_ml_min"] == pytest.approx(-30.0)
    syringe = process.get("/world")["syringes"]["harvard_elite_11"]
    assert syringe["volume_nl"] / 1000 == pytest.approx(3000, abs=1)


def test_flowchem_sets_a_huber(python: Path, process: Process) -> None:
    found = drive(python, process, "huber_pb")
    assert found == {"serial": "123456", "setpoint_c": 45.5, "limits_c": [-40.0, 200.0]}
    assert state_of(process, "huber_pb")["set_c"] == 45.5


def test_flowchem_stirs_with_a_heidolph(python: Path, process: Process) -> None:
    found = drive(python, process, "heidolph_hei_connect")
    assert found == {"speed_rpm": 500.0, "status": "remote-start", "mode": "fast"}


def test_flowchem_takes_a_vacuum_controller_into_its_command_set(
    python: Path, process: Process
) -> None:
    found = drive(python, process, "vacuubrand_cvc3000")
    assert found == {"pressure_mbar": 1013.0, "control": 2}
    assert state_of(process, "vacuubrand_cvc3000")["command_set"] == "3000"


def test_flowchem_pumps_with_an_azura(python: Path, process: Process) -> None:
    found = drive(python, process, "knauer_azura_compact")
    assert (found["flow_ml_min"], found["errors"]) == (6.0, [0] * 5)
    assert found["pressure_bar"] > 0
    (run,) = process.get("/instruments/knauer_azura_compact/actuations")
    assert run["moved_nl"] > 0


def test_flowchem_turns_a_knauer_valve(python: Path, process: Process) -> None:
    assert drive(python, process, "knauer_valve") == {"type": "6", "position": "4"}


def test_pylabrobot_stores_a_plate_in_a_cytomat(python: Path, process: Process) -> None:
    found = drive(python, process, "cytomat")
    assert found == {"before": True, "after": False, "temperature_c": 36.9}
    assert state_of(process, "cytomat")["plates"] == ["7"]


def test_pylabrobot_reads_a_plate_in_a_spectramax(python: Path, process: Process) -> None:
    found = drive(python, process, "spectramax")
    assert "failed with error 110" in found["refused"]
    assert (found["target_c"], found["wavelengths"]) == (30.0, [450, 700])
    assert (found["size"], found["kinetic"]) == ([8, 12], 2)
    # 161 µL stand 0.5 cm high in a well of 32.2 mm².
    assert found["a1"] == [pytest.approx(0.04 + 1.5 * 0.5, abs=1e-4), pytest.approx(0.04)]
    assert found["h12"] == pytest.approx(0.04)
    assert found["by_other"] == found["a1"][0]


def test_pylabrobot_shakes_and_unlocks_a_bioshake(python: Path, process: Process) -> None:
    drive(python, process, "bioshake")
    verbs = [a["verb"] for a in process.get("/instruments/bioshake/actuations")]
    assert verbs == ["shaker", "lock"]


def test_aurora_starts_and_stops_a_test_on_a_cycler(python: Path, process: Process) -> None:
    found = drive(python, process, "neware_bts")
    assert found == {
        **{"channels": 16, "start": "ok", "status": "working", "barcode": "cell-1"},
        **{"first_step": "rest", "stop": "ok"},
    }


def test_nesp_withdraws_with_a_new_era_pump(python: Path, process: Process) -> None:
    found = drive(python, process, "new_era_ne1000")
    assert found == {"model": 1000, "withdrawn_ml": pytest.approx(2.0, abs=0.001)}
    syringe = process.get("/world")["syringes"]["new_era_ne1000"]
    assert syringe["volume_nl"] / 1000 == pytest.approx(2000, rel=0.001)


@pytest.mark.parametrize("model", ["tdk_genesys", "tti_pl"])
def test_pymeasure_sets_a_supply_and_sees_the_law(
    python: Path, process: Process, model: str
) -> None:
    found = drive(python, process, model)
    assert (found["volt"], found["ampere"]) == (1.82, pytest.approx(0.69, abs=0.001))
    assert state_of(process, model)["mode"] == "CV"


def test_flowchem_measures_with_a_spinsolve(python: Path, process: Process) -> None:
    found = drive(python, process, "magritek_spinsolve")
    assert (found["version"], found["numbers"]) == ("1.18.1.3062", [0, 1])
    assert {"1D PROTON", "1D EXTENDED+", "SHIM"} <= set(found["protocols"])
    assert (found["solvent"], found["sample"]) == ("D2O", "sample 1")
    assert found["user_data"] == {"batch": "7"}
    folder = Path(found["folder"])
    assert 'Sample                   = "sample 1"' in (folder / "acqu.par").read_text()
    assert (folder / "data.1d").stat().st_size == 32 + 12 * 8000
    endings = [a["ending"] for a in process.get("/instruments/magritek_spinsolve/actuations")]
    assert endings == ["done", "aborted"]
