"""What a device's readings say of an action in doubt, and whether a person's answer agrees."""

from __future__ import annotations

from dataclasses import dataclass

from labweb.domain.calibration.correction import CalibrationQuantity, Correction
from labweb.domain.errors import Finding, LabError
from labweb.domain.runs.after_failure.recovery_choices import Ended, PersonChoice, choices_for

PLUNGER = "volume_ul"
"""Status of a syringe pump: what its syringe holds, by the place of its plunger."""

DIRECTIONS = {"aspirate": 1, "dispense": -1}
"""By action: whether what the syringe holds grows or shrinks with what is moved."""

NL_PER_UL = 1000
_SMALL_UL = 1000.0
"""Below this a volume is told in microlitres."""

AFTERWARDS = ("retry", "skip", "done_by_hand")
"""What may follow an answer in the same request; `change` needs the plan of afterwards."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plunger:
    """Where a plunger stood just before an action, and where it stands since."""

    action: str
    asked_nl: int
    before_ul: float | None
    after_ul: float | None
    why_no_after: str = ""
    """Why the present place is not known."""

    tolerance_ul: float
    """How far two places may differ and be the same."""

    correction: Correction | None = None
    """Calibration that the action was sent with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlungerMeasured:
    """What the plunger says of how much was moved."""

    text: str
    """The subtraction in words, or which of both readings is missing."""

    before_ul: float | None
    after_ul: float | None
    moved_nl: int | None
    """None: a reading is missing, or the plunger went the other way. Nothing is guessed."""

    tolerance_nl: int
    answer: str = ""
    """Answer that agrees: `happened`, `did_not` or `partly`; empty: none does for certain."""


def measure(plunger: Plunger) -> PlungerMeasured:
    """Subtract the place before from the place now.

    Source:
        A syringe moves what its plunger sweeps; a calibration turns what the device tells into
        what is true.
    """
    before, after = plunger.before_ul, plunger.after_ul
    tolerance_nl = max(1, round(plunger.tolerance_ul * NL_PER_UL))
    if before is None or after is None:
        return PlungerMeasured(
            text=_missing(plunger),
            before_ul=before,
            after_ul=after,
            moved_nl=None,
            tolerance_nl=tolerance_nl,
        )
    first, last = (after, before) if DIRECTIONS[plunger.action] > 0 else (before, after)
    told_ul = first - last
    is_small = max(before, after, plunger.asked_nl / NL_PER_UL) < _SMALL_UL
    stood, stands = _told(before, is_small=is_small), _told(after, is_small=is_small)
    text = f"The plunger stood at {stood} before and stands at {stands} now: "
    if told_ul < -plunger.tolerance_ul:
        text += "it went the other way, so it does not tell what was moved."
        return PlungerMeasured(
            text=text, before_ul=before, after_ul=after, moved_nl=None, tolerance_nl=tolerance_nl
        )
    told_ul = max(told_ul, 0.0)
    text += (
        f"{_number(first, is_small=is_small)} \N{MINUS SIGN} {_number(last, is_small=is_small)} "
        f"= {_told(told_ul, is_small=is_small)} moved."
    )
    moved_nl = round(told_ul * NL_PER_UL)
    correction = plunger.correction
    if correction is not None and correction.quantity is CalibrationQuantity.VOLUME and moved_nl:
        moved_nl = max(0, round(correction.true_of(told_ul) * NL_PER_UL))
        true = _told(moved_nl / NL_PER_UL, is_small=is_small)
        text += f" By calibration {correction.number} that is {true}."
    return PlungerMeasured(
        text=text,
        before_ul=before,
        after_ul=after,
        moved_nl=moved_nl,
        tolerance_nl=tolerance_nl,
        answer=_answer(plunger.asked_nl, moved_nl, tolerance_nl),
    )


def _answer(asked_nl: int, moved_nl: int, tolerance_nl: int) -> str:
    if abs(moved_nl - asked_nl) <= tolerance_nl:
        return "happened"
    if moved_nl <= tolerance_nl:
        return "did_not"
    return "partly" if moved_nl < asked_nl else ""


def _missing(plunger: Plunger) -> str:
    parts = []
    for value, is_before in ((plunger.before_ul, True), (plunger.after_ul, False)):
        if value is not None:
            told = _told(value, is_small=value < _SMALL_UL)
            parts.append(
                f"It stood at {told} before." if is_before else f"It stands at {told} now."
            )
        elif is_before:
            parts.append("Where the plunger stood before is missing: it was not read.")
        else:
            parts.append(f"Where the plunger stands now is missing: {plunger.why_no_after}.")
    return " ".join(sorted(parts, key=lambda one: not one.startswith("Where")))


def _number(value_ul: float, *, is_small: bool) -> str:
    return f"{value_ul:.2f}" if is_small else f"{value_ul / 1000:.3f}"


def _told(value_ul: float, *, is_small: bool) -> str:
    return f"{_number(value_ul, is_small=is_small)} {'µL' if is_small else 'mL'}"


def against_the_record(error: LabError) -> str:
    """Say of an answer that the record does not allow why not, and what can be answered."""
    return (
        f"The record contradicts this answer: {error.message}. Answer that nobody can tell, "
        "and then take stock of the vessels."
    )


def claimed_nl(answer: str, *, asked_nl: int, moved_nl: int | None) -> int | None:
    """Return how much an answer says was moved; None: it says nothing of that."""
    return {"happened": asked_nl, "did_not": 0, "partly": moved_nl}.get(answer)


def contradiction(
    measured: PlungerMeasured, answer: str, *, asked_nl: int, moved_nl: int | None
) -> Finding | None:
    """Return what is wrong with an answer that the plunger contradicts; None: nothing is.

    Example:
        >>> told = measure(Plunger(action="dispense", asked_nl=5_000_000, before_ul=10_000.0,
        ...     after_ul=6_500.0, tolerance_ul=10.0))
        >>> told.text[:67]
        'The plunger stood at 10.000 mL before and stands at 6.500 mL now: 1'
        >>> contradiction(told, "happened", asked_nl=5_000_000, moved_nl=None).code
        'run.contradicts_reading'
    """
    claimed = claimed_nl(answer, asked_nl=asked_nl, moved_nl=moved_nl)
    if claimed is None or measured.moved_nl is None:
        return None
    if abs(claimed - measured.moved_nl) <= measured.tolerance_nl:
        return None
    said, told, about = (
        f"{nl / 1_000_000:.3f} mL" for nl in (claimed, measured.moved_nl, measured.tolerance_nl)
    )
    message = (
        f"the answer says that {said} moved, and the plunger says {told} ± {about}: look again, "
        "or say that the answer stands despite the reading"
    )
    context = {
        "claimed_nl": claimed,
        "measured_nl": measured.moved_nl,
        "tolerance_nl": measured.tolerance_nl,
        "reading": measured.text,
    }
    return Finding("run.contradicts_reading", message, "answer", context)


def is_worth_reading(
    measured: PlungerMeasured, answer: str, *, asked_nl: int, moved_nl: int | None
) -> bool:
    """Tell whether a reading that is still to come could contradict an answer."""
    is_told = claimed_nl(answer, asked_nl=asked_nl, moved_nl=moved_nl) is not None
    return is_told and measured.before_ul is not None and measured.after_ul is None


@dataclass(frozen=True, slots=True, kw_only=True)
class LateAnswer:
    """An answer that was given before its device was read, and what that reads now."""

    by: str
    """Who answered."""

    device: str
    source: str
    target: str
    claimed_nl: int
    measured_nl: int
    reading: str


def later_words(told: LateAnswer) -> str:
    """Say what was answered, what the device reads now, by how much they differ, what to do.

    Example:
        >>> told = later_words(Later(by="Li Na", device="Pump 1", source="Water", target="Syringe",
        ...     claimed_nl=5_000_000, measured_nl=2_500_000, reading="It stands at 2.500 mL now."))
        >>> told.partition(": ")[0]
        'Pump 1 reads otherwise than Li Na answered before it was read'
    """
    more, less = told.source, told.target
    if told.measured_nl > told.claimed_nl:
        more, less = less, more
    differ_nl = abs(told.measured_nl - told.claimed_nl)
    claimed, measured, by = (
        f"{nl / 1_000_000:.3f} mL" if nl else "nothing"
        for nl in (told.claimed_nl, told.measured_nl, differ_nl)
    )
    return (
        f"{told.device} reads otherwise than {told.by} answered before it was read: {told.by} "
        f"answered that {claimed} moved from {told.source} to {told.target}, and the plunger says "
        f"{measured}. {told.reading} If the reading is right, {more} holds {by} more than the "
        f"record says, and {less} {by} less. Nothing was changed: look, then take stock of both or "
        "keep the record, and close this"
    )


def choices_after(job: Ended, *, is_step_untouched: bool) -> tuple[PersonChoice, ...]:
    """List what may follow an answer that leaves a job undone, as recovery would offer it then."""
    found = choices_for(job, is_step_untouched=is_step_untouched)
    return tuple(one for one in found if one.name in AFTERWARDS)
