"""What stood around an action at the moment of its start and of its answer."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import Annotated, Any
from uuid import UUID

import msgspec
from msgspec import Meta

from labweb.domain.canonical_json import canonical

MOST_READINGS = 200
LONGEST_TEXT = 200

_CALIBRATION = ("calibration", "offset_")
"""How a driver's settings that a calibration found are called."""

_CONTEXTS = frozenset({"context", "started_context", "actuated_context"})

_Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]
_Plain = bool | int | float | _Text | None


class EnvironmentReading(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The latest value of a status of a device of the host."""

    device_id: UUID
    status: Annotated[str, Meta(max_length=64)]
    value: _Plain
    age_s: Annotated[float, Meta(ge=0)]
    """How old it was, on the host's monotonic clock."""


class ActionContext(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Versions and readings of one moment."""

    driver_digest: _Text
    config_digest: _Text
    """SHA-256 of the device's settings, as canonical JSON."""

    calibration: Annotated[dict[_Text, _Plain], Meta(max_length=20)] = {}
    """Settings that a calibration found; empty: the device's settings state none."""

    environment: Annotated[list[EnvironmentReading], Meta(max_length=MOST_READINGS)] = []


def context_body(
    driver_digest: str,
    config: Mapping[str, Any],
    environment: Iterable[tuple[str, str, Any, float]],
) -> dict[str, Any]:
    """Return the context of a moment as plain data.

    Args:
        driver_digest: Of the driver's source that acts.
        config: Settings of the device that acts.
        environment: (device id, status, value, age in seconds) of what the host knows. The
            freshest are kept when there are too many.
    """
    calibration = {
        name: _short(value) for name, value in config.items() if name.startswith(_CALIBRATION)
    }
    readings = sorted(environment, key=lambda one: one[3])[:MOST_READINGS]
    return {
        "driver_digest": driver_digest,
        "config_digest": hashlib.sha256(canonical(dict(config))).hexdigest(),
        "calibration": calibration,
        "environment": [
            {
                "device_id": device_id,
                "status": status[:64],
                "value": _short(value),
                "age_s": round(max(0.0, age_s), 3),
            }
            for device_id, status, value, age_s in sorted(readings, key=lambda one: one[:2])
        ],
    }


def _short(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return a plain value; what is nested or long becomes a short text."""
    if value is None or isinstance(value, bool | int | float):
        return value
    text = value if isinstance(value, str) else canonical(value).decode()
    return text[:LONGEST_TEXT]


def read_context(value: Any) -> dict[str, Any] | None:  # noqa: ANN401 - hostile until parsed
    """Return a context that a host reported, as plain data; None: it is none."""
    try:
        found = msgspec.convert(value, ActionContext)
    except msgspec.ValidationError:
        return None
    plain: dict[str, Any] = msgspec.to_builtins(found)
    return plain


def without_surroundings(evidence: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out the readings of other devices: who may see a run may not know of them all."""
    return {
        key: {**value, "environment": []} if key in _CONTEXTS and isinstance(value, dict) else value
        for key, value in evidence.items()
    }
