"""The newest signed heads in a file: what the database cannot take back."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
from django.conf import settings

from labweb.domain.errors import StateError
from labweb.domain.messages.devices_and_drivers import Signed


def _path() -> Path:
    return Path(os.environ.get("LABWEB_HEADS_FILE", settings.DATA_DIR / "heads.json"))


def _kept() -> dict[str, Signed]:
    path = _path()
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Signed])
    except FileNotFoundError:
        return {}
    except msgspec.MsgspecError as error:
        text = f"{path} is no file of signed heads: put it back from a copy, or move it away"
        raise StateError(text, code="records.bad_file") from error


def last_head(chain: str) -> Signed | None:
    """Return the head of a chain that was signed last on this machine, or None.

    Raises:
        StateError: The file is damaged.
    """
    return _kept().get(chain)


def keep_head(chain: str, signed: Signed) -> None:
    """Keep the newest head of a chain; on disk once this returns."""
    path = _path()
    content = msgspec.json.format(msgspec.json.encode({**_kept(), chain: signed}), indent=1)
    fresh = path.with_name(f".{path.name}.new")
    handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    fresh.replace(path)
