"""PostgreSQL and Valkey for the tests: addressed before Django loads, started at first use.

A pytest plugin (`-p tests.services` in pyproject.toml), because settings read their addresses
when pytest-django imports them, which is before any conftest. Addresses that are set already
are respected: that server is not started here, and the run works in a database of its own on it.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from secrets import token_hex

import pytest

from deploy import embedded
from deploy.embedded import external, postgres
from deploy.embedded.database_and_broker import Stack
from deploy.embedded.layout import Layout
from tests import tables
from tests.rooms import with_database

_LONGEST_FOLDER = 40
_FOLDER = "LABWEB_TEST_FOLDER"
_GIVEN = "LABWEB_TEST_GIVEN"
_TEMPLATE = "LABWEB_TEST_TEMPLATE"


class Services:
    """The two servers of one test session; worker processes of xdist share those of the first."""

    def __init__(self) -> None:
        """Choose a short folder and put the addresses into the environment."""
        self._stack = ExitStack()
        self._is_owner = _FOLDER not in os.environ
        self._is_running = False
        if self._is_owner:
            os.environ[_FOLDER] = tempfile.mkdtemp(prefix="lwt", dir=_short_parent())
            # Also when pytest gives up before it is configured.
            atexit.register(self.stop)
        self.folder = Path(os.environ[_FOLDER])
        if self._is_owner:
            os.environ[_GIVEN] = json.dumps(external.given_urls())
        self.given: dict[str, str] = json.loads(os.environ[_GIVEN])
        self._is_embedded = not {external.DATABASE, external.REDIS} <= self.given.keys()
        self._set_files()
        if self._is_owner:
            self._set_addresses()

    def _set_addresses(self) -> None:
        if self._is_embedded:
            layout = Layout(self.folder / "d")
            stack = Stack(layout, layout.run / "s", durable=False)
            os.environ.update(stack.urls | external.urls_for_children(self.given))
            if external.DATABASE not in self.given:
                os.environ[_TEMPLATE] = postgres.NAME
        if external.DATABASE in self.given:
            # Django makes a test database beside it and removes it: test_labweb_….
            url = with_database(self.given[external.DATABASE], f"labweb_{token_hex(6)}")
            os.environ[external.DATABASE] = url

    def _set_files(self) -> None:
        worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
        data = self.folder / worker
        # WhiteNoise warns of a static folder that is not there.
        (data / "static").mkdir(mode=0o700, parents=True, exist_ok=True)
        os.environ["LABWEB_DATA"] = str(data)
        os.environ["LABWEB_COMMAND_KEY_FILE"] = str(data / "command.key")
        os.environ["LABWEB_RECORD_KEY_FILE"] = str(data / "record.key")

    def start(self) -> None:
        """Start both, unless they run or somebody else's were given in place of both."""
        if self._is_running or not self._is_owner or not self._is_embedded:
            return
        self._is_running = True
        if external.DATABASE not in self.given:
            tables.lay_out(self.folder / "d")
        self._stack.enter_context(embedded.services(self.folder / "d", durable=False))

    def stop(self) -> None:
        """End both and remove what they wrote."""
        self._stack.close()
        if self._is_owner:
            shutil.rmtree(self.folder, ignore_errors=True)


def _short_parent() -> str:
    """Give a folder whose path leaves room for the name of a unix socket."""
    found = tempfile.gettempdir()
    return found if len(found) <= _LONGEST_FOLDER else "/tmp"


_services = Services()


def pytest_configure(config: pytest.Config) -> None:
    """Start at once when workers will ask for the servers: they cannot start them."""
    if getattr(config.option, "numprocesses", None):
        _services.start()


def pytest_unconfigure() -> None:
    """Leave no process and no folder behind."""
    _services.stop()


def given_urls() -> dict[str, str]:
    """Give the addresses that were set before this run set its own."""
    return dict(_services.given)


@pytest.fixture(scope="session")
def services() -> Services:
    """Give running servers, at the addresses in the environment."""
    _services.start()
    return _services
