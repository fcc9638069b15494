"""What the tests of an edge host share: a Valkey, a counting pump, a host."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.workers.bench import BOOT_ID, Host, PumpProcess, until
from workers.base.valkey_store import ValkeyStore
from workers.host.valkey_process import find_valkey


@pytest.fixture(autouse=True)
def _one_boot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABWEB_BOOT_ID", BOOT_ID)


@pytest.fixture(scope="session")
def valkey_socket() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="vk") as folder:
        path = Path(folder) / "s"
        popen = subprocess.Popen(
            [str(find_valkey()), "--port", "0", "--unixsocket", str(path), "--save", ""],
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        store = ValkeyStore(f"unix://{path}?db=0")
        until(store.ping)
        store.close()
        yield path
        popen.terminate()
        popen.wait()


@pytest.fixture
def store(valkey_socket: Path) -> Iterator[ValkeyStore]:
    made = ValkeyStore(f"unix://{valkey_socket}?db=0")
    made._redis.flushall()
    yield made
    made.close()


@pytest.fixture
def pump(tmp_path: Path) -> Iterator[PumpProcess]:
    process = PumpProcess(tmp_path)
    yield process
    process.end()


@pytest.fixture
def host(tmp_path: Path, pump: PumpProcess) -> Iterator[Host]:
    made = Host(tmp_path / "host", pump.url)
    yield made
    made.journal.close()
