"""Where a lab's data, sockets and logs lie, and who may use them."""

from __future__ import annotations

import fcntl
import json
import os
import re
import secrets
import shutil
import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from deploy.embedded.errors import EmbeddedError

CHECKOUT = Path(__file__).resolve().parents[2]
DEFAULT_LAB = CHECKOUT / "fixtures" / "labs" / "starter" / "lab.json"
_MARKER = "labweb.json"
_FORMAT = 1
# sun_path holds 108 bytes with its final zero (unix(7)); names in the folder may take 40.
_LONGEST_SOCKET_FOLDER = 107 - 41


@dataclass(frozen=True, slots=True)
class Layout:
    """The folders and files of one lab's data directory."""

    data: Path
    """Absolute. Mode 0700, owned by the user who runs the lab."""

    @property
    def cluster(self) -> Path:
        """PostgreSQL's own directory."""
        return self.data / "pg"

    @property
    def broker(self) -> Path:
        """Valkey's append-only files."""
        return self.data / "valkey"

    @property
    def logs(self) -> Path:
        """One file per process."""
        return self.data / "logs"

    @property
    def run(self) -> Path:
        """What is true only while the lab runs, and the record of the last start."""
        return self.data / "run"

    @property
    def stages(self) -> Path:
        """Which start-up steps were done to which database."""
        return self.run / "stages.json"

    @property
    def databases(self) -> Path:
        """Identities of the databases that were filled from here."""
        return self.data / "databases.json"

    @property
    def secret_key(self) -> Path:
        """Random, made once, mode 0600."""
        return self.data / "secret_key"

    @property
    def passwords(self) -> Path:
        """The seeded users."""
        return self.data / "passwords.json"


def data_directory_of(lab: Path) -> Path:
    """Name the data directory that belongs to a lab file by default."""
    name = lab.parent.name if lab.name == "lab.json" else lab.stem
    return CHECKOUT / "var" / (re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip(".-") or "lab")


def open_data_directory(data: Path, lab: Path | None = None) -> Layout:
    """Make the data directory, or check that it is one of ours and of this lab.

    Raises:
        EmbeddedError: It belongs to another user or another lab, or holds other things.
            Nothing in it was changed.
    """
    layout = Layout(data.resolve())
    try:
        layout.data.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_owner(layout.data)
        _claim(layout.data, lab)
        layout.data.chmod(0o700)
        for folder in (layout.run, layout.logs, layout.broker):
            folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise EmbeddedError(
            f"The data directory {layout.data} cannot be used: {error.strerror}. "
            "Choose another with --data."
        ) from error
    return layout


def _check_owner(data: Path) -> None:
    owner = data.stat().st_uid
    if owner != os.geteuid():
        raise EmbeddedError(
            f"The data directory {data} belongs to user id {owner}, and you are {os.geteuid()}. "
            "Run as that user, or choose another directory with --data."
        )


def _claim(data: Path, lab: Path | None) -> None:
    marker = data / _MARKER
    wanted = None if lab is None else _portable(lab)
    if not marker.exists():
        if any(data.iterdir()):
            raise EmbeddedError(
                f"{data} is not empty and not a data directory of labweb. "
                "Choose an empty or a new directory with --data."
            )
        write_private(marker, json.dumps({"format": _FORMAT, "lab": wanted}) + "\n")
        return
    known = read_json(marker)
    if not isinstance(known, dict) or known.get("format") != _FORMAT:
        raise EmbeddedError(f"{marker} is not of format {_FORMAT}: another version made it.")
    before = known.get("lab")
    if wanted is None or wanted == before:
        return
    if before is not None and (CHECKOUT / before).exists():
        raise EmbeddedError(
            f"The data directory {data} belongs to the lab {before}, not to {wanted}. "
            "Choose another directory with --data."
        )
    write_private(marker, json.dumps({"format": _FORMAT, "lab": wanted}) + "\n")


def _portable(lab: Path) -> str:
    lab = lab.resolve()
    return str(lab.relative_to(CHECKOUT) if lab.is_relative_to(CHECKOUT) else lab)


def lock(layout: Layout) -> int | None:
    """Claim the data directory for this process's life.

    Returns:
        The open descriptor that holds the lock, or None when another process holds it.
        The kernel frees it however the holder ends.
    """
    descriptor = os.open(layout.run / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor


def open_sockets(layout: Layout) -> Path:
    """Give a private folder for unix sockets whose path is short enough for the kernel.

    It lies in the data directory where that fits, else in a new folder under
    ``$XDG_RUNTIME_DIR`` or the temporary directory, recorded in the data directory so
    that the next start finds and removes what a killed one left.
    """
    close_sockets(layout)
    folder = layout.run / "s"
    if len(os.fsencode(folder)) > _LONGEST_SOCKET_FOLDER:
        folder = Path(tempfile.mkdtemp(prefix="labweb-", dir=_short_parent()))
        write_private(layout.run / "sockets", f"{folder}\n")
    folder.mkdir(mode=0o700, exist_ok=True)
    folder.chmod(0o700)
    return folder


def close_sockets(layout: Layout) -> None:
    """Remove the socket folder of the last run, wherever it was; another may do so as well."""
    record = layout.run / "sockets"
    with suppress(OSError):
        folder = Path(record.read_text(encoding="utf-8").strip())
        if folder.name.startswith("labweb-") and _is_private_folder(folder):
            shutil.rmtree(folder, ignore_errors=True)
        record.unlink()
    shutil.rmtree(layout.run / "s", ignore_errors=True)


def _is_private_folder(folder: Path) -> bool:
    try:
        facts = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.geteuid()


def _short_parent() -> Path:
    room = _LONGEST_SOCKET_FOLDER - len("/labweb-12345678")
    for name in (os.environ.get("XDG_RUNTIME_DIR"), tempfile.gettempdir(), "/tmp"):  # noqa: S108 - mkdtemp makes a private folder in it
        if name and len(os.fsencode(name)) <= room and os.access(name, os.W_OK | os.X_OK):
            return Path(name)
    raise EmbeddedError("No writable folder has a path short enough for unix sockets.")


def ensure_secret_key(layout: Layout) -> None:
    """Make the lab's own secret key at its first start."""
    if not layout.secret_key.exists() or not layout.secret_key.stat().st_size:
        write_private(layout.secret_key, secrets.token_urlsafe(64) + "\n")


def write_private(path: Path, text: str) -> None:
    """Replace a file in one step, readable by its owner alone.

    Raises:
        OSError: The disk refuses. The file is as it was, and no half of the new one is left.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(text)
        fresh.replace(path)
    except OSError:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)
        raise


def read_json(path: Path) -> object:
    """Read a JSON file, or None when it is missing or broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
