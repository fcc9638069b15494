"""What must happen once before the processes start, and how to tell that it already did."""

from __future__ import annotations

import hashlib
import json
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from deploy.embedded.layout import CHECKOUT, read_json, write_private
from deploy.embedded.processes import Site

_GRANTS = CHECKOUT / "labweb" / "accounts" / "management" / "commands" / "grant_database.py"
_SEEDING_CODE = ("labweb", "drivers", "fixtures", "workers")


@dataclass(frozen=True, slots=True)
class Stage:
    """One program that runs to its end before the lab opens."""

    name: str
    """As the person at the terminal reads it."""

    argv: tuple[str, ...]
    fingerprint: str
    """Changes whenever the stage has something to do."""

    makes: tuple[Path, ...] = ()
    """Files it leaves; when one is missing the stage runs again."""

    as_owner: bool = False
    """It changes tables, so that it signs in as their owner."""


def table(site: Site) -> list[Stage]:
    """List the stages of a lab in their order."""
    data = site.layout.data
    manage = (sys.executable, "manage.py")
    seed: tuple[str, ...] = (*manage, "seed", "--lab", str(site.lab), "--data", str(data))
    if site.bind is not None:
        seed = (*seed, "--bind", str(site.bind))
    schema = _schema_fingerprint()
    return [
        Stage(
            "Database tables",
            (*manage, "migrate", "--noinput", "--skip-checks"),
            schema,
            as_owner=True,
        ),
        *_role_stage(site, schema, manage),
        Stage(
            "Lab and users",
            seed,
            _digest([schema, _seed_fingerprint(site)]),
            (
                data / "bench.json",
                data / "host" / "host.json",
                data / "twin.json",
                site.layout.passwords,
            ),
        ),
    ]


def _role_stage(site: Site, schema: str, manage: tuple[str, ...]) -> list[Stage]:
    """Restrict the role of the lab's processes, after each change of the tables."""
    if site.database_role is None:
        return []
    grants = _digest([schema, site.database_role, _GRANTS.read_text(encoding="utf-8")])
    argv = (*manage, "grant_database", site.database_role, "--skip-checks")
    return [Stage("Database role", argv, grants, as_owner=True)]


class Ledger:
    """Which stages have been done to which database."""

    def __init__(self, path: Path, cluster: str, urls: Mapping[str, str] | None = None) -> None:
        """Read what was done to this database; another one's history counts for nothing.

        Args:
            path: The file.
            cluster: Identity of the database.
            urls: Addresses of the person's own servers; stages write them into files, so
                with other addresses every stage is done again.
        """
        self._path = path
        if urls:
            # Only a digest is written: an address may hold a password.
            cluster = _digest([cluster, *(f"{name}={url}" for name, url in sorted(urls.items()))])
        self._cluster = cluster
        content = read_json(path)
        self._done: dict[str, str] = {}
        if isinstance(content, dict) and content.get("cluster") == cluster:
            self._done = dict(content["done"])

    def is_done(self, stage: Stage) -> bool:
        """Tell whether the stage has nothing to do."""
        done = self._done.get(stage.name) == stage.fingerprint
        return done and all(path.exists() for path in stage.makes)

    def enter(self, stage: Stage) -> None:
        """Write down that the stage was done."""
        self._done[stage.name] = stage.fingerprint
        content = {"cluster": self._cluster, "done": self._done}
        write_private(self._path, json.dumps(content, indent=1) + "\n")


def _schema_fingerprint() -> str:
    """Digest our migrations and the versions of the packages that bring their own."""
    ours = sorted((CHECKOUT / "labweb").glob("**/migrations/*.py"))
    packages = sorted(path.name for path in _site_packages().glob("*.dist-info"))
    contents = (path.read_text(encoding="utf-8") for path in ours)
    return _digest([*map(str, ours), *contents, *packages])


def _seed_fingerprint(site: Site) -> str:
    """Digest the lab, its binding, where it runs, and the time stamps of the code that seeds."""
    files = [site.lab] if site.bind is None else [site.lab, site.bind]
    parts = [path.read_text(encoding="utf-8", errors="replace") for path in files]
    parts += [str(site.layout.data), str(site.sockets), str(site.port), str(site.bind)]
    for folder in _SEEDING_CODE:
        for path in sorted((CHECKOUT / folder).rglob("*")):
            if path.suffix in {".py", ".json"}:
                facts = path.stat()
                parts.append(f"{path} {facts.st_size} {facts.st_mtime_ns}")
    return _digest(parts)


def _site_packages() -> Path:
    return Path(sysconfig.get_paths()["purelib"])


def _digest(parts: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode()
        digest.update(len(data).to_bytes(8, "big") + data)
    return digest.hexdigest()
