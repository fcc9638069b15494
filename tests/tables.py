"""A database that has all tables, made once and laid out for whoever begins with one.

The programs of a lab make it as at its first start, and the lab's own ledger says so: what is
different is that a lab which finds it does not do it again.
"""

from __future__ import annotations

import fcntl
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deploy import embedded
from deploy.embedded import processes, stages
from deploy.embedded.database_and_broker import clean_environment
from deploy.embedded.layout import CHECKOUT, DEFAULT_LAB, Layout, open_data_directory
from deploy.embedded.postgres import Postgres

KEPT = CHECKOUT / ".cache" / "tables"


def lay_out(data: Path, lab: Path = DEFAULT_LAB) -> None:
    """Give a new data directory of this lab a database with all tables.

    Another start finds the same one for as long as migrations and packages are the same.
    """
    layout = open_data_directory(data, lab)
    stage = stages.table(processes.Site(layout, layout.run, lab=lab))[0]
    with _kept(stage) as cluster:
        shutil.copytree(cluster, layout.cluster)
    postgres = Postgres(layout.cluster, layout.run, layout.logs / "postgresql.log")
    stages.Ledger(layout.stages, postgres.system_identifier()).enter(stage)


@contextmanager
def _kept(stage: stages.Stage) -> Iterator[Path]:
    """Lend the cluster that fits the migrations, which is made where there is none."""
    KEPT.mkdir(parents=True, exist_ok=True)
    with (KEPT / "lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        cluster = KEPT / stage.fingerprint
        if not cluster.exists():
            for old in KEPT.iterdir():
                if old.is_dir():
                    shutil.rmtree(old)
            _make(cluster, stage)
        yield cluster


def _make(cluster: Path, stage: stages.Stage) -> None:
    folder = Path(tempfile.mkdtemp(prefix="lt-", dir="/tmp"))
    try:
        with embedded.services(folder / "d", durable=False) as urls:
            surroundings = clean_environment() | urls
            surroundings["DJANGO_SETTINGS_MODULE"] = "labweb.settings.test"
            quiet = subprocess.DEVNULL
            subprocess.run(stage.argv, cwd=CHECKOUT, env=surroundings, stdout=quiet, check=True)
        fresh = cluster.with_suffix(".new")
        shutil.move(Layout(folder / "d").cluster, fresh)
        fresh.rename(cluster)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
