"""An authority confirms when the heads existed: the one that OpenSSL comes with."""

from __future__ import annotations

import shutil
import subprocess
import threading
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import msgspec
import pytest
from django.core.management import CommandError, call_command

from labweb.accounts.selectors.hash_chains import read_heads_file, stamped_bytes
from labweb.domain.errors import DefinitionError
from tests.builders import Bench

needs_openssl = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="OpenSSL's command plays the authority"
)

CONFIG = """
[tsa]
default_tsa = a
[a]
serial = {folder}/serial
signer_cert = {folder}/tsa.pem
signer_key = {folder}/tsa.key
certs = {folder}/tsa.pem
signer_digest = sha256
default_policy = 1.2.3.4.1
digests = sha256, sha512
accuracy = secs:1
ess_cert_id_alg = sha256
"""


def openssl(*words: str) -> bytes:
    done = subprocess.run(["openssl", *words], capture_output=True, check=True)
    return done.stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An authority's key, certificate and settings."""
    (tmp_path / "tsa.cnf").write_text(CONFIG.format(folder=tmp_path))
    (tmp_path / "serial").write_text("01\n")
    openssl(
        *("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=tsa"),
        *("-addext", "extendedKeyUsage=critical,timeStamping"),
        *("-keyout", str(tmp_path / "tsa.key"), "-out", str(tmp_path / "tsa.pem")),
    )
    return tmp_path


@contextmanager
def authority(folder: Path, spoil: bytes | None = None) -> Iterator[str]:
    """Answer questions as RFC 3161 says; or with something else."""

    class Answer(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            raw = self.rfile.read(int(self.headers["Content-Length"]))
            (folder / "query").write_bytes(raw)
            body = spoil
            if body is None:
                body = openssl(
                    *("ts", "-reply", "-config", str(folder / "tsa.cnf"), "-section", "a"),
                    *("-queryfile", str(folder / "query")),
                )
            self.send_response(200)
            self.send_header("Content-Type", "application/timestamp-reply")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_args: object) -> None:
            """Say nothing."""

    server = HTTPServer(("127.0.0.1", 0), Answer)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@needs_openssl
def test_a_stamp_over_the_heads_is_kept_and_openssl_verifies_it(bench: Bench, folder: Path) -> None:
    out = folder / "heads.json"
    with authority(folder) as url:
        call_command("export_heads", str(out), "--time-stamp", url)
    file = read_heads_file(out.read_bytes())
    assert len(file.heads) >= 2
    (folder / "reply").write_bytes(b64decode(file.time_stamps[0]))
    (folder / "data").write_bytes(stamped_bytes(file))
    words = ("-in", str(folder / "reply"), "-data", str(folder / "data"))
    assert openssl("ts", "-verify", *words, "-CAfile", str(folder / "tsa.pem")) is not None
    (folder / "data").write_bytes(stamped_bytes(file) + b" ")
    with pytest.raises(subprocess.CalledProcessError):
        openssl("ts", "-verify", *words, "-CAfile", str(folder / "tsa.pem"))


@needs_openssl
def test_a_stamp_over_something_else_is_refused(bench: Bench, folder: Path) -> None:
    openssl("ts", "-query", "-data", str(folder / "tsa.cnf"), "-out", str(folder / "other"))
    stamp = openssl(
        *("ts", "-reply", "-config", str(folder / "tsa.cnf"), "-section", "a"),
        *("-queryfile", str(folder / "other")),
    )
    out = folder / "heads.json"
    with authority(folder, stamp) as url, pytest.raises(CommandError, match="bad_stamp"):
        call_command("export_heads", str(out), "--time-stamp", url)
    assert not out.exists()


def test_an_answer_that_is_no_stamp_is_refused(bench: Bench, tmp_path: Path) -> None:
    out = tmp_path / "heads.json"
    with authority(tmp_path, b"<html>") as url, pytest.raises(CommandError, match="no time stamp"):
        call_command("export_heads", str(out), "--time-stamp", url)
    assert not out.exists()


@pytest.mark.parametrize("url", ["file:///etc/passwd", "http://127.0.0.1:9/"])
def test_an_authority_that_cannot_be_asked_is_named(bench: Bench, tmp_path: Path, url: str) -> None:
    with pytest.raises(CommandError, match=url.split("/")[2] or "no address"):
        call_command("export_heads", str(tmp_path / "heads.json"), "--time-stamp", url)


@pytest.mark.parametrize(
    "raw", [b"", b"{}", b"[1]", msgspec.json.encode({"format": "x", "version": 1, "heads": []})]
)
def test_a_file_that_holds_no_heads_is_refused(bench: Bench, tmp_path: Path, raw: bytes) -> None:
    path = tmp_path / "heads.json"
    path.write_bytes(raw)
    with pytest.raises(DefinitionError) as refusal:
        call_command("verify_audit", "--heads", str(path))
    assert refusal.value.code == "records.bad_file"
