"""What a person writes when he lets something into the lab: reasons, and what can be kept."""

from __future__ import annotations

from labweb.domain.errors import DefinitionError


def refuse_no_reason(reason: str, asked: str, *, code: str) -> None:
    """Refuse an act without a reason, or with one that no record can hold.

    Args:
        reason: What was written.
        asked: What is wanted of the person: `say what you checked`.
        code: Of the error.

    Raises:
        DefinitionError: It is empty, or no text.
    """
    if not reason.strip():
        raise DefinitionError(f"{asked}: the reason is empty", code=code)
    if not is_text(reason):
        raise DefinitionError(
            "the reason holds the sign of code 0, which no text has: write it again", code=code
        )


def is_text(*texts: str) -> bool:
    """Tell whether a record can hold each of these.

    Example:
        >>> is_text("looked at it", "0815"), is_text("looked" + chr(0))
        (True, False)
    """
    return not any("\0" in text for text in texts)
