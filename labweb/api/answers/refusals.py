"""Why a request was refused, and with which status: the one shape of every answer above 399."""

from __future__ import annotations

from typing import Any

from labweb.common.answers import ApiAnswer
from labweb.domain.errors import Effect, Finding


class Refusal(ApiAnswer):
    """Why a request was refused, and what it may have done."""

    code: str
    """Stable, `area.reason`; `http.…` where the request could not be read or carried out."""

    message: str
    effect: Effect
    context: dict[str, Any]
    findings: list[Finding]


REASONS = {
    400: "The request cannot be read, or has a parameter or a key that is none",
    401: "The access token is unknown, expired or revoked",
    403: "Nobody is signed in, or whoever is may not do this",
    404: "There is no such thing, or none that the caller may know of",
    406: "The answer cannot be had in the format that was asked for",
    409: "Not in this state, or not with this key",
    412: "A condition does not hold; the findings say which",
    413: "The body is too large",
    415: "The body has another media type",
    422: "The body or a parameter is not as described, or asks for what is not possible",
    423: "Somebody else holds it",
    429: "Too many requests, or too many wrong passwords; `Retry-After` says how long to wait",
    500: "The server failed at this request",
    503: "Not at the moment; the same request may succeed later",
}
"""Status → what it says, as the schema has it."""
