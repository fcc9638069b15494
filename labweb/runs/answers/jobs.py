"""Jobs of a run, and what people are asked about them."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Any, Literal
from uuid import UUID

import msgspec
from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer, KeyedRef
from labweb.domain.calibration.correction import Correction
from labweb.domain.runs.after_failure.recovery_choices import PersonChoice
from labweb.domain.runs.states.job_states import JobState
from labweb.runs.answers.run_rows import RecoveryName

PassedBy = Literal["skip", "hand", "change"]
PlungerAnswer = Literal["happened", "did_not", "partly"]


def passed_by(word: str) -> PassedBy | None:
    """Return a kept word as the one that it is; None: it is empty."""
    found: PassedBy | None = msgspec.convert(word, PassedBy) if word else None
    return found


def plunger_answer(word: str) -> PlungerAnswer | None:
    """Return the answer that a reading agrees with as the word that it is; None: it is empty."""
    found: PlungerAnswer | None = msgspec.convert(word, PlungerAnswer) if word else None
    return found


class RecoveryChoice(ApiAnswer):
    """One thing that a person may do about a job that ended undone."""

    name: RecoveryName
    why_not: str | None
    consequence: str


def recovery_choices(choices: Iterable[PersonChoice]) -> list[RecoveryChoice]:
    """Say what a person may do, each with its consequence or why it is not offered."""
    return [
        RecoveryChoice(
            name=msgspec.convert(one.name, RecoveryName),
            why_not=one.why_not or None,
            consequence=one.consequence,
        )
        for one in choices
    ]


class RecoveryCard(ApiAnswer):
    """What a person may do about a job that ended undone, and what hangs on it."""

    recovery: str
    """Class of the action: R1 is repeated without harm."""

    tries: int
    choices: list[RecoveryChoice]
    skips: list[str]
    """Sentences of the jobs that are skipped with it."""

    relying: list[str]
    """Sentences of later jobs that use what it was to change."""

    asked_ul: float | None
    moved_ul: float | None
    """What the device has moved of it, over all its tries."""

    params: dict[str, Any]


class LotThere(ApiAnswer):
    """A lot of which a person says how much of it is meant."""

    key: str
    name: str
    held_ul: float | None
    """How much there is of a liquid; null: it is a solid."""

    held_mg: float | None


class StatementAsked(ApiAnswer):
    """Lots of a vessel of which a person says how much is meant."""

    label: str
    leaves_out: bool
    """With nothing of any lot the step is left out; else each lot is stated, "none" too."""

    lots: list[LotThere]


class JobAsks(ApiAnswer):
    """What a person confirms before a job is sent, and who has."""

    text: str
    states: StatementAsked | None
    """What they state of each lot of a vessel in its place, once it is due."""

    is_due: bool
    confirmed_by: str | None
    confirmed_at: datetime | None


class MeasuredAmount(ApiAnswer):
    """How much the readings before and since say was moved."""

    text: str
    """The subtraction in words, or which reading is missing."""

    before_ul: float | None
    after_ul: float | None
    moved_ul: float | None
    tolerance_ul: float
    answer: PlungerAnswer | None
    """Answer that agrees; null: none does for certain."""

    contradicts: list[PlungerAnswer]
    """Answers without an amount that the readings contradict."""


class JobQuestion(ApiAnswer):
    """What a person is asked about a job in doubt."""

    text: str
    attempt_id: UUID | None
    """The try that is in doubt: an answer names it."""

    asked_ul: float | None
    source: str
    target: str
    measured: MeasuredAmount | None
    """What the readings say; null: no reading tells how far such an action came."""

    then: dict[str, list[RecoveryChoice]]
    """By answer: what may follow it in the same request."""

    answer_sent: bool
    answered_by: str | None
    """Who has answered, while the host has not heard of it."""

    answered_at: datetime | None


class JobTransaction(ApiAnswer):
    """The transaction of the newest try of a job."""

    id: UUID
    state: str


class JobRow(ApiAnswer):
    """One job of a run, with what is known of its outcome."""

    id: UUID
    index: int
    step_id: str
    sentence: str
    device: KeyedRef
    choices_count: int
    """How many devices may do it, where its step asks for a role; 0: its device alone."""

    chosen: str | None
    """Why it is that device, or why it waits for any."""

    action: str
    args: dict[str, Any]
    corrections: list[Correction]
    operation: dict[str, Any]
    """What it does to the record, as it is kept."""

    state: JobState
    state_at: datetime
    started_at: datetime | None
    ended_at: datetime | None
    uncertainty_s: float | None
    """How far both of these may be from the truth; null: nobody knows."""

    is_bounded: bool
    estimate_s: float
    verification: str
    code: str
    message: str
    evidence: dict[str, Any]
    """What was read, reported and answered, as it is kept."""

    after: list[int]
    meets: int | None
    """Place in the plan of the job that begins at the same moment."""

    transaction: JobTransaction | None
    passed_by: PassedBy | None
    halted_by: str | None
    """Why its device was halted after it was done, which undid it; `let_go`: somebody goes on."""

    is_halt_certain: bool
    """Whether that ends for certain what it had begun; of a foreign node only its maker knows."""

    recovery_class: str
    question: JobQuestion | None
    recovery: RecoveryCard | UnsetType | None = UNSET
    """Left out where a job stands alone."""

    asks: JobAsks | UnsetType | None = UNSET
    """What a person confirms before it is sent; null: nothing. Left out as `recovery` is."""
