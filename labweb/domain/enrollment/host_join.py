"""How a machine asks to become an edge host: token, code, and the words on the wire.

```text
host                              door (TLS, certificate of the lab's authority)
 │ connect, verify nothing          │
 │ ◀──────── Offer: authority ──────│   hash differs from the token's: leave, nothing was said
 │ connect, verify the authority    │
 │ ◀──────── Offer ─────────────────│
 │ ───────── Ask: token, CSR ──────▶│   token is used up; the host waits in the inbox
 │ ◀──────── Waiting: code ─────────│   an admin types the code that the host shows
 │ ◀──────── Admitted: certificate ─│
```
"""

from __future__ import annotations

import hashlib
import hmac
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from uuid import UUID

import msgspec

from labweb.domain.enrollment.device_announcements import is_legible
from labweb.domain.errors import DefinitionError
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION
from labweb.domain.messages.session import Refuse

SERVER_NAME = "edge.labweb"
"""Name in the door's certificate: it proves the lab, whatever address the door has."""

TOKEN_MARK = "ULJ1"  # noqa: S105 - it begins every token
SECRET_BYTES = 16
LONGEST_TOKEN_S = 3600.0
USUAL_TOKEN_S = 900.0
WAITS_FOR_S = 86400.0
"""How long a machine that has asked waits for a person, before it has to ask again."""

CERTIFICATE_S = 90 * 86400.0
RENEW_AT = 2 / 3
"""Part of a certificate's life after which the host asks for the next one."""

LONGEST_NAME = 100
LONGEST_CSR_BYTES = 4096
MOST_FACTS = 16
LONGEST_FACT = 200

CODE_SIGNS = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
CODE_COUNT = 12
_GROUP = 4
_READ_AS = str.maketrans({"O": "0", "I": "1", "L": "1"})


@dataclass(frozen=True, slots=True)
class Token:
    """What an admin gives to one machine: which lab to trust, and a secret to be let in by."""

    ca_hash: str
    """SHA-256 of the authority's public key (SubjectPublicKeyInfo), lower-case hex."""

    token_id: UUID
    secret: str
    """128 random bits, lower-case hex. The server keeps its hash alone."""


def render_token(token: Token) -> str:
    """Write a token as it is handed over."""
    return f"{TOKEN_MARK}.{token.ca_hash}.{token.token_id.hex}.{token.secret}"


_TOKEN = re.compile(rf"{TOKEN_MARK}\.([0-9a-f]{{64}})\.([0-9a-f]{{32}})\.([0-9a-f]{{32}})")


def parse_token(text: str) -> Token:
    """Read a token.

    Raises:
        DefinitionError: It is none; nothing of it is repeated in the message.
    """
    found = _TOKEN.fullmatch(text.strip())
    if found is None:
        raise DefinitionError(
            f"this is no join token: one begins with {TOKEN_MARK}. and is 135 signs long; "
            "copy it whole, or ask an admin for another",
            code="join.bad_token",
        )
    return Token(found[1], UUID(found[2]), found[3])


def secret_hash(secret: str) -> str:
    """Return what the server keeps of a token's secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def is_secret(secret: str, kept_hash: str) -> bool:
    """Tell whether this is the secret, in a time that says nothing about how far it fits."""
    return hmac.compare_digest(secret_hash(secret), kept_hash)


def code_of(ca_hash: str, public_key: bytes) -> str:
    """Return the short code of a key in a lab, 60 bits as three groups of four signs.

    Host and server each compute it for themselves, from both keys: whoever stands between
    cannot make both show the same.

    Args:
        ca_hash: Hash of the lab's authority.
        public_key: Raw public key of the host or device.

    Source:
        Base32 of Douglas Crockford: no I, L, O, U.
    """
    digest = hashlib.sha256(b"labweb code 1\0" + ca_hash.encode() + b"\0" + public_key).digest()
    number = int.from_bytes(digest[:8], "big") >> 4
    signs = "".join(CODE_SIGNS[number >> 5 * place & 31] for place in reversed(range(CODE_COUNT)))
    return "-".join(signs[at : at + _GROUP] for at in range(0, CODE_COUNT, _GROUP))


def is_code(typed: str, code: str) -> bool:
    """Tell whether a person typed the code; case, blanks, hyphens and O for 0 do not matter."""
    return hmac.compare_digest(_plain(typed), _plain(code))


def _plain(text: str) -> bytes:
    return re.sub(r"[\s\-]", "", text).upper().translate(_READ_AS).encode()


def key_of_name(name: str) -> str:
    """Return the key of a host of that name in lab files and queues.

    Example:
        >>> key_of_name("Bench 2, Räum B")
        'bench_2_raum_b'
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")


def renew_due_s(not_before_s: float, not_after_s: float) -> float:
    """Return when a host asks for its next certificate, in seconds of the Unix epoch."""
    return not_before_s + (not_after_s - not_before_s) * RENEW_AT


def find_known(hosts: Iterable[tuple[UUID, str, str]], *, key: str, machine_id: str) -> UUID | None:
    """Return the host that a machine with another key claims to be, or None.

    It is the same machine, or it wants the same name; either way a person has to say.

    Args:
        hosts: Id, key and machine id of each host of the lab.
        key: Key that follows from the name it asks for.
        machine_id: What the machine says it is; "" is no machine.
    """
    rows = list(hosts)
    by_machine = (i for i, _, machine in rows if machine_id and machine == machine_id)
    by_name = (i for i, known_key, _ in rows if known_key == key)
    return next(by_machine, None) or next(by_name, None)


# --- frames ------------------------------------------------------------------------


class JoinOffer(msgspec.Struct, frozen=True, tag="offer", tag_field="t", kw_only=True):
    """First frame of the door: the lab's authority. Worth nothing before its hash was compared."""

    ca: str
    """Certificate, PEM."""

    v: int = PROTOCOL_VERSION


class JoinAsk(msgspec.Struct, frozen=True, tag="ask", tag_field="t", kw_only=True):
    """A machine asks to become a host. Sent again after a crash, with the same key."""

    token_id: UUID
    secret: str
    csr: str
    """PKCS #10, PEM, signed by the key it asks a certificate for."""

    name: str
    machine_id: str = ""
    """Hash that names the machine and says nothing else about it."""

    facts: dict[str, str] = msgspec.field(default_factory=dict)
    """What the machine says of itself, for the admin to read; believed by nobody."""

    v: int = PROTOCOL_VERSION


class JoinWaiting(msgspec.Struct, frozen=True, tag="waiting", tag_field="t", kw_only=True):
    """A person has to compare the code."""

    code: str


class AdmittedHost(msgspec.Struct, frozen=True, tag="admitted", tag_field="t", kw_only=True):
    """The machine is a host."""

    host_id: UUID
    name: str
    certificate: str
    """PEM, for the key of the request."""


JoinFrame = JoinOffer | JoinWaiting | AdmittedHost | Refuse


def is_name(text: str) -> bool:
    """Tell whether a text names a machine or a device so that nobody takes it for another.

    Example:
        >>> is_name("Bench 9"), is_name("Bench\u202e9"), is_name("--")
        (True, False, False)
    """
    return bool(key_of_name(text)) and len(text) <= LONGEST_NAME and is_legible(text)


def check_ask(ask: JoinAsk) -> str:
    """Say what is wrong with a request before its token is looked at; "" means nothing."""
    if not is_name(ask.name):
        return f"the name has 1 to {LONGEST_NAME} legible signs, a letter or digit among them"
    if len(ask.csr) > LONGEST_CSR_BYTES:
        return f"the signing request is longer than {LONGEST_CSR_BYTES} bytes"
    if len(ask.machine_id) > LONGEST_FACT or not ask.machine_id.isprintable():
        return f"the machine id is longer than {LONGEST_FACT} printable signs"
    texts = [text for pair in ask.facts.items() for text in pair]
    is_wrong = any(len(text) > LONGEST_FACT or not text.isprintable() for text in texts)
    if len(ask.facts) > MOST_FACTS or is_wrong:
        return f"at most {MOST_FACTS} facts of {LONGEST_FACT} printable signs"
    return ""
