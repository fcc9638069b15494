"""The driver of the powder dispenser on the simulated one: powder falls, and its faults."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import pytest

from drivers.base import Driver
from drivers.load import load_driver, read_spec, read_status
from drivers.processing import mettler_quantos
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.placed_models import Doing, do, sent_by
from tests.fixtures.hand_bench import a_document
from tests.fixtures.running import Process, until
from tests.fixtures.test_mettler_quantos import device as an_entry
from tests.fixtures.test_mettler_quantos import vessels

MODULE = "drivers.processing.mettler_quantos"
SPEED = 20
DOSE = {"substance": "kcl", "target_mg": 50.0, "tolerance_ratio": 0.05, "sample_id": "A-1"}


class Rig:
    """One dispenser in a process of its own, and the driver that is connected to it."""

    def __init__(self, process: Process) -> None:
        self.process = process
        spec = read_spec(MODULE)
        line = make_transport(f"tcp://127.0.0.1:{process.port_of('it')}")
        config = {"poll_s": 0.02, "dose_limit_s": 10.0, "stable_limit_s": 5.0}
        self.driver: Driver[Any, Any] = load_driver(
            MODULE, spec.class_name, spec.digest, line, config
        )

    def inflict(self, fault: str, **options: object) -> None:
        told = {"fault": fault, **options}
        status, answer = self.process.call("POST", "/instruments/it/faults", told)
        assert status == 201, answer

    def doses(self) -> list[dict[str, Any]]:
        found = self.process.get("/instruments/it/actuations?since=0")
        return [one for one in found if one["verb"] == "dose"]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    monkeypatch.setattr(mettler_quantos, "ANSWER_S", 0.4)
    with TemporaryDirectory(prefix="lw") as name:
        folder = Path(name)
        entry = {**an_entry(), "id": "it", "endpoint": "tcp:127.0.0.1:0"}
        (folder / "bench.json").write_text(json.dumps(a_document(entry, vessels=vessels())))
        process = Process(folder)
        process.start("--speed", str(SPEED))
        try:
            made = Rig(process)
            made.driver.connect()
            yield made
            made.driver.close()
        finally:
            process.stop()


def test_a_dose_is_what_the_balance_says_that_fell(rig: Rig) -> None:
    report = do(rig.driver, ("dose", DOSE))
    evidence = report.evidence
    (file,) = report.files
    told = ElementTree.fromstring(file.data)
    assert (file.name, told.findtext("Sample_ID")) == ("A-1.xml", "A-1")
    assert float(told.findtext("Content") or "") == evidence["said_mg"]
    assert evidence["dosed_mg"] == pytest.approx(50.0, rel=0.06)
    assert read_status(rig.driver, "mass_mg") == pytest.approx(evidence["dosed_mg"], abs=0.1)
    assert len(rig.doses()) == 1


@pytest.mark.parametrize(
    "change", [{"substance": "nacl"}, {"target_mg": 5001.0}, {"sample_id": "a b"}]
)
def test_what_cannot_be_is_refused_and_nothing_falls(rig: Rig, change: dict[str, Any]) -> None:
    with pytest.raises(PreconditionError) as caught:
        do(rig.driver, ("dose", DOSE | change))
    assert caught.value.effect is Effect.NONE
    assert rig.doses() == []


@pytest.mark.parametrize("fault", ["door_open", "no_head", "busy"])
def test_a_dispenser_that_is_not_ready_doses_nothing(rig: Rig, fault: str) -> None:
    rig.inflict(fault)
    with pytest.raises((DeviceError, PreconditionError)) as caught:
        do(rig.driver, ("dose", DOSE))
    assert caught.value.effect is Effect.NONE
    assert rig.doses() == []


def test_silence_before_the_dose_has_no_effect(rig: Rig) -> None:
    rig.inflict("no_answer")
    assert Doing(rig.driver, ("dose", DOSE)).failure().effect is Effect.NONE
    assert rig.doses() == []


def test_a_garbled_weight_is_never_a_value(rig: Rig) -> None:
    assert isinstance(read_status(rig.driver, "mass_mg"), float)
    rig.inflict("garbled", mode="truncate")
    with pytest.raises(DeviceError) as caught:
        read_status(rig.driver, "mass_mg")
    assert caught.value.effect is Effect.NONE


def test_power_lost_while_powder_falls_leaves_it_unknown_and_is_not_tried_again(rig: Rig) -> None:
    sent = sent_by(rig.driver)
    doing = Doing(rig.driver, ("dose", DOSE | {"target_mg": 500.0}))
    until(lambda: len(rig.doses()) == 1)
    rig.inflict("power_loss", for_s=1000.0)
    assert doing.failure().effect is Effect.UNKNOWN
    assert len(rig.doses()) == 1
    assert sum(frame.startswith(b"QRA 61 1\r") for frame in sent) == 1
