"""Lines, weights and XML of a Mettler-Toledo Quantos, as bytes and back.

Source:
    As three open drivers agree on them; weights: Mettler-Toledo, MT-SICS reference manual.
"""

from __future__ import annotations

import re
from html import unescape
from typing import NamedTuple

from labweb.domain.errors import Effect, FrameError, RejectedError

MG_PER_UNIT = {"g": 1000.0, "mg": 1.0, "kg": 1_000_000.0}
NOT_ALLOWED = 5
REASONS = {
    1: "it is not mounted",
    2: "another job is running",
    3: "it took too long",
    4: "it is not selected",
    5: "it is not allowed at the moment: look at target, doors, pin of the head and vial",
    6: "the weight is not steady",
    7: "the powder does not flow",
    8: "it was stopped",
    9: "the safe position failed",
    10: "the head is not allowed",
    11: "the head has reached its number of doses",
    12: "the head has reached its expiry date",
    13: "the sampler is blocked",
}


class QuantosRefusal(NamedTuple):
    """An answer that says no."""

    number: int
    """Of `REASONS`; 0 for a wrong argument."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("QRA 61 1")
        b'QRA 61 1\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_line(frame: bytes, name: str) -> str | QuantosRefusal:
    r"""Read what the last line of an answer says after the name of its command.

    Raises:
        RejectedError: The dispenser does not know the command.
        FrameError: Not an answer to it.

    Example:
        >>> decode_line(b"QRD 2 3 7 3 A\r\n", "QRD 2 3 7")
        '3 A'
        >>> decode_line(b"QRA 61 1 I 7\r\n", "QRA 61 1")
        Refused(number=7)
    """
    try:
        line = frame.decode("ascii").removesuffix("\r\n").rpartition("\r\n")[2]
    except UnicodeDecodeError as error:
        raise FrameError("answer is not text", context={"frame": frame[:200].hex()}) from error
    if line in {"ES", "ET", "EL"}:
        raise RejectedError(f"dispenser answered {line} to {name}", context={"answer": line})
    if not line.startswith(f"{name} "):
        raise FrameError(f"no answer to {name}", context={"answer": line[:200]})
    told = line.removeprefix(f"{name} ")
    if told == "L":
        return QuantosRefusal(0)
    if found := re.fullmatch(r"I(?: ([0-9]{1,2}))?", told):
        return QuantosRefusal(int(found[1] or NOT_ALLOWED))
    return told


def decode_weight(frame: bytes) -> tuple[bool, float]:
    r"""Read whether a weight is steady, and the weight in mg.

    Raises:
        RejectedError: The balance has no weight now.
        FrameError: Not an answer to S or SI.

    Example:
        >>> decode_weight(b"S S     0.05012 g\r\n")
        (True, 50.12)
    """
    text = frame.decode("ascii", "replace").removesuffix("\r\n").rpartition("\r\n")[2]
    if re.fullmatch(r"SI? [I+-]|E[STL]", text):
        raise RejectedError(f"the balance has no weight now: {text}", context={"answer": text})
    found = re.fullmatch(r"SI? ([SD]) +(-?[0-9]+(?:\.[0-9]+)?) +(g|mg|kg) *", text)
    if found is None:
        raise FrameError("answer is no weight", context={"frame": frame[:200].hex()})
    return found[1] == "S", round(float(found[2]) * MG_PER_UNIT[found[3]], 6)


def decode_element(frame: bytes, name: str) -> str:
    """Read the text of the one XML element of a name.

    Raises:
        FrameError: There is none, or several.

    Example:
        >>> decode_element(b'<Content Unit="mg">50.12</Content>', "Content")
        '50.12'
    """
    text = frame.decode("ascii", "replace")
    tag = re.escape(name)
    found = re.findall(rf"<{tag}(?: [^<>]*)?>([^<>]*)</{tag}>", text)
    if len(found) != 1:
        raise FrameError(f"answer has {len(found)} elements {name}", context={"answer": text[:200]})
    return unescape(found[0]).strip()


def decode_mass(frame: bytes, name: str) -> float:
    """Read a mass in mg.

    Raises:
        FrameError: It is missing, in another unit, or no number.

    Example:
        >>> decode_mass(b'<Content Unit="mg">50.12</Content>', "Content")
        50.12
    """
    text = decode_element(frame, name)
    has_unit = f'<{name} Unit="mg">'.encode() in frame
    if not has_unit or not re.fullmatch(r"-?[0-9]{1,9}(\.[0-9]{1,9})?", text):
        raise FrameError(f"{name} is {text!r}, no mass in mg")
    return float(text)


def decode_document(frame: bytes, name: str) -> bytes:
    r"""Return the XML of an answer as it came, without the lines that frame it.

    Raises:
        FrameError: There is none.

    Example:
        >>> decode_document(b"QRD 2 4 12 B\r\n<Data>\r\n</Data>\r\nQRD 2 4 12 A\r\n", "QRD 2 4 12")
        b'<Data>\r\n</Data>\r\n'
    """
    framed = re.escape(name.encode("ascii"))
    found = re.search(rb"%b B\r\n(<.+>\r\n)%b A\r\n" % (framed, framed), frame, re.DOTALL)
    if found is None:
        raise FrameError(f"answer to {name} has no document", context={"frame": frame[:200].hex()})
    return found[1]


def refusal(what: str, told: QuantosRefusal, *, has_begun: bool = False) -> RejectedError:
    """Say why the dispenser did not do it; UNKNOWN once it had begun."""
    reason = REASONS.get(told.number, "the argument is wrong")
    return RejectedError(
        f"the dispenser did not {what}: {reason}",
        effect=Effect.UNKNOWN if has_begun else Effect.NONE,
        context={"number": told.number},
    )
