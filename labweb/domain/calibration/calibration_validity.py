"""Whether an accepted calibration still holds."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from labweb.domain.calibration.correction import CalibrationStanding

FACTS: Mapping[str, str] = {
    "driver": "its driver is another version",
    "config": "its settings were changed",
    "transport": "it is reached over another line: make sure that it is the same instrument",
    "admitted_at": "it was admitted anew, as after a repair or an exchange",
}
"""What makes a device the one that was calibrated, and what a difference means in words."""


def standing_of(
    *,
    expires_at: datetime,
    is_withdrawn: bool,
    was: Mapping[str, Any],
    is_now: Mapping[str, Any],
    at: datetime,
) -> tuple[CalibrationStanding, tuple[str, ...]]:
    """Return the standing of an accepted calibration, and every reason in words.

    Args:
        expires_at: Its due date.
        is_withdrawn: A person took it back.
        was: The device as it was calibrated, by the names in `FACTS`.
        is_now: The device as it is.
        at: Now.

    Example:
        >>> from datetime import UTC
        >>> due = datetime(2026, 1, 1, tzinfo=UTC)
        >>> standing_of(expires_at=due, is_withdrawn=False, was={}, is_now={}, at=due)
        (<Standing.EXPIRED: 'expired'>, ('it was due on 2026-01-01',))
    """
    changed = tuple(text for name, text in FACTS.items() if was.get(name) != is_now.get(name))
    due = (f"it was due on {expires_at:%Y-%m-%d}",) if at >= expires_at else ()
    taken = ("it was withdrawn",) if is_withdrawn else ()
    reasons = (*taken, *changed, *due)
    if taken:
        return CalibrationStanding.WITHDRAWN, reasons
    if changed:
        return CalibrationStanding.CHANGED, reasons
    return (CalibrationStanding.EXPIRED, reasons) if due else (CalibrationStanding.IN_FORCE, ())
