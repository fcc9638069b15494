"""A whole run: started, watched, killed and stopped as a person or a fault would."""

import os
import signal
import socket
import stat
import subprocess
import sys
from http.client import RemoteDisconnected
from pathlib import Path

import django
import pytest

from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import CHECKOUT
from deploy.embedded.manage import environment_of
from deploy.embedded.record import MARK
from tests.deploy.conftest import (
    PLAIN_LAB,
    RunningLab,
    StartLab,
    is_alive,
    surroundings,
    wait_until,
)


def _opened(lab: RunningLab) -> RunningLab:
    """Wait until the lab is open and its edge host has a worker."""
    lab.wait_said("Ctrl-C stops everything")
    assert wait_until(lab.worker_pids, 5.0)
    assert wait_until((lab.data / "deaf").exists, 5.0)
    return lab


def _command(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(PLAIN_LAB), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=30, check=False, env=surroundings()
    )


def test_a_start_says_each_step_and_the_accounts_that_keep_their_first_password(
    start_lab: StartLab,
) -> None:
    lab = _opened(start_lab())
    said = "".join(lab.said)
    for step in ("PostgreSQL … ready", "Valkey … ready", "Lab and users … done", "Web … ready"):
        assert step in said
    assert f"http://127.0.0.1:{lab.port}/" in said
    assert "ada  first-secret  (chemist)" in said
    assert "old-secret" not in said
    assert "\x1b" not in said
    assert "\r" not in said


def test_a_process_finds_its_addresses_in_its_environment(start_lab: StartLab) -> None:
    lab = _opened(start_lab())
    environment = lab.get()["environment"]
    assert isinstance(environment, dict)
    sockets = environment["LABWEB_SOCKETS"]
    assert environment["DATABASE_URL"] == f"postgresql://labweb_app@/labweb?host={sockets}"
    assert environment["REDIS_URL"] == f"unix://{sockets}/vk.sock?db=0"
    assert environment["LABWEB_BROKER_URL"] == f"redis+socket://{sockets}/vk.sock?virtual_host=1"
    assert environment["LABWEB_PORT"] == str(lab.port)
    assert environment["LABWEB_DATA"] == str(lab.data)
    assert "PYTHONDONTWRITEBYTECODE" not in environment
    assert "AMQP_URL" not in environment
    secret = Path(environment["LABWEB_SECRET_KEY_FILE"])
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    assert len(secret.read_text(encoding="ascii")) > 50


def test_a_command_of_the_lab_finds_what_its_processes_find(start_lab: StartLab) -> None:
    lab = _opened(start_lab())
    theirs = lab.get()["environment"]
    assert isinstance(theirs, dict)
    given = environment_of(lab.data)
    assert {name for name in theirs if name not in given} <= {MARK, "PYTHONUNBUFFERED"}
    assert given["DATABASE_URL"] == theirs["DATABASE_URL"]
    command = [sys.executable, "-m", "deploy.embedded", "manage", "--data", str(lab.data)]
    done = subprocess.run(
        [*command, "version"], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == django.get_version()


def test_a_command_for_a_lab_that_does_not_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EmbeddedError, match="No lab runs on"):
        environment_of(tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_leaves_no_process_within_five_seconds(
    start_lab: StartLab, number: signal.Signals
) -> None:
    lab = _opened(start_lab())
    pids = lab.pids()
    assert len(pids) == 8
    assert lab.end(number) < 5.0
    assert lab.popen.returncode == 0
    assert [pid for pid in pids if is_alive(pid)] == []
    assert "Ending deaf by force" in "".join(lab.said)
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", lab.port)):
        pass


@pytest.mark.parametrize("victim", ["started process", "its group", "supervisor"])
def test_kill_9_leaves_no_process_after_two_seconds(start_lab: StartLab, victim: str) -> None:
    lab = _opened(start_lab())
    pids = lab.pids()
    if victim == "its group":
        os.killpg(lab.popen.pid, signal.SIGKILL)
    else:
        killed = lab.popen.pid if victim == "started process" else lab.supervisor_pid()
        os.kill(killed, signal.SIGKILL)
    wait_until(lambda: lab.popen.poll() is not None and not any(map(is_alive, pids)), 2.0)
    assert [pid for pid in pids if is_alive(pid)] == []


def test_processes_without_guard_and_supervisor_are_ended_by_the_next_start(
    start_lab: StartLab,
) -> None:
    lab = _opened(start_lab())
    deaf = int((lab.data / "deaf").read_text(encoding="ascii"))
    guard, supervisor = lab.popen.pid, lab.supervisor_pid()
    os.kill(guard, signal.SIGSTOP)
    os.kill(supervisor, signal.SIGKILL)
    os.kill(guard, signal.SIGKILL)
    lab.popen.wait()
    assert is_alive(deaf)
    (lab.data / "deaf").unlink()
    again = _opened(start_lab())
    assert not is_alive(deaf)
    assert is_alive(int((again.data / "deaf").read_text(encoding="ascii")))


def test_a_start_after_kill_9_goes_on_with_the_data_and_repeats_no_stage(
    start_lab: StartLab,
) -> None:
    lab = _opened(start_lab())
    secret = (lab.data / "secret_key").read_text(encoding="ascii")
    lab.end(signal.SIGKILL)
    again = _opened(start_lab())
    assert "Lab and users … unchanged" in "".join(again.said)
    assert (again.data / "stage-runs").read_text(encoding="ascii") == "run\n"
    assert (again.data / "secret_key").read_text(encoding="ascii") == secret


def test_a_process_that_dies_is_started_again_and_said_so(start_lab: StartLab) -> None:
    lab = _opened(start_lab())
    first = lab.get()["pid"]
    with pytest.raises((RemoteDisconnected, ConnectionResetError)):
        lab.get("/die")
    assert "starting it again in 0.5 s" in lab.wait_said("web ended with exit code 7", 5.0)

    def pid_of_web() -> object:
        try:
            return lab.get()["pid"]
        except OSError:
            return None

    assert wait_until(pid_of_web, 5.0) not in {None, first}


def test_what_a_dead_edge_host_leaves_is_ended_before_the_next_one_starts(
    start_lab: StartLab,
) -> None:
    lab = _opened(start_lab())
    host = int((lab.data / "workers").read_text(encoding="ascii").split()[0])
    worker = lab.worker_pids()[0]
    os.kill(host, signal.SIGKILL)
    assert wait_until(lambda: len(lab.worker_pids()) == 2, 5.0)
    assert not is_alive(worker)
    assert is_alive(lab.worker_pids()[1])


def test_a_dead_database_is_started_again(start_lab: StartLab) -> None:
    lab = _opened(start_lab())
    lock = lab.data / "pg" / "postmaster.pid"
    first = int(lock.read_text(encoding="utf-8").splitlines()[0])
    os.kill(first, signal.SIGKILL)
    lab.wait_said("postgresql ended with signal SIGKILL", 5.0)

    def is_ready() -> bool:
        lines = lock.read_text(encoding="utf-8").splitlines() if lock.exists() else []
        return len(lines) > 7 and lines[7].strip() == "ready" and int(lines[0]) != first

    assert wait_until(is_ready, 8.0)


def test_a_second_start_on_the_same_data_is_refused_with_process_and_address(
    start_lab: StartLab, lab_file: Path
) -> None:
    lab = _opened(start_lab())
    second = _command("run", "--lab", str(lab_file), "--data", str(lab.data), "--port", "8101")
    assert second.returncode == 1
    assert f"process {lab.popen.pid}" in second.stderr
    assert f"http://127.0.0.1:{lab.port}/" in second.stderr
    assert lab.popen.poll() is None
    assert lab.get()["pid"]


def test_a_taken_port_is_refused_before_anything_starts(lab_file: Path, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        data = tmp_path / "data"
        refused = _command("run", "--lab", str(lab_file), "--data", str(data), "--port", port)
    assert refused.returncode == 1
    assert f"Port {port}" in refused.stderr
    assert "make run PORT=" in refused.stderr
    assert not (data / "pg").exists()
    assert list((data / "logs").iterdir()) == []


def test_status_and_stop_speak_of_the_lab_that_runs(start_lab: StartLab) -> None:
    lab = _opened(start_lab())
    status = _command("status", "--data", str(lab.data))
    assert status.returncode == 0
    assert f"http://127.0.0.1:{lab.port}/" in status.stdout
    assert status.stdout.count("running") == 5
    assert _command("stop", "--data", str(lab.data)).returncode == 0
    assert lab.popen.wait(1) == 0
    assert _command("status", "--data", str(lab.data)).returncode == 3


def test_two_labs_run_side_by_side(start_lab: StartLab, tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    one = start_lab()
    two = start_lab(tmp_path / "other", port)
    assert not _opened(one).pids() & _opened(two).pids()
    assert one.get()["pid"] != two.get()["pid"]


def test_a_failed_stage_ends_the_start_with_its_last_lines(
    start_lab: StartLab, tmp_path: Path
) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "labweb.json").write_text('{"format": 1, "lab": null}', encoding="ascii")
    (tmp_path / "data" / "stage-runs").mkdir()
    lab = start_lab()
    assert lab.popen.wait(20) == 1
    lab.wait_said("IsADirectoryError")
    assert wait_until(lambda: "'Lab and users' failed with code 1" in "".join(lab.said), 2.0)


@pytest.mark.parametrize(
    ("option", "value"), [("--port", "0"), ("--port", "x"), ("--speed", "0"), ("--speed", "nan")]
)
def test_a_senseless_number_is_refused(option: str, value: str) -> None:
    command = [sys.executable, "-m", "deploy.embedded", "run", option, value]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert repr(value) in done.stderr
