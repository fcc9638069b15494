"""Version of what server and host say to each other."""

from __future__ import annotations

import re

import msgspec

PROTOCOL_VERSION = 6
_TAG = re.compile(r"[a-z_]{1,40}")


class _Tagged(msgspec.Struct):
    t: str


def version_refusal(*, host: int, server: int) -> str:
    """Say why host and server do not understand each other; empty: they do.

    Neither guesses what the other's frames and commands mean: a command of another version is
    not carried out, so a session would only be a lab that stands still.
    """
    if host == server:
        return ""
    older = "server" if server < host else "host"
    return (
        f"the host speaks version {host} of the protocol, the server version {server}: "
        f"update the {older}"
    )


NOT_KNOWN = "this server does not know what it sends, one of them is older: "


def unknown_frame(raw: bytes) -> str:
    """Say what a frame is that could not be read; it fits into the close frame of a websocket.

    Source:
        RFC 6455, 5.5: the reason of a close has at most 123 bytes.
    """
    try:
        tag = msgspec.json.decode(raw, type=_Tagged).t
    except (msgspec.MsgspecError, RecursionError):
        return "no frame"
    return f"frame {tag}" if _TAG.fullmatch(tag) else "no frame"
