"""Ask a time-stamping authority to confirm when something existed.

Source:
    RFC 3161, Internet X.509 Public Key Infrastructure Time-Stamp Protocol; over HTTP by 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass

from rfc3161_client import TimestampRequestBuilder, decode_timestamp_response

from labweb.domain.errors import StateError

_GRANTED = (0, 1)
"""`granted` and `grantedWithMods` of PKIStatus, RFC 3161 2.4.2."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A question to an authority."""

    der: bytes
    """TimeStampReq, DER."""

    digest: bytes
    """SHA-512 of what is to be stamped."""

    nonce: int | None


def request_over(content: bytes) -> Asked:
    """Return the question that asks for a stamp over these bytes; only their digest is sent."""
    built = TimestampRequestBuilder().data(content).build()
    return Asked(der=built.as_bytes(), digest=built.message_imprint.message, nonce=built.nonce)


def check_answer(asked: Asked, raw: bytes) -> None:
    """Refuse an answer that stamps nothing, or something else than was asked.

    Whether its signer is to be trusted is for whoever holds the authority's certificate:
    `openssl ts -verify` says.

    Raises:
        StateError: So it is.
    """
    try:
        answer = decode_timestamp_response(raw)
        is_granted = answer.status in _GRANTED
        info = answer.tst_info if is_granted else None
    except ValueError as error:
        text = f"the authority's answer is no time stamp: {error}"
        raise StateError(text, code="records.bad_stamp") from error
    if info is None:
        said = "; ".join(answer.status_string) or "no reason"
        raise StateError(f"the authority refuses: {said}", code="records.bad_stamp")
    if info.message_imprint.message != asked.digest or info.nonce != asked.nonce:
        text = "the authority stamped something else than was asked"
        raise StateError(text, code="records.bad_stamp")
