"""A database for one benchmark: the embedded PostgreSQL, durable, empty, and gone after."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import django
from django.core.management import call_command
from django.db import connections

from deploy import embedded
from tests import tables


@contextmanager
def an_empty_database() -> Iterator[None]:
    """Start servers of its own, whatever the environment names, with all tables.

    Nothing of a lab that runs on this machine is touched.
    """
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        tables.lay_out(folder / "lab")
        with embedded.services(folder / "lab") as urls:
            for name in ("AMQP_URL", "DATABASE_URL", "REDIS_URL"):
                os.environ.pop(name, None)
            os.environ |= urls | {
                "DJANGO_SETTINGS_MODULE": "labweb.settings.local",
                "LABWEB_DATA": str(folder),
                "LABWEB_SECRET_KEY": secrets.token_hex(),
            }
            django.setup()
            call_command("migrate", verbosity=0)
            yield
            connections.close_all()
            close_pool = getattr(connections["default"], "close_pool", None)
            if close_pool is not None:
                close_pool()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
