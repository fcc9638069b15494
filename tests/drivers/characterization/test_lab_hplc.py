"""The HPLC over its data system: whole files or none, and what was drawn is told."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.load import call_action, read_status
from drivers.transports.http import HttpReply
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.characterization import data_systems as checks
from tests.drivers.conformance.analysers import ANALYSERS
from tests.drivers.conformance.placed_models import Bench, Doing, running
from tests.fixtures.running import until

HPLC = ANALYSERS[0]


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([HPLC]) as bench:
        yield bench


def test_a_run_hands_its_chromatogram_over(bench: Bench, tmp_path: Path) -> None:
    report = checks.check_whole(bench, HPLC, tmp_path, method="isocratic")
    assert [(one.name, one.format) for one in report.files] == [("chromatogram.cdf", "andi")]


@pytest.mark.parametrize("fault", ["truncated", "wrong_checksum"])
def test_a_damaged_file_is_refused(bench: Bench, fault: str) -> None:
    checks.check_damaged(bench, HPLC, fault, method="isocratic")


@pytest.mark.parametrize(("fault", "reason"), checks.NOT_READY)
def test_what_is_not_ready_starts_nothing(bench: Bench, fault: str, reason: str) -> None:
    checks.check_not_ready(bench, HPLC, fault, reason)


@pytest.mark.parametrize(
    ("fault", "reason"), [("blocked", "pump.pressure"), ("sensor_break", "lamp.off")]
)
def test_a_run_that_fails_late_tells_what_is_gone(bench: Bench, fault: str, reason: str) -> None:
    checks.check_fails_late(bench, HPLC, fault, reason)


def test_a_stop_aborts_the_run(bench: Bench) -> None:
    checks.check_stop(bench, HPLC)


def test_ending_what_runs_waits_for_its_end(bench: Bench) -> None:
    with bench.connected(HPLC) as device:
        assert call_action(device, "stop_measuring", {}).evidence == {"run": None}
        doing = Doing(device, HPLC.act)
        until(lambda: bool(read_status(device, "is_measuring")), 10)
        evidence = call_action(device, "stop_measuring", {}).evidence
        assert evidence["state"] == "aborted"
        assert doing.failure().context["reason"] == "aborted"


def test_another_instrument_is_not_connected(bench: Bench) -> None:
    bench.cure(HPLC)
    with pytest.raises(RejectedError, match="expected hplc 'another'") as caught:
        bench.driver(HPLC, model="another").connect()
    assert caught.value.effect is Effect.NONE


def test_the_digest_of_a_reply_is_read_or_refused() -> None:
    digest = "sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:"

    def told(value: str) -> HttpReply:
        return HttpReply(200, {"repr-digest": value}, b"")

    assert told(f"sha-512=:AAAA:, {digest}").told_sha256 == hashlib.sha256(b"").hexdigest()
    assert told("sha-512=:AAAA:").told_sha256 is None
    assert HttpReply(200, {}, b"").told_sha256 is None
    for wrong in ("sha-256=:AAAA:", "sha-256=:!:"):
        with pytest.raises(FrameError):
            assert told(wrong).told_sha256
