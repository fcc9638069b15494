"""A lab on servers of the person's own: used when they answer, refused by name when not."""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from time import monotonic

import psycopg
import pytest
import redis

from deploy import embedded
from deploy.embedded import external
from deploy.embedded.database_and_broker import Stack
from deploy.embedded.external import broker_url_of, given_urls, reach, urls_for_children
from deploy.embedded.layout import Layout
from tests.deploy.conftest import PLAIN_LAB, StartLab, surroundings

SECRET = "pw-7Q"
CLOSED = {
    "DATABASE_URL": f"postgresql://lab:{SECRET}@127.0.0.1:{{port}}/lab",
    "REDIS_URL": f"redis://:{SECRET}@127.0.0.1:{{port}}/0",
    "AMQP_URL": f"amqp://lab:{SECRET}@127.0.0.1:{{port}}/lab",
}
NAMES = sorted(CLOSED)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Run a PostgreSQL and a Redis that belong to the person and not to the lab."""
    with embedded.services(tmp_path_factory.mktemp("own") / "d", durable=False) as urls:
        yield {name: urls[name] for name in ("DATABASE_URL", "REDIS_URL")}


@pytest.fixture
def database(own: Mapping[str, str]) -> Iterator[str]:
    """Give the address of an empty database on the person's server."""
    with psycopg.connect(own["DATABASE_URL"], autocommit=True) as connection:
        connection.execute("CREATE DATABASE fresh")
        yield own["DATABASE_URL"].replace("/labweb?", "/fresh?")
        connection.execute("DROP DATABASE fresh WITH (FORCE)")


def _run(given: Mapping[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(PLAIN_LAB), *arguments],
        capture_output=True,
        text=True,
        timeout=40,
        check=False,
        cwd="/",
        env=surroundings() | dict(given),
    )


def test_given_servers_are_used_not_started_and_left_running(
    start_lab: StartLab, own: Mapping[str, str], database: str
) -> None:
    given = {**own, "DATABASE_URL": database}
    lab = start_lab(given=given)
    lab.wait_said("Ctrl-C stops everything")
    environment = lab.get()["environment"]
    assert isinstance(environment, dict)
    assert environment["DATABASE_URL"] == database
    assert environment["REDIS_URL"] == own["REDIS_URL"]
    path = own["REDIS_URL"].removeprefix("unix://").removesuffix("?db=0")
    assert environment["LABWEB_BROKER_URL"] == f"redis+socket://{path}?virtual_host=0"
    said = "".join(lab.said)
    assert "/fresh of DATABASE_URL, version 18" in said
    assert f"{path}/0 of REDIS_URL" in said
    status = _run({}, "status", "--data", str(lab.data)).stdout
    assert "postgresql" not in status
    assert "valkey" not in status
    assert not (lab.data / "pg").exists()
    assert _run({}, "stop", "--data", str(lab.data)).returncode == 0
    with redis.Redis.from_url(own["REDIS_URL"]) as client:
        assert client.ping()
    assert reach({"DATABASE_URL": database}, surroundings())


def test_a_second_start_on_a_given_database_repeats_no_stage(
    start_lab: StartLab, database: str
) -> None:
    given = {"DATABASE_URL": database}
    lab = start_lab(given=given)
    lab.wait_said("Ctrl-C stops everything")
    lab.end(signal.SIGTERM)
    _fill(database)
    again = start_lab(given=given)
    again.wait_said("Ctrl-C stops everything")
    assert "Lab and users … unchanged" in "".join(again.said)
    assert (again.data / "stage-runs").read_text(encoding="ascii") == "run\n"


def test_a_database_with_the_lab_of_another_data_directory_is_refused(
    start_lab: StartLab, database: str, lab_file: Path, tmp_path: Path, free_port: int
) -> None:
    _fill(database)
    given, other = {"DATABASE_URL": database}, tmp_path / "other"
    command = ("run", "--lab", str(lab_file), "--data", str(other), "--port", str(free_port))
    done = _run(given, *command)
    assert done.returncode == 1
    assert f"/fresh holds a lab, and not the one of {other}" in done.stderr
    assert not (other / "stage-runs").exists()
    lab = start_lab()
    lab.wait_said("Ctrl-C stops everything")
    lab.end(signal.SIGTERM)
    done = _run(given, *command[:4], str(lab.data), *command[5:])
    assert f"moved or restored, remove {lab.data}/databases.json" in done.stderr
    (lab.data / "databases.json").unlink()
    start_lab(given=given).wait_said("Ctrl-C stops everything")


def _fill(database: str) -> None:
    """Put what a migrated labweb is known by into a database."""
    with psycopg.connect(database, autocommit=True) as connection:
        connection.execute("CREATE TABLE django_migrations AS SELECT 'crutd' AS app")


def test_what_is_not_given_is_embedded(
    start_lab: StartLab, own: Mapping[str, str], tmp_path: Path
) -> None:
    lab = start_lab(given={"REDIS_URL": own["REDIS_URL"], "DATABASE_URL": " "})
    lab.wait_said("Ctrl-C stops everything")
    said = "".join(lab.said)
    assert "PostgreSQL … ready" in said
    assert "Valkey … ready" not in said
    assert (lab.data / "pg").is_dir()


def test_rabbitmq_is_the_broker_beside_the_embedded_valkey(tmp_path: Path) -> None:
    given = {"AMQP_URL": "amqp://lab@127.0.0.1/lab"}
    urls = Stack(Layout(tmp_path / "d"), tmp_path / "s", given=given).urls
    assert urls["LABWEB_BROKER_URL"] == given["AMQP_URL"]
    assert urls["REDIS_URL"] == f"unix://{tmp_path}/s/vk.sock?db=0"
    both = urls_for_children({**given, "REDIS_URL": "redis://127.0.0.1/3"})
    assert both["LABWEB_BROKER_URL"] == given["AMQP_URL"]
    assert both["REDIS_URL"] == "redis://127.0.0.1/3"


@pytest.mark.parametrize(
    ("redis_url", "broker_url"),
    [
        ("redis://10.0.0.5", "redis://10.0.0.5/0"),
        ("redis://:p%40w@10.0.0.5:6379/4", "redis://:p%40w@10.0.0.5:6379/4"),
        ("rediss://10.0.0.5/?db=4&ssl_cert_reqs=none", "rediss://10.0.0.5/4?ssl_cert_reqs=none"),
        ("unix://:pw@/run/r.sock", "redis+socket://:pw@/run/r.sock?virtual_host=0"),
        ("unix:///run/r.sock?db=4", "redis+socket:///run/r.sock?virtual_host=4"),
    ],
)
def test_the_broker_is_the_given_redis_as_celery_writes_it(redis_url: str, broker_url: str) -> None:
    assert broker_url_of(redis_url) == broker_url


@pytest.mark.parametrize("name", NAMES)
def test_a_server_that_is_away_is_refused_by_name_and_nothing_is_started(
    name: str, lab_file: Path, tmp_path: Path, free_port: int
) -> None:
    data = tmp_path / "data"
    given = {name: CLOSED[name].format(port=free_port)}
    began = monotonic()
    done = _run(given, "run", "--lab", str(lab_file), "--data", str(data), "--port", "8477")
    assert monotonic() - began < 10
    assert done.returncode == 1
    assert f"labweb: {name}: 127.0.0.1:{free_port}" in done.stderr
    assert "refused" in done.stderr
    assert f"unset {name}" in done.stderr
    assert SECRET not in done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    assert not (data / "pg").exists()
    assert list((data / "logs").iterdir()) == []


def test_servers_that_take_a_connection_and_say_nothing_are_given_up_within_seconds() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(8)
        port = silent.getsockname()[1]
        given = {name: url.format(port=port) for name, url in CLOSED.items()}
        began = monotonic()
        with pytest.raises(embedded.EmbeddedError) as refused:
            reach(given, surroundings())
    assert monotonic() - began < 12
    for name in NAMES:
        assert f"{name}: 127.0.0.1:{port}" in str(refused.value)
    assert SECRET not in str(refused.value)


@pytest.mark.parametrize(
    "given",
    [
        {"DATABASE_URL": f"postgresql://lab:{SECRET}%zz@127.0.0.1/lab"},
        {"DATABASE_URL": f"postgresql://lab:{SECRET}@127.0.0.1"},
        {"DATABASE_URL": f"postgresql://127.0.0.1/lab?password={SECRET}"},
        {"DATABASE_URL": f"mysql://lab:{SECRET}@127.0.0.1/lab"},
        {"REDIS_URL": f"redis://:{SECRET}@127.0.0.1:many/0"},
        {"REDIS_URL": f"http://:{SECRET}@127.0.0.1/0"},
        {"AMQP_URL": f"amqp://lab:{SECRET}@127.0.0.1:many/lab"},
        {"AMQP_URL": f"redis://lab:{SECRET}@127.0.0.1/0"},
    ],
)
def test_an_address_that_is_none_is_refused_without_its_password(given: dict[str, str]) -> None:
    with pytest.raises(embedded.EmbeddedError) as refused:
        reach(given, surroundings())
    assert next(iter(given)) in str(refused.value)
    assert "address" in str(refused.value)
    assert SECRET not in str(refused.value)


def test_a_database_with_the_tables_of_another_program_is_refused(database: str) -> None:
    with psycopg.connect(database, autocommit=True) as connection:
        connection.execute("CREATE TABLE invoices AS SELECT 1 AS number")
        with pytest.raises(embedded.EmbeddedError, match="tables that are not labweb's"):
            reach({"DATABASE_URL": database}, surroundings())
        connection.execute("CREATE TABLE django_migrations AS SELECT 'invoices' AS app")
        with pytest.raises(embedded.EmbeddedError, match="tables that are not labweb's"):
            reach({"DATABASE_URL": database}, surroundings())
        connection.execute("INSERT INTO django_migrations VALUES ('crutd')")
        assert reach({"DATABASE_URL": database}, surroundings())


def test_a_database_made_anew_under_its_old_name_is_another_one(
    own: Mapping[str, str], database: str
) -> None:
    first = reach({"DATABASE_URL": database}, surroundings())["DATABASE_URL"]
    with psycopg.connect(own["DATABASE_URL"], autocommit=True) as connection:
        connection.execute("DROP DATABASE fresh WITH (FORCE)")
        connection.execute("CREATE DATABASE fresh")
    second = reach({"DATABASE_URL": database}, surroundings())["DATABASE_URL"]
    assert first.place == second.place
    assert first.identity != second.identity


def test_check_says_which_servers_a_lab_would_use(database: str) -> None:
    given = {"DATABASE_URL": database}
    done = _run(given, "check")
    assert done.returncode == 0
    assert "/fresh of DATABASE_URL" in done.stdout
    assert "Redis … embedded: REDIS_URL is not set" in done.stdout
    done = _run(given | {"REDIS_URL": f"redis://:{SECRET}@127.0.0.1:1/0"}, "check")
    assert done.returncode == 1
    assert "REDIS_URL: 127.0.0.1:1/0" in done.stderr
    assert SECRET not in done.stderr


def test_the_help_of_run_names_every_variable() -> None:
    done = _run({}, "run", "--help")
    for name in external.NAMES:
        assert name in done.stdout


def test_an_empty_variable_counts_as_not_set() -> None:
    assert given_urls({"DATABASE_URL": "", "REDIS_URL": " ", "AMQP_URL": "amqp://h/v"}) == {
        "AMQP_URL": "amqp://h/v"
    }
