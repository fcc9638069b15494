"""Qualified names: a prefix for a namespace, and a local part that needs escaping."""

from __future__ import annotations

import re
from collections.abc import Mapping

PROV = "http://www.w3.org/ns/prov#"
XSD = "http://www.w3.org/2001/XMLSchema#"
BUILT_IN = {"prov": PROV, "xsd": XSD}
"""Prefixes that every document has."""

DEFAULT = "default"
"""Key under which a document declares the namespace of names without a prefix."""

_PLAIN = re.compile(r"[A-Za-z0-9_/]")
_LATER = re.compile(r"[A-Za-z0-9_/.\-]")
_ESCAPED = re.compile(r"%([0-9A-Fa-f]{2})")


def escape(text: str) -> str:
    """Write any text as the local part of a qualified name.

    What the grammar of PROV-N does not take as it stands is percent-encoded as UTF-8, so that
    two texts never share a name.

    Example:
        >>> escape("port index: 3 µL")
        'port%20index%3A%203%20%C2%B5L'
    """
    done = []
    for place, sign in enumerate(text):
        is_inside = 0 < place < len(text) - 1
        if (_LATER if is_inside else _PLAIN).fullmatch(sign):
            done.append(sign)
        else:
            done += [f"%{byte:02X}" for byte in sign.encode("utf-8", "surrogatepass")]
    return "".join(done)


def unescape(local: str) -> str:
    """Read a local part that `escape` wrote."""
    raw = b"".join(
        bytes.fromhex(part) if place % 2 else part.encode("utf-8", "surrogatepass")
        for place, part in enumerate(_ESCAPED.split(local))
    )
    return raw.decode("utf-8", "surrogatepass")


def expand(name: str, prefixes: Mapping[str, str]) -> str | None:
    """Return the full address that a name stands for; None when its prefix is not declared.

    A blank name (`_:x`) stands for itself.
    """
    if name.startswith("_:"):
        return name
    prefix, colon, local = name.partition(":")
    if not colon:
        space = prefixes.get(DEFAULT)
        return None if space is None or not name else space + name
    space = prefixes.get(prefix)
    return None if space is None else space + local
