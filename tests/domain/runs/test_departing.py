"""What a person lets pass of a run that leaves its proof, and what not."""

from __future__ import annotations

from labweb.domain.runs.after_failure import plan_departures

SAID = plan_departures.skipped("Move 5 mL of water from S to R")


def skip(job_id: str) -> dict[str, str]:
    return {"choice": "skip", "job_id": job_id, "departs": SAID}


def test_the_same_words_at_another_place_are_not_accepted_with_the_first() -> None:
    accepted = plan_departures.departures([skip("1")])
    told = plan_departures.departures([skip("1"), skip("2")])
    found = plan_departures.check_departed(told, accepted)
    assert [(one.message, one.subject) for one in found] == [(SAID, "2")]
    assert plan_departures.check_departed(told, told) == []


def test_what_is_not_known_after_another_try_is_not_accepted_with_the_first() -> None:
    first, second = (
        {"choice": "retry", "job_id": "1", "departs": plan_departures.unknown("Stir", tries)}
        for tries in (1, 2)
    )
    accepted = plan_departures.departures([first])
    assert plan_departures.check_departed(plan_departures.departures([first, second]), accepted)
