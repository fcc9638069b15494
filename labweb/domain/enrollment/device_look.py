"""What a look at a device that nothing serves yet has proved: each check with its verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import DriverSpec, check_reading

LONGEST_LOOK_S = 10.0
"""Longest time that asking who answers and for every status once may take."""

LONGEST_SKEW_S = 1.0
"""Furthest that a host's clock may be from the server's."""

GIVEN_UP_S = 150.0
"""A look of which its host has said nothing for so long was lost, and may be asked anew."""


class LookCheck(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was to be proved."""

    name: str
    is_passed: bool
    text: str
    """What is true, in words."""


def judge_look(
    spec: DriverSpec,
    *,
    problem: str,
    values: Mapping[str, Any],
    problems: Mapping[str, str],
    took_s: float,
    skew_s: float | None,
) -> list[LookCheck]:
    """Return every check of a look, passed or not.

    Args:
        spec: What the driver declares.
        problem: Why the device did not answer as the expected model; empty: it did.
        values: What it told, by status.
        problems: Why a status was not told.
        took_s: How long it all took.
        skew_s: The host's clock less the server's; None: nobody knows.
    """
    checks = [
        LookCheck(
            name="who answers",
            is_passed=not problem,
            text=problem or f"a device that {spec.class_name} takes for its own",
        )
    ]
    if problem:
        return checks
    checks.append(_told(spec, values, problems))
    checks.append(
        LookCheck(
            name="how fast",
            is_passed=took_s <= LONGEST_LOOK_S,
            text=f"{took_s:.2f} s for all of it; at most {LONGEST_LOOK_S:g} s",
        )
    )
    return [*checks, _clock(skew_s)]


def _told(spec: DriverSpec, values: Mapping[str, Any], problems: Mapping[str, str]) -> LookCheck:
    found = []
    for status in spec.statuses:
        if status.name in problems:
            found.append(f"{status.name}: {problems[status.name]}")
        elif status.name not in values:
            found.append(f"{status.name}: it was not asked, because the device had fallen silent")
        else:
            told = check_reading(status.value, values[status.name])
            found += [f"{status.name}: {one.message}" for one in told]
    text = "; ".join(found) or f"all that it declares: {len(spec.statuses)}"
    return LookCheck(name="what it tells", is_passed=not found, text=text)


def _clock(skew_s: float | None) -> LookCheck:
    if skew_s is None:
        text = "nobody knows how the host's clock stands: wait for its next sign of life"
        return LookCheck(name="clock of the host", is_passed=False, text=text)
    return LookCheck(
        name="clock of the host",
        is_passed=abs(skew_s) <= LONGEST_SKEW_S,
        text=f"{abs(skew_s):.2f} s from the server's; at most {LONGEST_SKEW_S:g} s",
    )
