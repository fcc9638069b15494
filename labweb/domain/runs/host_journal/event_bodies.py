"""Bodies of the events that say how an action ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from labweb.domain.crutd.pre_and_postconditions import Condition, ConditionResult, Verification
from labweb.domain.crutd.settlement import Change, Outcome
from labweb.domain.runs.host_journal.action_states import ActionReport


def change_body(
    change: Change, revs: Mapping[str, int], outcome: Outcome, verification: Verification
) -> dict[str, Any]:
    """Say what was settled, so that the server can settle it again and compare."""
    return {
        "change": change.to_json(),
        "revs": dict(revs),
        "verification": verification.value,
        "outcome": {
            "kind": outcome.kind.value,
            "moved_nl": outcome.moved_nl,
            "data": dict(outcome.data),
        },
    }


def report_body(report: ActionReport) -> dict[str, Any]:
    """Render what came back from the driver."""
    return {
        "ok": report.ok,
        "effect": report.effect.value,
        "moved_nl": report.moved_nl,
        "code": report.code,
        "message": report.message,
        "evidence": plain(report.evidence),
        "data": plain(report.data),
        **({"files": msgspec.to_builtins(report.files)} if report.files else {}),
    }


def report_from(body: Mapping[str, Any]) -> ActionReport:
    """Read a report that was kept in the journal."""
    return msgspec.convert(dict(body), ActionReport)


def results_body(results: Sequence[tuple[Condition, ConditionResult]]) -> list[dict[str, Any]]:
    """Render the verdicts with their evidence."""
    return [plain(msgspec.to_builtins(result)) for _, result in results]


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever a driver hands over
    """Turn a driver's evidence into plain data; what is not JSON is kept as its text."""
    try:
        return msgspec.json.decode(msgspec.json.encode(value, enc_hook=repr))
    except (TypeError, ValueError, msgspec.MsgspecError):
        return {"text": repr(value)}
