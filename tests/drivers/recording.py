"""Record a transcript of each driver against the simulated instrument of its model.

`python -m tests.drivers.recording [MODEL…]` writes `transcripts/models/MODEL.txt`; without a name
it writes those that are not there. One that does not replay is not kept.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drivers.load import read_spec
from drivers.record import Call, record
from drivers.replay import replay
from drivers.transports.urls import make_transport
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.deeds import deeds_of
from tests.drivers.conformance.placed_models import QUICK, SPEED, Case, running
from tests.fixtures.hand_bench import Json, a_document, a_vessel
from tests.fixtures.running import Process
from tests.fixtures.test_mettler_quantos import device as a_quantos
from tests.fixtures.test_mettler_quantos import vessels as quantos_vessels

FOLDER = Path(__file__).with_name("transcripts") / "models"
AT_ONCE = {"settle_s": 0.0, "grace_s": 600.0}
"""What would be waited for by the clock is not, so that a replay asks as often."""

LEFT_OUT = {"hold", "await_end", "show_itself", "measure_open_circuit", "hold_potential"}
"""Actions that go on for a time: how often they ask is the clock's doing."""


JOB = {"input_text": "0 1\n1 3\n2 5\n", "limit_s": 900.0}
DOES: dict[str, tuple[Call, ...]] = {
    "bioshake": (
        Call("reach_temperature", {"temperature_c": 40.0, "tolerance_c": 5.0}),
        Call("stop_control", {}),
        Call("shake", {"speed_rpm": 500.0, "ramp_s": 1.0}),
        Call("stop_shaking", {}),
    ),
    "chinwe_separator": (
        Call("confirm_drain_closed", {}),
        Call("stir", {"speed_rpm": 300.0, "duration_s": 0.1}),
        Call("close_drain", {}),
    ),
    "cytomat": (
        Call("initialize", {}),
        Call("retrieve_plate", {"slot_index": 1}),
        Call("store_plate", {"slot_index": 1}),
    ),
    "lab_gcms": (
        Call("stop_measuring", {}),
        Call("measure", {"vial": "1", "sample": "a1", "method": "solvents", "injection_ul": 1.0}),
    ),
    "robotiq_2f85": (
        Call("initialize", {}),
        Call("release", {"width_mm": 85.0, "speed_mm_s": 50.0}),
    ),
    "slurm_rest": (Call("run_job", {"job": "fit", **JOB}), Call("cancel_job", {})),
}
"""What those are asked to do that cannot do one deed of their role behind the other, or would
be asked too often for a file to be read."""

FAST = {"lab_gcms": 1000.0, "lab_hplc": 1000.0}
"""Simulated seconds in one real second where a run takes a quarter of an hour: `poll_s` of the
recording is the time between two questions, in a replay as well."""

SELDOM = {"poll_s": 0.2}


def statuses_of(module: str) -> list[Call]:
    return [Call(status.name, None) for status in read_spec(module).statuses]


def calls_of(case: Case) -> list[Call]:
    """List what a driver is asked: all that it tells, all that it does, and the rest again."""
    calls = statuses_of(case.dotted)
    if case.model in DOES:
        return [*calls, *DOES[case.model], *calls]
    for deed in deeds_of(case):
        if deed.name not in LEFT_OUT and deed.during is None:
            calls += [Call(*act) for act in (*case.ready, *deed.first, deed.act)]
    return [*calls, *statuses_of(case.dotted)]


def config_of(case: Case) -> dict[str, Any]:
    known = {one.name for one in read_spec(case.dotted).config}
    quick = {name: value for name, value in {**QUICK, **AT_ONCE}.items() if name in known}
    return {**quick, **case.config, **(SELDOM if case.model in FAST else {})}


def record_placed(case: Case) -> str:
    with running([case], speed=FAST.get(case.model, SPEED)) as bench:
        spec = read_spec(case.dotted)
        line = make_transport(bench.url(case))
        text, ended_by = record(spec, line, config_of(case), calls_of(case))
        line.close()
    assert ended_by is None, ended_by
    return text


def record_alone(
    entry: Json, vessels: list[Json], module: str, config: Json, calls: Sequence[Call]
) -> str:
    """Record on a bench with one instrument."""
    with TemporaryDirectory(prefix="lw") as name:
        process = Process(Path(name))
        placed = {**entry, "id": "it", "endpoint": "tcp:127.0.0.1:0"}
        document = json.dumps(a_document(placed, vessels=vessels))
        process.folder.joinpath("bench.json").write_text(document)
        process.start("--speed", "20")
        try:
            spec = read_spec(module)
            scheme = "http" if spec.transport == "http" else "tcp"
            line = make_transport(f"{scheme}://127.0.0.1:{process.port_of('it')}")
            text, ended_by = record(spec, line, config, calls)
            line.close()
        finally:
            process.stop()
    assert ended_by is None, ended_by
    return text


def record_camera() -> str:
    camera = {"model": "network_camera", "settings": {"places": "shelf"}}
    vial = a_vessel("vial", 1000.0) | {"place": "shelf", "tag": "VIAL-7"}
    module = "drivers.sensors.network_camera"
    calls = [Call("look", {}), Call("is_present", None), Call("tag", None)]
    return record_alone(camera, [vial], module, {"place_tag": "shelf"}, calls)


def record_dispenser() -> str:
    dose = {"substance": "kcl", "target_mg": 50.0, "tolerance_ratio": 0.05, "sample_id": "A-1"}
    module = "drivers.processing.mettler_quantos"
    config = {"poll_s": 0.02, "dose_limit_s": 10.0, "stable_limit_s": 5.0}
    calls = [Call("dose", dose), *statuses_of(module)]
    return record_alone(a_quantos(), quantos_vessels(), module, config, calls)


MODELS: dict[str, Callable[[], str]] = {
    **{
        case.model: partial(record_placed, case) for case in EVERY if case.also != "navigation_port"
    },
    "network_camera": record_camera,
    "mettler_quantos": record_dispenser,
}
"""By model: what records it. A vehicle has several ports, and a transcript by hand."""


def keep(model: str, text: str) -> str:
    """Write a transcript that replays; return what is wrong with one that does not."""
    path = FOLDER / f"{model}.txt"
    for _ in range(3):
        if findings := replay(text):
            return "; ".join(one.message[:300] for one in findings[:2])
    path.write_text(text, encoding="utf-8")
    return ""


def main(names: Sequence[str]) -> int:
    wanted = names or [model for model in MODELS if not (FOLDER / f"{model}.txt").exists()]
    for model in wanted:
        try:
            problem = keep(model, MODELS[model]())
        except Exception as error:  # noqa: BLE001 - the others go on
            problem = f"{type(error).__name__}: {error}"
        sys.stdout.write(f"{model}: {problem or 'kept'}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
