"""The command with which a machine joins, up to where a server is needed."""

from __future__ import annotations

import asyncio
import ssl
from pathlib import Path
from uuid import UUID, uuid4

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from sila2.server.encryption import generate_self_signed_certificate
from websockets.asyncio.server import ServerConnection, serve

from labweb.domain.enrollment.host_join import Token, parse_token, render_token
from labweb.domain.errors import EnrollmentError
from labweb.domain.messages.session import Refuse
from workers.base.host_key import HostKey, create_key
from workers.enrollment import join
from workers.enrollment.host_identity import check_certificate, next_key, signing_request

TOKEN = render_token(Token("ab" * 32, UUID(int=7), "cd" * 16))


def test_a_text_that_is_no_token_is_refused_before_anything_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = join.main(["--server", "127.0.0.1:9", "--token", "nonsense", "--data", str(tmp_path)])
    assert code == 1
    assert "join.bad_token" in capsys.readouterr().err
    assert not (tmp_path / "host.key.asking").exists()


def test_a_door_that_does_not_answer_is_named_and_the_next_call_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ["--data", str(tmp_path)]
    assert join.main(["--server", "127.0.0.1:9", "--token", TOKEN, *folder]) == 1
    assert "no labweb door answers at 127.0.0.1:9" in capsys.readouterr().err
    key = (tmp_path / "host.key.asking").read_bytes()
    assert (tmp_path / "join.json").stat().st_mode & 0o777 == 0o600
    assert join.main(folder) == 1
    assert "no labweb door answers" in capsys.readouterr().err
    assert (tmp_path / "host.key.asking").read_bytes() == key, "it is the same request"


async def _refusing(frame: Refuse, certificate: Path) -> str:
    """Ask a door that refuses at once; return what the machine then says."""

    async def refuse(line: ServerConnection) -> None:
        await line.send(msgspec.json.encode(frame).decode())
        await line.close(4429)

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    async with serve(refuse, "127.0.0.1", 0, ssl=context) as door:
        port = next(iter(door.sockets)).getsockname()[1]
        with pytest.raises(EnrollmentError) as caught:
            await join.fetch_authority(f"127.0.0.1:{port}", parse_token(TOKEN), lambda _: None)
    return f"{caught.value.code}: {caught.value.message}"


def test_a_machine_that_asks_too_often_is_told_how_long_to_wait(tmp_path: Path) -> None:
    key, chain = generate_self_signed_certificate(uuid4(), "127.0.0.1")
    certificate = tmp_path / "door.pem"
    certificate.write_bytes(key + chain)
    told = "this address connects too often: wait 7 s\x1b[2J"
    said = asyncio.run(_refusing(Refuse(code="feed.too_fast", message=told), certificate))
    assert said.startswith("feed.too_fast: ")
    assert "wait 7 s" in said
    assert "in between" not in said
    assert "\x1b" not in said, "who it is has not been proved"
    other = asyncio.run(_refusing(Refuse(code="else", message="go away"), certificate))
    assert other.startswith("join.wrong_authority: ")


def test_another_token_is_another_request_with_another_key(tmp_path: Path) -> None:
    folder = ["--data", str(tmp_path)]
    join.main(["--server", "127.0.0.1:9", "--token", TOKEN, *folder])
    key = (tmp_path / "host.key.asking").read_bytes()
    other = render_token(Token("ab" * 32, UUID(int=8), "cd" * 16))
    join.main(["--server", "127.0.0.1:9", "--token", other, *folder])
    assert (tmp_path / "host.key.asking").read_bytes() != key


@pytest.mark.parametrize("arguments", [[], ["--token", TOKEN]])
def test_what_is_missing_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert join.main([*arguments, "--data", str(tmp_path)]) == 1
    assert "--server" in capsys.readouterr().err


def test_a_folder_with_a_long_path_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert join.main(["--data", str(tmp_path / ("x" * 100))]) == 1
    assert "shorter --data" in capsys.readouterr().err


def test_the_machine_is_named_by_a_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABWEB_MACHINE_ID", "0123456789abcdef")
    assert len(join.machine_id()) == 64
    assert "0123456789abcdef" not in join.machine_id()


def test_a_certificate_of_nobody_is_not_taken(tmp_path: Path) -> None:
    key = HostKey(Ed25519PrivateKey.generate())
    with pytest.raises(EnrollmentError) as refusal:
        check_certificate(key, "no certificate", "no authority")
    assert refusal.value.code == "join.bad_certificate"


def test_the_next_key_is_made_once(tmp_path: Path) -> None:
    create_key(tmp_path / "host.key")
    first = next_key(tmp_path / "host.key")
    assert next_key(tmp_path / "host.key").public_raw == first.public_raw
    assert (tmp_path / "host.key.next").stat().st_mode & 0o777 == 0o600
    assert "BEGIN CERTIFICATE REQUEST" in signing_request(first)


def test_what_was_begun_and_is_damaged_is_not_guessed_at(tmp_path: Path) -> None:
    place = join.HostFolder(tmp_path)
    place.begun_file.write_bytes(msgspec.json.encode({"server": 1}))
    assert join.main(["--data", str(tmp_path)]) == 1
