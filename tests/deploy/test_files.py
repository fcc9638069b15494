"""Data directories, logs and the memory of what was done once."""

import json
import os
import stat
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from django.core.management import load_command_class
from django.db.utils import OperationalError

from deploy.embedded import children, stages
from deploy.embedded.console import welcome
from deploy.embedded.database_and_broker import claim
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import (
    CHECKOUT,
    Layout,
    close_sockets,
    data_directory_of,
    ensure_secret_key,
    lock,
    open_data_directory,
    open_sockets,
)
from deploy.embedded.processes import Site, environment, table
from deploy.embedded.stages import Ledger, Stage
from manage import main


def _a_site(tmp_path: Path, **changes: object) -> Site:
    layout = open_data_directory(tmp_path / "data")
    facts = {"layout": layout, "sockets": tmp_path / "s", "lab": tmp_path / "lab.json"}
    return Site(**(facts | changes))  # type: ignore[arg-type]


def test_each_lab_has_its_own_data_directory_in_the_checkout() -> None:
    starter = CHECKOUT / "fixtures" / "labs" / "starter" / "lab.json"
    assert data_directory_of(starter) == CHECKOUT / "var" / "starter"
    assert data_directory_of(Path("/x/my bench!.json")) == CHECKOUT / "var" / "my-bench"
    assert data_directory_of(Path("/x/...json")).parent == CHECKOUT / "var"


def test_another_lab_does_not_enter_a_data_directory(tmp_path: Path) -> None:
    one, two = tmp_path / "one.json", tmp_path / "two.json"
    one.write_text("{}", encoding="ascii")
    open_data_directory(tmp_path / "data", one)
    open_data_directory(tmp_path / "data", one)
    with pytest.raises(EmbeddedError, match="belongs to the lab"):
        open_data_directory(tmp_path / "data", two)


def test_a_lab_file_that_moved_keeps_its_data_directory(tmp_path: Path) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text("{}", encoding="ascii")
    open_data_directory(tmp_path / "data", old)
    old.rename(new)
    open_data_directory(tmp_path / "data", new)
    assert json.loads((tmp_path / "data" / "labweb.json").read_text())["lab"] == str(new)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives a folder away")
def test_a_data_directory_of_another_user_is_refused(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    os.chown(tmp_path / "data", 65534, 65534)
    with pytest.raises(EmbeddedError, match="belongs to user id 65534"):
        open_data_directory(tmp_path / "data")


def test_a_killed_run_s_socket_folder_is_removed_and_nothing_else(tmp_path: Path) -> None:
    layout = open_data_directory(tmp_path / ("d" * 100))
    folder = open_sockets(layout)
    assert not folder.is_relative_to(tmp_path)
    assert open_sockets(layout) != folder
    assert not folder.exists()
    kept = tmp_path / "kept"
    kept.mkdir()
    close_sockets(layout)
    (layout.run / "sockets").write_text(f"{kept}\n", encoding="utf-8")
    close_sockets(layout)
    assert kept.is_dir()


def test_two_that_remove_a_socket_folder_at_once_do_not_disturb_each_other(
    tmp_path: Path,
) -> None:
    layout = open_data_directory(tmp_path / ("d" * 100))
    with ThreadPoolExecutor(2) as both:
        for _ in range(200):
            folder = open_sockets(layout)
            list(both.map(close_sockets, (layout, layout)))
            assert not folder.exists()
            assert not (layout.run / "sockets").exists()


def test_a_start_waits_for_a_run_that_has_ended_all_and_is_about_to_leave(
    tmp_path: Path,
) -> None:
    layout = open_data_directory(tmp_path / "data")
    held = lock(layout)
    assert held is not None
    leaving = threading.Timer(0.3, os.close, (held,))
    leaving.start()
    try:
        os.close(claim(layout))
    finally:
        leaving.join()


def test_a_command_without_a_database_says_how_to_get_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(_: object) -> None:
        raise OperationalError("connection refused")

    monkeypatch.setattr("manage.execute_from_command_line", refuse)
    assert main(["manage.py", "verify_ledger"]) == 1
    said = capsys.readouterr().err
    assert "connection refused" in said
    assert "python -m deploy.embedded manage verify_ledger" in said


def test_the_secret_key_is_random_private_and_stays(tmp_path: Path) -> None:
    one, two = (open_data_directory(tmp_path / name) for name in ("one", "two"))
    for layout in (one, two, one):
        ensure_secret_key(layout)
    assert one.secret_key.read_text() != two.secret_key.read_text()
    assert stat.S_IMODE(one.secret_key.stat().st_mode) == 0o600


def test_a_log_past_its_bound_keeps_one_older_part_while_its_writer_goes_on(
    tmp_path: Path,
) -> None:
    log = tmp_path / "web.log"
    with children.open_log(log) as stream:
        stream.write(b"x" * (children.LONGEST_LOG_BYTES + 1))
        stream.flush()
        children.rotate(log)
        stream.write(b"after\n")
    assert log.read_bytes() == b"after\n"
    assert (tmp_path / "web.log.1").stat().st_size == children.LONGEST_LOG_BYTES + 1
    children.rotate(log)
    assert log.read_bytes() == b"after\n"


def test_a_stage_is_repeated_when_its_input_its_output_or_the_cluster_changed(
    tmp_path: Path,
) -> None:
    made = tmp_path / "bench.json"
    made.touch()
    stage = Stage("seed", ("seed",), "one", (made,))
    path = tmp_path / "stages.json"
    Ledger(path, "cluster").enter(stage)
    assert Ledger(path, "cluster").is_done(stage)
    assert not Ledger(path, "other").is_done(stage)
    assert not Ledger(path, "cluster").is_done(Stage("seed", ("seed",), "two", (made,)))
    made.unlink()
    assert not Ledger(path, "cluster").is_done(stage)


def test_a_stage_is_repeated_when_a_given_server_has_another_address(tmp_path: Path) -> None:
    stage = Stage("seed", ("seed",), "one")
    path = tmp_path / "stages.json"
    secret = "pw-7Q"
    one = {"LABWEB_BROKER_URL": f"amqp://lab:{secret}@127.0.0.1/one"}
    two = {"LABWEB_BROKER_URL": f"amqp://lab:{secret}@127.0.0.1/two"}
    Ledger(path, "cluster", one).enter(stage)
    assert Ledger(path, "cluster", one).is_done(stage)
    assert not Ledger(path, "cluster", two).is_done(stage)
    assert not Ledger(path, "cluster").is_done(stage)
    assert secret not in path.read_text(encoding="utf-8")


def test_a_lab_starts_without_checks_of_our_own_code_which_are_a_gate(tmp_path: Path) -> None:
    (tmp_path / "lab.json").touch()
    site = _a_site(tmp_path)
    tables, role, lab = stages.table(site)
    assert "--skip-checks" in role.argv
    assert "--skip-checks" in tables.argv
    for app, name in (("labweb.runs", lab.argv[2]), ("labweb.fleet", "dispatcher")):
        assert not load_command_class(app, name).requires_system_checks
    assert environment(site, {}, "t")["CELERY_SKIP_CHECKS"]
    gate = (CHECKOUT / "deploy/setup/check").read_text("utf-8")
    assert "makemigrations --check" in gate
    assert load_command_class("django.core", "makemigrations").requires_system_checks == "__all__"


def test_the_table_binds_web_to_loopback_and_names_every_process_once(tmp_path: Path) -> None:
    processes = table(_a_site(tmp_path, port=8123, speed=20.0))
    names = [process.name for process in processes]
    assert len(names) == len(set(names))
    assert {"web", "instruments", "dispatcher", "edge-host"} <= set(names)
    web = next(process for process in processes if process.name == "web").argv
    assert web[web.index("--host") + 1] == "127.0.0.1"
    assert web[web.index("--port") + 1] == "8123"
    bench = next(process for process in processes if process.name == "instruments").argv
    assert bench[bench.index("--speed") + 1] == "20"
    assert bench[bench.index("--control") + 1] == f"unix:{tmp_path}/s/instruments.sock"


def test_the_twin_can_be_left_out(tmp_path: Path) -> None:
    names = [process.name for process in table(_a_site(tmp_path, with_twin=False))]
    assert "twin" not in names


def test_a_process_of_the_lab_gets_the_addresses_of_the_supervisor_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("AMQP_URL", "LABWEB_BROKER_URL", "PGHOST", "PYTHONDONTWRITEBYTECODE"):
        monkeypatch.setenv(name, "elsewhere")
    monkeypatch.setenv("DATABASE_URL", "postgresql://elsewhere")
    found = environment(_a_site(tmp_path), {"DATABASE_URL": "here"}, "token")
    assert found["DATABASE_URL"] == "here"
    strangers = {"AMQP_URL", "LABWEB_BROKER_URL", "PGHOST", "PYTHONDONTWRITEBYTECODE"}
    assert not strangers & set(found)


@pytest.mark.parametrize("content", [None, "{", "{}", '[{"username": "ada"}]'])
def test_a_broken_list_of_users_is_said_and_does_not_stop_the_lab(
    tmp_path: Path, content: str | None
) -> None:
    site = _a_site(tmp_path)
    if content is not None:
        Layout(site.layout.data).passwords.write_text(content, encoding="ascii")
    assert str(site.layout.passwords) in "\n".join(welcome(site))
