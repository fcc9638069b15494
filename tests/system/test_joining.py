"""Hosts that join, renew, are revoked, and what stands in between: real processes over TLS."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import signal
import ssl
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from labweb.domain.enrollment.host_join import parse_token
from tests.system.joining import (
    Announcer,
    Between,
    a_machine,
    a_token,
    admit,
    asked,
    join,
    page,
    submit,
    until,
)
from tests.system.stack import Stack, free_port, running
from tests.system.turning import SEEN, Turning, a_turning_pump, begun, take_up
from workers.enrollment.join import fetch_authority

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

LONGEST_STRANGER_BYTES = 64 * 1024
CLOSE_TOO_BIG = 1009  # RFC 6455, section 7.4.1

CERTIFICATE_S = 60
"""So short that a test sees it renewed."""

CANDIDATE = re.compile(r"candidate/([0-9a-f-]{36})/review/")
DEVICE = re.compile(r"device/([0-9a-f-]{36})/review/")


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix="lj-", dir="/tmp"))
    yield made
    shutil.rmtree(made, ignore_errors=True)


@pytest.fixture(scope="module")
def stack(folder: Path) -> Iterator[Stack]:
    life = {"LABWEB_HOST_CERTIFICATE_S": str(CERTIFICATE_S)}
    with running(folder / "lab", has_door=True, variables=life) as lab:
        yield lab


def test_a_machine_joins_by_token_and_typed_code_and_renews_its_key_while_it_works(
    stack: Stack, folder: Path
) -> None:
    with a_machine(stack, folder / "one") as machine:
        token = a_token(stack)
        machine.begin("--server", stack.door, "--token", token, "--name", "Bench 2")
        code = machine.code()
        (request,) = asked(stack, "Bench 2")
        wrong = {"code": "0000-0000-0000", "reason": "looks right"}
        answer = stack.client("admin").raw("POST", f"join-requests/{request['id']}/admit", wrong)
        assert (answer.status_code, answer.json()["code"]) == (403, "join.code_differs")
        host = admit(stack, request["id"], code.lower().replace("-", " "))
        assert host["key"] == "bench_2"
        assert machine.ended() == 0, machine.said()
        assert (machine.folder / "host.key").stat().st_mode & 0o777 == 0o600
        secret = parse_token(token).secret
        kept = [path for path in machine.folder.iterdir() if path.is_file()]
        assert [path for path in kept if secret.encode() in path.read_bytes()] == []
        machine.run()
        machine.wait_for_state("online")
        first = (machine.folder / "host.key").read_bytes()
        processes = re.findall(r"(\w+) runs as process (\d+)", machine.said())
        until(lambda: "the next certificate is in use" in machine.said(), what=machine.said)
        assert (machine.folder / "host.key").read_bytes() != first
        sessions = machine.said().count("with the server, normal")
        until(lambda: machine.said().count("with the server, normal") > sessions, what=machine.said)
        machine.wait_for_state("online")
        assert re.findall(r"(\w+) runs as process (\d+)", machine.said()) == processes


def test_a_certificate_is_renewed_while_jobs_run_and_none_of_them_notices(
    stack: Stack, folder: Path
) -> None:
    heard = free_port()
    with a_machine(stack, folder / "eight") as machine, a_turning_pump(folder / "b8") as pump:
        join(stack, machine, "Bench 8")
        machine.configure(discovery={"beacon": {"port": heard, "interface": "127.0.0.1"}})
        machine.run()
        machine.wait_for_state("online")
        turning = Turning(stack, take_up(stack, machine, pump, heard, "Pump 8"))
        before_turns, key = pump.turns(), (machine.folder / "host.key").read_bytes()
        renewed = machine.said().count("the next certificate is in use")
        processes = re.findall(r"(\w+) runs as process (\d+)", machine.said())

        def is_renewed() -> bool:
            turning.once()
            return machine.said().count("the next certificate is in use") > renewed

        until(is_renewed, 150, machine.said)
        turning.once()
        assert (machine.folder / "host.key").read_bytes() != key
        assert machine.state() == "online"
        jobs = turning.jobs
        assert {job["state"] for job in jobs} == {"complete"}
        assert pump.turns() - before_turns == len(jobs), "each turn was one motion"
        actions = begun(machine)
        assert len(actions) == len({one for one, _ in actions}) == len(jobs) + 1
        assert {end for _, end in actions} == {"complete"}
        assert re.findall(r"(\w+) runs as process (\d+)", machine.said()) == processes


def test_the_door_answers_every_opening(stack: Stack) -> None:
    # Where two threads shared a TLS connection, one opening in twenty was never answered. More
    # than these in a row from one address are more than the door lets in.
    token = parse_token(a_token(stack))
    said: list[str] = []

    async def open_often() -> None:
        for _ in range(20):
            await fetch_authority(stack.door, token, said.append)

    asyncio.run(open_often())
    assert len(said) == 20


def test_a_crash_in_the_middle_of_joining_loses_nothing(stack: Stack, folder: Path) -> None:
    with a_machine(stack, folder / "two") as machine:
        machine.begin("--server", stack.door, "--token", a_token(stack), "--name", "Bench 3")
        code = machine.code()
        machine.stop(signal.SIGKILL)
        host = admit(stack, asked(stack, "Bench 3")[0]["id"], code)
        machine.begin()
        assert machine.ended() == 0, machine.said()
        assert machine.config["name"] == host["name"] == "Bench 3"
        machine.begin()
        assert machine.ended() == 1
        assert "this host has joined" in machine.said()


def test_somebody_in_between_learns_nothing_and_the_token_stays_good(
    stack: Stack, folder: Path
) -> None:
    between = Between(folder, stack.door)
    token = a_token(stack)
    secret = parse_token(token).secret.encode()
    with a_machine(stack, folder / "three") as machine:
        arguments = ("--token", token, "--name", "Bench 4", "--mode", "sim")
        for attack in (between.pretending, between.relaying):
            with attack() as address:
                machine.begin("--server", address, *arguments)
                assert machine.ended() == 1, machine.said()
            assert "join.wrong_authority" in machine.said()
        assert secret not in between.heard
        assert b"CERTIFICATE REQUEST" not in between.heard
        assert asked(stack, "Bench 4") == []
        machine.begin("--server", stack.door, *arguments)
        code = machine.code()
        admit(stack, asked(stack, "Bench 4")[0]["id"], code)
        assert machine.ended() == 0, machine.said()


def test_a_revoked_host_is_out_within_five_seconds(stack: Stack, folder: Path) -> None:
    with a_machine(stack, folder / "four") as machine:
        host = join(stack, machine, "Bench 5")
        machine.run()
        machine.wait_for_state("online")
        began_s = time.monotonic()
        stack.client("admin").call("POST", f"hosts/{host['id']}/revoke", {"reason": "stolen"})
        until(lambda: "host.revoked" in machine.said(), what=machine.said)
        assert time.monotonic() - began_s < 5.0
        assert machine.state() == "revoked"


def test_a_known_host_with_another_key_is_suspended_until_a_person_has_said(
    stack: Stack, folder: Path
) -> None:
    admin = stack.client("admin")
    with a_machine(stack, folder / "five") as old, a_machine(stack, folder / "six") as new:
        host = join(stack, old, "Bench 6")
        old.run()
        old.wait_for_state("online")
        new.machine_id = old.machine_id
        token = a_token(stack)
        new.begin("--server", stack.door, "--token", token, "--name", "Other", "--mode", "sim")
        code = new.code()
        (request,) = asked(stack, "Other")
        assert request["claims_to_be"]["id"] == host["id"]
        body = {"code": code, "reason": "new disk"}
        early = admin.raw("POST", f"join-requests/{request['id']}/admit", body)
        assert early.json()["code"] == "host.key_lives"
        shown = page(stack, f"joinrequest/{request['id']}/review/")
        assert "Bench 6 is suspended" in shown
        admin.call("POST", f"hosts/{host['id']}/revoke", {"reason": "its disk is gone"})
        assert admit(stack, request["id"], code)["id"] == host["id"]
        assert new.ended() == 0, new.said()
        old.stop()
        new.run()
        new.wait_for_state("online")


def test_a_device_that_announces_itself_is_reviewed_and_then_serves_without_a_restart(
    stack: Stack, folder: Path
) -> None:
    heard, endpoints = free_port(), json.loads((stack.data / "endpoints.json").read_text())
    port = int(endpoints["ph_1"].rsplit(":", 1)[1])
    device = Announcer(port, serial="4711")
    with a_machine(stack, folder / "seven") as machine:
        join(stack, machine, "Bench 7")
        beacon = {"port": heard, "interface": "127.0.0.1"}
        machine.configure(discovery={"beacon": beacon, "every_s": 1})
        machine.run()
        machine.wait_for_state("online")

        def found() -> str:
            device.shout(heard)
            listed = CANDIDATE.search(page(stack, "candidate/?q=4711"))
            return "" if listed is None else listed[1]

        candidate = until(found, what=machine.said)
        form = take_up_form(stack, f"candidate/{candidate}/review/", port)
        wrong = submit(stack, f"candidate/{candidate}/review/", **form, code="0000-0000-0000")
        assert (wrong.status_code, "Do not admit" in wrong.text) == (422, True)
        code = device.code(machine.folder)
        taken = submit(stack, f"candidate/{candidate}/review/", **form, code=code)
        assert taken.status_code == 302, taken.text
        device_id = DEVICE.search(taken.headers["Location"])[1]  # type: ignore[index]
        review = f"device/{device_id}/review/"
        seen = SEEN.search(page(stack, review))
        assert seen is not None
        only = submit(stack, review, act="read_only", seen=seen[1], reason="to begin with")
        assert only.status_code == 302, only.text

        def readings() -> list[object]:
            got = stack.client("admin").get(f"devices/{device_id}")
            assert got["actions"] == []
            return list(got["readings"])

        until(readings, what=machine.said)
        rival = Announcer(port, serial="4711", name="pH 2 again")

        def is_listed() -> bool:
            rival.shout(heard)
            device.shout(heard)
            return "not its key" in page(stack, "candidate/?q=4711")

        until(is_listed)
        assert stack.client("admin").get(f"devices/{device_id}")["state"] == "enrolled"

        def is_suspended() -> bool:
            rival.shout(heard)
            return "Suspended by labweb" in page(stack, review)

        until(is_suspended, within_s=150)
        got = stack.client("admin").get(f"devices/{device_id}")
        assert got["state"] == "suspended"


def take_up_form(stack: Stack, path: str, port: int) -> dict[str, object]:
    """What an admin writes on the page of a candidate."""
    text = page(stack, path)
    driver = re.search(r'<option value="([0-9a-f]{64})" selected', text)
    assert driver is not None, "the driver that it asks for is chosen beforehand"
    return {
        "act": "take_up",
        "driver": driver[1],
        "transport": f"modbus+tcp://127.0.0.1:{port}?device=1",
        "config": "{}",
        "name": f"pH of {int(time.time())}",
        "reason": "label compared",
    }


def test_a_stranger_at_the_door_sends_little_and_the_door_stays_open(stack: Stack) -> None:
    asyncio.run(_send_a_pile(stack.door))


async def _send_a_pile(door: str) -> None:
    # On one thread: two threads that share a TLS connection may never hear the answer.
    blind = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    blind.check_hostname, blind.verify_mode = False, ssl.CERT_NONE
    for path in ("ws/edge/v1/join", "ws/edge/v1/"):
        async with connect(f"wss://{door}/{path}", ssl=blind, max_size=None) as stranger:
            with suppress(ConnectionClosed):
                await stranger.send("x" * (LONGEST_STRANGER_BYTES + 1))
                async with asyncio.timeout(10):
                    async for _ in stranger:
                        pass
            assert stranger.close_code == CLOSE_TOO_BIG
    async with connect(f"wss://{door}/ws/edge/v1/join", ssl=blind) as another:
        async with asyncio.timeout(10):
            assert '"offer"' in str(await another.recv())
