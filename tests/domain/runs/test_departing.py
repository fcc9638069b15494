"""What a person lets pass of a run that leaves its proof, and what not."""

from __future__ import annotations

from labweb.domain.runs.after_failure import departing

SAID = departing.skipped("Move 5 mL of water from S to R")


def skip(job_id: str) -> dict[str, str]:
    return {"choice": "skip", "job_id": job_id, "departs": SAID}


def test_the_same_words_at_another_place_are_not_accepted_with_the_first() -> None:
    accepted = departing.departures([skip("1")])
    told = departing.departures([skip("1"), skip("2")])
    found = departing.check_departed(told, accepted)
    assert [(one.message, one.subject) for one in found] == [(SAID, "2")]
    assert departing.check_departed(told, told) == []


def test_what_is_not_known_after_another_try_is_not_accepted_with_the_first() -> None:
    first, second = (
        {"choice": "retry", "job_id": "1", "departs": departing.unknown("Stir", tries)}
        for tries in (1, 2)
    )
    accepted = departing.departures([first])
    assert departing.check_departed(departing.departures([first, second]), accepted)
