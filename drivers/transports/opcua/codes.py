"""What a status code of OPC UA says about what happened.

Source:
    OPC 10000-4, 7.39, table of common status codes; OPC 10000-4, 5.12.2.4, for calls.
"""

from __future__ import annotations

from labweb.domain.errors import DeviceError, Effect, RejectedError, UnreachableError

LOST = frozenset(
    {"BadSessionIdInvalid", "BadSessionClosed", "BadSessionNotActivated", "BadSecureChannelClosed"}
    | {"BadSecureChannelIdInvalid", "BadTcpSecureChannelUnknown", "BadSecurityChecksFailed"}
    | {"BadIdentityTokenInvalid", "BadIdentityTokenRejected"}
)
"""The server does not know who asks; it has done nothing."""

REFUSED = frozenset(
    {"BadNodeIdUnknown", "BadNodeIdInvalid", "BadAttributeIdInvalid", "BadIndexRangeInvalid"}
    | {"BadMethodInvalid", "BadArgumentsMissing", "BadTooManyArguments", "BadInvalidArgument"}
    | {"BadNotReadable", "BadNotWritable", "BadWriteNotSupported", "BadUserAccessDenied"}
    | {"BadTypeMismatch", "BadOutOfRange", "BadInvalidState", "BadNotExecutable"}
    | {"BadServiceUnsupported", "BadNothingToDo", "BadTooManyOperations", "BadDecodingError"}
    | {"BadServerHalted", "BadTcpServerTooBusy", "BadTooManySessions", "BadRequestTooLarge"}
    | {"BadNotSupported", "BadNotImplemented", "BadRequestTypeInvalid"}
)
"""The server refused before it did anything."""


def failure(name: str, what: str, line: str) -> DeviceError:
    """Turn a bad status code into the error that says what may have happened.

    Args:
        name: The code, such as `BadOutOfRange`.
        what: What was asked for.
        line: Who was asked.
    """
    context = {"line": line, "status": name}
    if name in LOST:
        return UnreachableError(
            f"{what}: the session is lost ({name}); connect again",
            effect=Effect.NONE,
            context=context,
        )
    if name in REFUSED:
        return RejectedError(f"{what} was refused: {name}", context=context)
    return DeviceError(f"{what} failed: {name}", code="device.alarm", context=context)
