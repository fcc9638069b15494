"""Judge one answer of a compiler against the graph's definition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from tests.judge.oracle import Answer, Finding, Oracle
from tests.judge.play import play
from tests.judge.request import NoRequestError, Request, parse_request


class Mark(StrEnum):
    """How an answer is counted."""

    RIGHT_PLAN = "right plan"
    RIGHT_REFUSAL = "right refusal"
    OPEN_PLAN = "right plan where a refusal would do"
    OPEN_REFUSAL = "refusal where a plan would do"
    WRONG = "wrong"


@dataclass(frozen=True)
class Verdict:
    """What the judge says of one answer."""

    mark: Mark
    code: str = ""
    message: str = ""
    notes: frozenset[str] = frozenset()


def judge(oracle: Oracle, line: Mapping[str, object], answer: object) -> Verdict:
    """Judge the answer to one line of requests."""
    if not isinstance(answer, Mapping) or not isinstance(answer.get("ok"), bool):
        return _wrong("form", "the answer is no object with ok")
    try:
        request = parse_request(line)
    except NoRequestError as error:
        return _judge_refusal(answer, None, str(error))
    finding = oracle.ask(request)
    if finding.answer is Answer.INFEASIBLE:
        if answer["ok"]:
            return _judge_claim(oracle, request, finding, answer)
        return _judge_refusal(answer, finding, finding.why)
    is_open = finding.answer is Answer.OPEN
    if answer["ok"]:
        return _judge_plan(oracle, request, answer, is_open=is_open)
    if not is_open:
        return _wrong("refused-feasible", f"{_first_message(answer)}; it can be done")
    problem = _problem_of_findings(answer)
    return problem or Verdict(Mark.OPEN_REFUSAL, message=finding.why)


def _judge_plan(
    oracle: Oracle, request: Request, answer: Mapping[str, object], *, is_open: bool
) -> Verdict:
    played = play(oracle.rig, request, answer.get("steps"))
    if played.is_right:
        mark = Mark.OPEN_PLAN if is_open else Mark.RIGHT_PLAN
        return Verdict(mark, notes=frozenset(played.notes))
    at = "" if played.step is None else f"step {played.step}: "
    return _wrong(played.code, at + played.message)


def _judge_claim(
    oracle: Oracle, request: Request, finding: Finding, answer: Mapping[str, object]
) -> Verdict:
    """A plan for what cannot be done: wrong, and the player has to agree."""
    played = play(oracle.rig, request, answer.get("steps"))
    if played.is_right:
        return _wrong("judge-in-doubt", "the plan plays well although no way was found")
    if play(oracle.tubes, request, answer.get("steps")).is_right:
        return _wrong("against-direction", f"right only if every edge is a tube: {played.message}")
    return _wrong("claims-infeasible", f"{finding.why}; {played.code}: {played.message}")


def _judge_refusal(answer: Mapping[str, object], finding: Finding | None, why: str) -> Verdict:
    if answer["ok"]:
        return _wrong("claims-infeasible", why)
    problem = _problem_of_findings(answer)
    if problem is not None:
        return problem
    if finding is not None and not _names_one(answer, finding.break_ids):
        wanted = ", ".join(sorted(finding.break_ids)[:6])
        return _wrong("break-not-named", f"{_first_message(answer)!r} names none of {wanted}")
    return Verdict(Mark.RIGHT_REFUSAL, message=why)


def _problem_of_findings(answer: Mapping[str, object]) -> Verdict | None:
    findings = answer.get("findings")
    if not isinstance(findings, list) or not findings:
        return _wrong("form", "a refusal has no findings")
    for finding in findings:
        if not isinstance(finding, Mapping):
            return _wrong("form", "a finding is no object")
        for key in ("code", "message", "subject"):
            if not isinstance(finding.get(key), str) or not finding[key]:
                return _wrong("form", f"a finding has no {key}")
    return None


def _names_one(answer: Mapping[str, object], names: frozenset[str]) -> bool:
    findings = answer.get("findings")
    said = [
        f"{finding['subject']} {finding['message']}"
        for finding in (findings if isinstance(findings, list) else [])
    ]
    return any(name in text for name in names for text in said)


def _first_message(answer: Mapping[str, object]) -> str:
    findings = answer.get("findings")
    if isinstance(findings, list) and findings and isinstance(findings[0], Mapping):
        return str(findings[0].get("message"))
    return "no finding"


def _wrong(code: str, message: str) -> Verdict:
    return Verdict(Mark.WRONG, code, message)
