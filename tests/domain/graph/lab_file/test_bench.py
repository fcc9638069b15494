from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from fixtures.instruments.bench import parse_bench
from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.simulated_bench import bench_for, bench_notes, endpoints_needed
from tests.labs import generated_lab

STARTER = (Path(__file__).parents[4] / "fixtures/labs/starter/lab.json").read_bytes()
ENDPOINTS = {
    "pump_1": "pty:/tmp/pump_1",
    "pump_2": "pty:/tmp/pump_2",
    "heater_1": "pty:/tmp/heater_1",
    "balance_1": "tcp:127.0.0.1:4305",
    "ph_1": "tcp:127.0.0.1:5020",
}


def bench() -> dict[str, Any]:
    return bench_for(read_lab(STARTER), ENDPOINTS)


def test_each_line_of_the_starter_lab_has_its_carrier_and_the_timer_none() -> None:
    assert dict(endpoints_needed(read_lab(STARTER))) == {
        line: endpoint.partition(":")[0] for line, endpoint in ENDPOINTS.items()
    }


def test_pumps_are_attached_port_by_port_and_others_to_their_vessel() -> None:
    attached = {found["id"]: found["attached"] for found in bench()["instruments"]}
    assert attached["pump_1"]["ports"] == {
        "1": {"vessel": "water"},
        "2": {"vessel": "acid"},
        "3": {"vessel": "reactor_1"},
        "4": {"vessel": "flask_1"},
        "8": {"vessel": "waste"},
    }
    assert attached["pump_2"]["ports"]["5"] == {"vessel": "flask_2"}
    assert attached["heater_1"] == {"vessel": "reactor_1"}
    assert attached["balance_1"] == {"vessel": "flask_1"}
    assert attached["ph_1"] == {"vessel": "reactor_1"}


def test_only_the_second_pump_reaches_flask_2_and_its_fault_waits_at_that_port() -> None:
    reaching = [
        (found["id"], port)
        for found in bench()["instruments"]
        for port, end in found["attached"].get("ports", {}).items()
        if end == {"vessel": "flask_2"}
    ]
    assert reaching == [("pump_2", "5")]
    settings = {found["id"]: found["settings"] for found in bench()["instruments"]}
    (fault,) = settings["pump_2"]["faults"]
    assert (fault["fault"], fault["match"]) == ("no_answer", {"port": 5})


def test_unknown_numbers_are_assumed_on_the_bench_by_name_and_stay_unknown_in_the_lab() -> None:
    assert bench_notes(read_lab(STARTER), ENDPOINTS).assumed == ("density_mg_ul of dye: 1",)
    lab = read_lab(STARTER)
    assert {m.key: m.density_mg_ul for m in lab.materials}["dye"] is None


def test_a_line_without_an_endpoint_is_refused() -> None:
    with pytest.raises(LabFileError) as caught:
        bench_for(read_lab(STARTER), {"pump_1": "pty:/tmp/pump_1"})
    assert caught.value.code == "bench.no_endpoint"


@pytest.mark.parametrize(
    ("simulator", "code"),
    [
        ({"model": "quantum_oven"}, "bench.model_unknown"),
        ({"model": "mettler_sics", "line": "pump_1"}, "bench.carrier_differs"),
    ],
)
def test_what_nobody_can_simulate_is_refused(simulator: dict[str, str], code: str) -> None:
    lab = json.loads(STARTER)
    balance = next(device for device in lab["devices"] if device["key"] == "balance_1")
    balance |= {"simulator": simulator, "config": {"address": "7"}}
    with pytest.raises(LabFileError) as caught:
        endpoints_needed(read_lab(json.dumps(lab).encode()))
    assert caught.value.code == code


def test_simulated_instruments_take_the_starter_and_generated_labs_as_they_are() -> None:
    for raw in (STARTER, *(generated_lab(seed) for seed in range(25))):
        lab = read_lab(raw)
        endpoints = {
            line: f"pty:/tmp/line_{number}"
            if carrier == "pty"
            else f"tcp:127.0.0.1:{5000 + number}"
            for number, (line, carrier) in enumerate(endpoints_needed(lab))
        }
        taken = parse_bench(json.loads(json.dumps(bench_for(lab, endpoints))))
        assert len(taken.instruments) == len(lab.devices) - 1  # the timer needs none
