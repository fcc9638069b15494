"""What an error code of the S7 protocol says about what happened.

Source:
    S7 communication as python-snap7 and Wireshark's dissector `packet-s7comm` write it down:
    return codes of an item, and error class and code of a header.
"""

from __future__ import annotations

from labweb.domain.errors import DeviceError, FrameError, RejectedError

TAKEN = 0xFF
REFUSED_ITEMS = {
    0x03: "access is not allowed",
    0x05: "the address is beyond the object",
    0x06: "the data type is not supported",
    0x07: "the data type is inconsistent",
    0x0A: "the object does not exist",
}
"""Return codes of an item that the controller did not touch."""

HARDWARE = 0x01
REFUSED_CLASSES = frozenset({0x81, 0x84, 0x87})
"""Error classes of a job that was not begun: the application's relation, its service, access."""


def failure_of_item(code: int, what: str, line: str) -> DeviceError:
    """Turn the return code of an item into the error that says what may have happened.

    Args:
        code: Not 0xFF.
        what: What was asked for.
        line: Who was asked.
    """
    context = {"line": line, "return_code": code}
    if code in REFUSED_ITEMS:
        text = f"{what}: {REFUSED_ITEMS[code]} (return code 0x{code:02X})"
        return RejectedError(text, context=context)
    if code == HARDWARE:
        text = f"{what}: the controller reports a hardware error"
        return DeviceError(text, code="device.alarm", context=context)
    return FrameError(f"{what}: return code 0x{code:02X} is none that is known", context=context)


def failure_of_job(code: int, line: str) -> DeviceError:
    """Turn error class and code of a header into the error that says what may have happened.

    Args:
        code: Class in the high byte; not zero.
        line: Who was asked.
    """
    context = {"line": line, "error_code": code}
    if code >> 8 in REFUSED_CLASSES:
        return RejectedError(f"{line} refused the job: error 0x{code:04X}", context=context)
    text = f"{line} failed in the job: error 0x{code:04X}"
    return DeviceError(text, code="device.alarm", context=context)
