"""Results of calibrations in the queue of what waits for a second person."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest

from labweb.approvals.models import ApprovalRequest, Decision
from labweb.calibration import selectors as calibration_selectors
from labweb.calibration.models import Calibration
from labweb.calibration.services import calibrations
from labweb.common.clock import now
from labweb.domain.errors import ForbiddenError, StateError
from labweb.runs import selectors, services
from tests.builders import Bench
from tests.labweb.calibration.test_calibrations import accepted, measured
from tests.labweb.web import call, code_of, read, signed_in


def queue(bench: Bench, role: str = "approver") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = read(signed_in(bench.people[role]), "/api/v1/approvals")[
        "requests"
    ]
    return rows


def test_a_result_waits_in_the_queue_until_its_own_due_date(bench: Bench) -> None:
    row = measured(bench)
    (asked,) = queue(bench)
    assert asked["title"] == "Calibration 1 of volume of Pump 1"
    assert (asked["about"], asked["state"]) == ("calibration", "open")
    assert asked["run"]["id"] == str(row.run_id)
    assert asked["policies"] == ["A calibration needs a second person"]
    request = ApprovalRequest.objects.get()
    assert row.measured_at is not None
    assert request.expires_at == row.measured_at + timedelta(days=365)
    home = read(signed_in(bench.people["approver"]), "/api/v1/home")
    assert [one["title"] for one in home["needs_you"]] == ["Calibration 1 of volume of Pump 1"]
    assert selectors.lab_summary(bench.lab).counts.approvals_open == 1


def test_who_measured_sees_it_and_may_not_decide_it(bench: Bench) -> None:
    row = measured(bench)
    (asked,) = queue(bench, "chemist")
    assert asked["can_decide"] is False
    client = signed_in(bench.people["chemist"])
    path = f"/api/v1/approvals/{asked['id']}/decision"
    answer = call(client, "POST", path, {"is_approved": True})
    assert (answer.status_code, code_of(answer)) == (403, "governance.forbidden")
    ApprovalRequest.objects.update(asked_by=bench.people["admin"])
    own = call(signed_in(bench.people["admin"]), "POST", path, {"is_approved": True})
    assert (own.status_code, code_of(own)) == (403, "approval.own_request")
    with pytest.raises(ForbiddenError):
        calibrations.decide_calibration(
            row.id, actor=bench.people["observer"], is_accepted=True, comment=""
        )
    assert not Decision.objects.exists()
    assert calibration_selectors.find_calibration(row.id).state == "awaiting"


def test_the_review_shows_what_it_was_before_and_what_it_becomes(bench: Bench) -> None:
    accepted(bench)
    measured(bench, 0.98)
    (asked,) = queue(bench)
    client = signed_in(bench.people["approver"])
    told = read(client, f"/api/v1/approvals/{asked['id']}")["calibration"]
    assert told["device"]["name"] == "Pump 1"
    assert (told["unit"], told["is_relative"]) == ("µL", True)
    assert told["was"]["number"] == 1
    assert told["was"]["result"]["gain"] == pytest.approx(0.97, abs=1e-3)
    assert told["becomes"]["number"] == 2
    assert told["becomes"]["result"]["gain"] == pytest.approx(0.98, abs=1e-3)
    assert len(told["becomes"]["points"]) == 9


def test_a_decision_in_the_queue_is_signed_and_puts_it_into_force(bench: Bench) -> None:
    row = measured(bench)
    (asked,) = queue(bench)
    client = signed_in(bench.people["approver"])
    path = f"/api/v1/approvals/{asked['id']}/decision"
    answer = call(client, "POST", path, {"is_approved": True, "comment": "fine"})
    assert answer.status_code == 200, answer.content
    decision = Decision.objects.get()
    assert decision.meaning == "approves the calibration"
    assert decision.plan_digest == ApprovalRequest.objects.get().plan_digest
    row = calibration_selectors.find_calibration(row.id)
    assert (row.state, row.comment) == ("accepted", "fine")
    assert queue(bench) == []
    again = call(client, "POST", path, {"is_approved": True})
    assert (again.status_code, code_of(again)) == (409, "calibration.not_waiting")


def test_a_result_with_findings_is_not_approved_in_the_queue_either(bench: Bench) -> None:
    row = measured(bench, 0.5)
    (asked,) = queue(bench)
    client = signed_in(bench.people["approver"])
    path = f"/api/v1/approvals/{asked['id']}/decision"
    answer = call(client, "POST", path, {"is_approved": True})
    assert (answer.status_code, code_of(answer)) == (412, "calibration.gain")
    assert not Decision.objects.exists()
    assert call(client, "POST", path, {"is_approved": False, "comment": "no"}).status_code == 200
    assert calibration_selectors.find_calibration(row.id).state == "rejected"


def test_a_result_that_nobody_answers_is_rejected_at_its_due_date(bench: Bench) -> None:
    row = measured(bench)
    ApprovalRequest.objects.update(expires_at=now() - timedelta(seconds=1))
    with pytest.raises(StateError):
        calibrations.decide_calibration(
            row.id, actor=bench.people["approver"], is_accepted=True, comment=""
        )
    assert services.expire_requests() == 1
    row = Calibration.objects.get(pk=row.pk)
    assert (row.state, row.decided_by) == ("rejected", None)
    assert queue(bench) == []
