"""Our drivers work simulators that others wrote and published, over their real transports.

They run in the environment of the group `third-party`, as programs of their own.
"""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from drivers.base import DeviceStoppedError, Driver
from drivers.load import call_action, load_driver, read_spec, read_statuses
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.fixtures.running import until
from tests.third_party.simulators import free_port, program

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

Load = Callable[[float], Any]
"""Puts a mass in grams on the pan."""


@contextmanager
def driver(module: str, url: str, config: dict[str, Any]) -> Iterator[Driver[Any, Any]]:
    """Load a driver as an edge host does, and close it and its line at the end."""
    spec = read_spec(module)
    transport = make_transport(url)
    device = load_driver(module, spec.class_name, spec.digest, transport, config)
    try:
        yield device
    finally:
        device.close()
        transport.close()


@pytest.fixture
def folder() -> Iterator[Path]:
    with TemporaryDirectory(prefix="lw") as name:
        yield Path(name)


# --- mt-sics-emulator: a Mettler-Toledo XS204 on TCP


@pytest.fixture
def balance(python: Path, folder: Path) -> Iterator[tuple[Driver[Any, Any], Load]]:
    port, control = free_port(), free_port()
    words = ("--host", "127.0.0.1", "--port", str(port), "--control-port", str(control))
    profile = ("--profile", "mt-xs204")

    def load(mass_g: float) -> Any:  # noqa: ANN401 - whatever JSON came
        connection = HTTPConnection("127.0.0.1", control, timeout=10)
        connection.request("POST", "/weight", json.dumps({"target": mass_g}))
        answer = json.loads(connection.getresponse().read())
        connection.close()
        return answer

    with (
        program(python, folder, "mtsics.transport.tcp", *words, *profile, opens=control),
        driver("drivers.sensors.mettler_sics", f"tcp://127.0.0.1:{port}", {"poll_s": 0.05}) as one,
    ):
        one.connect()
        yield one, load


def test_a_balance_of_others_is_weighed_on_once_it_is_steady(
    balance: tuple[Driver[Any, Any], Load],
) -> None:
    device, load = balance
    assert load(0.0)["model"] == "XS204"
    call_action(device, "tare", {})
    load(12.5)
    until(lambda: not read_statuses(device)["is_stable"])
    weighed = call_action(device, "weigh", {}).evidence["mass_mg"]
    assert weighed == pytest.approx(12_500.0, abs=5.0)
    tared = call_action(device, "tare", {}).evidence["tare_mg"]
    assert tared == pytest.approx(12_500.0, abs=5.0)
    net = call_action(device, "weigh", {}).evidence["mass_mg"]
    assert net == pytest.approx(0.0, abs=5.0)


def test_a_balance_of_others_that_is_overloaded_is_told_as_such(
    balance: tuple[Driver[Any, Any], Load],
) -> None:
    device, load = balance
    load(500.0)
    until(lambda: load(500.0)["overrange"])
    with pytest.raises(RejectedError, match="overloaded") as refused:
        call_action(device, "weigh", {})
    assert refused.value.effect is Effect.NONE


def test_another_balance_of_others_than_the_one_set_is_refused(python: Path, folder: Path) -> None:
    port = free_port()
    words = ("mtsics.transport.tcp", "--host", "127.0.0.1", "--port", str(port))
    config = {"serial_number": "B0000"}
    url = f"tcp://127.0.0.1:{port}"
    with (
        program(python, folder, *words, opens=port),
        driver("drivers.sensors.mettler_sics", url, config) as device,
        pytest.raises(RejectedError, match="B123456789"),
    ):
        device.connect()


# --- julabo and sinstruments: a circulator on a serial port


@contextmanager
def circulator(
    python: Path, folder: Path, config: dict[str, Any], **settings: str
) -> Iterator[Driver[Any, Any]]:
    port = folder / "julabo"
    device = {
        **{"class": "JulaboCF", "package": "julabo.simulator", "name": "bath", **settings},
        "transports": [{"type": "serial", "url": str(port)}],
    }
    (folder / "bench.json").write_text(json.dumps({"devices": [device]}))
    words = ("sinstruments", "--config-file", "bench.json")
    url = f"serial://{port}?baud=9600&format=7E1"
    with (
        program(python, folder, *words, opens=port),
        driver("drivers.processing.julabo_cf41", url, config) as one,
    ):
        yield one


CF41 = "JULABO CRYOCOMPACT CF41 VERSION 5.0"
QUICK = {"settle_s": 0.5, "poll_s": 0.05, "reach_limit_s": 1.5, "gap_s": 0.01}


def test_a_circulator_of_others_holds_its_bath(python: Path, folder: Path) -> None:
    settings = {"VERSION": CF41, "STATUS": "02 REMOTE STOP"}
    with circulator(python, folder, QUICK, **settings) as device:
        device.connect()
        near = {"temperature_c": 29.5, "tolerance_c": 0.2}
        report = call_action(device, "reach_temperature", near)
        assert report.evidence["temperature_c"] == 29.45
        assert read_statuses(device) == {
            "temperature_c": 29.45,
            "bath_temperature_c": 29.45,
            "temperature_setpoint_c": 29.5,
            "is_controlling": True,
        }
        call_action(device, "hold", {"duration_s": 0.5, **near})
        call_action(device, "stop_control", {})
        assert not read_statuses(device)["is_controlling"]


def test_a_bath_of_others_that_does_not_get_warm_is_told_and_turned_off(
    python: Path, folder: Path
) -> None:
    settings = {"VERSION": CF41, "STATUS": "02 REMOTE STOP"}
    with circulator(python, folder, QUICK, **settings) as device:
        device.connect()
        with pytest.raises(DeviceError) as late:
            call_action(device, "reach_temperature", {"temperature_c": 60.0, "tolerance_c": 1.0})
        assert (late.value.code, late.value.effect) == ("device.not_reached", Effect.PARTIAL)
        assert late.value.context["temperature_c"] == 29.45
        assert not read_statuses(device)["is_controlling"]


def test_a_circulator_of_others_is_controlled_by_its_external_sensor(
    python: Path, folder: Path
) -> None:
    config = {**QUICK, "sensor": "external"}
    with circulator(python, folder, config, VERSION=CF41, STATUS="03 REMOTE START") as device:
        device.connect()
        near = {"temperature_c": 28.2, "tolerance_c": 0.1}
        report = call_action(device, "reach_temperature", near)
        assert report.evidence["temperature_c"] == 28.22


def test_a_circulator_of_others_that_is_driven_by_hand_is_left_alone(
    python: Path, folder: Path
) -> None:
    with circulator(python, folder, QUICK, VERSION=CF41) as device:
        device.connect()
        with pytest.raises(RejectedError, match="driven by hand") as refused:
            call_action(device, "reach_temperature", {"temperature_c": 29.5, "tolerance_c": 1.0})
        assert refused.value.effect is Effect.NONE
        assert read_statuses(device)["temperature_setpoint_c"] == 30.0


def test_a_circulator_of_others_that_reports_a_fault_is_told_with_it(
    python: Path, folder: Path
) -> None:
    fault = "-06 SENSOR DIFFERENCE ALARM"
    with circulator(python, folder, QUICK, VERSION=CF41, STATUS=fault) as device:
        device.connect()
        with pytest.raises(DeviceError) as told:
            call_action(device, "reach_temperature", {"temperature_c": 29.5, "tolerance_c": 1.0})
        assert (told.value.code, told.value.effect) == ("device.alarm", Effect.NONE)
        assert told.value.context["alarm"] == fault


def test_another_model_of_circulator_is_refused(python: Path, folder: Path) -> None:
    with circulator(python, folder, QUICK) as device, pytest.raises(RejectedError, match="CF31"):
        device.connect()


# --- lewis: a circulator of another make-up on TCP


def test_a_circulator_of_lewis_is_refused_by_its_name(python: Path, folder: Path) -> None:
    port = free_port()
    protocol = f"julabo-version-1: {{bind_address: 127.0.0.1, port: {port}}}"
    with (
        program(python, folder, "lewis", "julabo", "-p", protocol, opens=port),
        driver("drivers.processing.julabo_cf41", f"tcp://127.0.0.1:{port}", QUICK) as device,
        pytest.raises(DeviceError, match="FP50") as refused,
    ):
        device.connect()
    assert refused.value.effect is Effect.NONE


# --- slurm-emulator: the REST interface of a cluster


JOBS = {
    "fit": "#!/bin/bash\ntest \"$LABWEB_INPUT\" = '0 1 2'\n",
    "fail": "#!/bin/bash\nexit 3\n",
    "long": "#!/bin/bash\nsleep 1\n",
}
VERSIONS = {"24.11": "v0.0.42", "25.05": "v0.0.43", "25.11": "v0.0.44"}
"""Releases of Slurm, and the newest version of the interface that each serves."""


@contextmanager
def cluster(python: Path, folder: Path, release: str, **config: str) -> Iterator[Driver[Any, Any]]:
    port, token = free_port(), folder / "cluster.token"
    minted = subprocess.run(
        [str(python), "-c", MINT], capture_output=True, text=True, check=True, cwd=folder
    )
    token.write_text(minted.stdout)
    folder.joinpath("fs/home/lab").mkdir(parents=True)
    names = {
        **{"SLURM_VERSION": release, "STATE_FILE": f"{folder}/db.json", "JWT_KEY": KEY},
        **{"TIME_FILE": f"{folder}/time.json", "FS_ROOT": f"{folder}/fs", "JOB_EXECUTE": "1"},
        **{"JOB_RUN_DELAY": "0.3", "JOB_RUN_DURATION": "0.5"},
    }
    words = ("uvicorn", "emulator.api.slurmrestd.app:app", "--port", str(port))
    variables = {f"SLURM_EMULATOR_{name}": value for name, value in names.items()}
    settings = {"user": "root", "folder": "/home/lab", "jobs": JOBS, "poll_s": 0.05, **config}
    url = f"http://127.0.0.1:{port}?token={token}"
    with (
        program(python, folder, *words, opens=port, **variables),
        driver("drivers.virtual.slurm_rest", url, settings) as one,
    ):
        yield one


KEY = "one-key"
MINT = f"""
from emulator.api.slurmrestd.auth import encode_jwt_hs256
print(encode_jwt_hs256("root", key="{KEY}"))
"""


def _job(name: str) -> dict[str, Any]:
    return {"job": name, "input_text": "0 1 2", "limit_s": 600.0}


@pytest.mark.parametrize("release", VERSIONS)
def test_a_job_runs_on_a_cluster_of_others(python: Path, folder: Path, release: str) -> None:
    with cluster(python, folder, release, version=VERSIONS[release]) as device:
        device.connect()
        done = call_action(device, "run_job", _job("fit")).evidence
        assert (done["job_state"], done["exit_code_index"]) == ("COMPLETED", 0)
        assert read_statuses(device) == {
            **{"is_available": True, "is_running": False, "job_state": "COMPLETED"},
        }
        with pytest.raises(DeviceError) as failed:
            call_action(device, "run_job", _job("fail"))
        assert (failed.value.effect, failed.value.context["exit_code_index"]) == (
            Effect.PARTIAL,
            3,
        )


def test_a_stopped_job_is_cancelled_on_a_cluster_of_others(python: Path, folder: Path) -> None:
    with cluster(python, folder, "25.11", version="v0.0.44") as device:
        device.connect()
        timer = threading.Timer(0.3, device.stop)
        timer.start()
        with pytest.raises(DeviceStoppedError) as stopped:
            call_action(device, "run_job", _job("long"))
        timer.join()
        assert stopped.value.context["job_state"] == "CANCELLED"


def test_an_interface_that_a_cluster_of_others_does_not_serve_is_refused(
    python: Path, folder: Path
) -> None:
    with cluster(python, folder, "25.11") as device, pytest.raises(DeviceError) as refused:
        device.connect()
    assert refused.value.effect is Effect.NONE


def test_an_account_that_a_cluster_of_others_lacks_is_refused(python: Path, folder: Path) -> None:
    with cluster(python, folder, "25.11", version="v0.0.44", account="nobody") as device:
        device.connect()
        with pytest.raises(RejectedError) as refused:
            call_action(device, "run_job", _job("fit"))
        assert refused.value.effect is Effect.NONE
