"""The command with which a machine joins, up to where a server is needed."""

from __future__ import annotations

from pathlib import Path
from uuid import UUID

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.domain.enrollment.join import Token, render_token
from labweb.domain.errors import EnrollmentError
from workers import join
from workers.identity import check_certificate, next_key, signing_request
from workers.keys import HostKey, create_key

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
    place = join.Place(tmp_path)
    place.begun_file.write_bytes(msgspec.json.encode({"server": 1}))
    assert join.main(["--data", str(tmp_path)]) == 1
