"""What a device told, and what that is by the calibration in force when it was planned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from labweb.domain.calibration.correction import CalibrationQuantity, Correction


def corrected(
    corrections: Iterable[Correction], told: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return the corrected values of a report by status, each with the raw one beside it.

    Outside what was calibrated the value is None: nothing is extrapolated. What an action was
    given is no reading, but for a temperature, which it reads when it has reached it.

    Example:
        >>> from uuid import UUID
        >>> one = Correction(
        ...     argument="value_ph", quantity=Quantity.PH, asked=None, sent=None, gain=1.05,
        ...     offset=-0.3, calibration_id=UUID(int=1), number=2,
        ... )
        >>> corrected([one], {"value_ph": 7.0})["value_ph"]["value"]
        7.05
    """
    found: dict[str, dict[str, Any]] = {}
    for one in corrections:
        raw = told.get(one.argument)
        is_sent = one.asked is not None and one.quantity is not CalibrationQuantity.TEMPERATURE
        if is_sent or isinstance(raw, bool) or not isinstance(raw, int | float):
            continue
        value = one.true_of(raw)
        is_known = (one.low is None or value >= one.low) and (one.high is None or value <= one.high)
        found[one.argument] = {
            "raw": raw,
            "value": value if is_known else None,
            "calibration_id": str(one.calibration_id),
            "number": one.number,
        }
    return found
