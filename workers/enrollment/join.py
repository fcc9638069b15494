"""Ask to become an edge host: `python -m workers.enrollment.join --server HOST:PORT --token TOKEN`.

The key is made here and stays here. The server proves that it is the lab's by the hash in the
token, before it is told anything; then an admin types the code that is shown here. What was
begun goes on after a crash: run the command again, without a token.

Source:
    k3s, "cluster access token": the hash of the authority travels with the secret.
"""

from __future__ import annotations

import argparse
import asyncio
import hashlib
import hmac
import os
import platform
import socket
import ssl
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from labweb.domain.enrollment.host_join import (
    LONGEST_NAME,
    SERVER_NAME,
    AdmittedHost,
    JoinAsk,
    JoinFrame,
    JoinOffer,
    JoinWaiting,
    Token,
    code_of,
    parse_token,
)
from labweb.domain.errors import DefinitionError, EnrollmentError, LabError, UnreachableError
from labweb.domain.messages.session import Refuse
from workers.base.config import LONGEST_SOCKET_PATH
from workers.base.host_key import HostKey, create_key, load_key, write_private
from workers.base.host_lock import lock_folder
from workers.enrollment.host_identity import (
    key_hash,
    signing_request,
    take_certificate,
    verifying_context,
)
from workers.journal.journal_reset import set_journal_aside

PATH = "/ws/edge/v1/join"
PATIENCE_S = 10.0
RETRY_S = 2.0
TOO_FAST = "feed.too_fast"
_MOST_TOLD = 200
MACHINE_ID = Path("/etc/machine-id")


class BegunJoin(msgspec.Struct, frozen=True, kw_only=True):
    """What is on disk until the machine is a host: `join.json`, mode 0600."""

    server: str
    token: str
    name: str
    mode: str


class HostFolder:
    """The folder in which everything of one host lies."""

    def __init__(self, folder: Path) -> None:
        """Make it, readable by its owner alone.

        Raises:
            DefinitionError: It cannot be used.
        """
        self.folder = folder.resolve()
        self.key_file = self.folder / "host.key"
        self.ca_file = self.folder / "authority.crt"
        self.config_file = self.folder / "host.json"
        self.begun_file = self.folder / "join.json"
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.folder.chmod(0o700)
        except OSError as error:
            raise DefinitionError(f"{folder} cannot be used: {error.strerror}") from error
        if len(os.fsencode(self.socket)) > LONGEST_SOCKET_PATH:
            text = f"the path of {folder} is too long for a socket in it: choose a shorter --data"
            raise DefinitionError(text)

    @property
    def socket(self) -> Path:
        """Return where the host's own Valkey listens."""
        return self.folder / "valkey.sock"

    @property
    def asking_file(self) -> Path:
        """Return where the key lies that asks; it becomes the host's when it is admitted."""
        return self.folder / "host.key.asking"


def join(place: HostFolder, begun: BegunJoin, say: Callable[[str], None]) -> AdmittedHost:
    """Ask, show the code, and wait for the admin's answer; a broken line is tried again.

    Raises:
        EnrollmentError: The server is not the lab's, or refuses, or the admin does. What is
            true then is in the message. Nothing of the host that was here before changed.
    """
    return asyncio.run(_join(place, begun, say))


async def _join(place: HostFolder, begun: BegunJoin, say: Callable[[str], None]) -> AdmittedHost:
    token = parse_token(begun.token)
    key = load_key(place.asking_file)
    authority = await fetch_authority(begun.server, token, say)
    screen = JoinScreen(code_of(token.ca_hash, key.public_raw), say)
    while True:
        try:
            async with _connected(begun.server, verifying_context(authority)) as line:
                await _ask(line, key, token, begun)
                answer = await _wait(line, screen)
        except ssl.SSLCertVerificationError as error:
            raise _impostor(str(error)) from error
        except (OSError, WebSocketException, EOFError) as error:
            say(f"the line to {begun.server} broke ({error}); trying again")
            await asyncio.sleep(RETRY_S)
            continue
        take_certificate(place.asking_file, key, answer.certificate, authority)
        _settle(place, begun, authority, answer)
        return answer


async def fetch_authority(server: str, token: Token, say: Callable[[str], None]) -> str:
    """Return the certificate of the lab's authority, once its hash is the token's.

    Nothing is told to the server for that; whoever it is learns only that somebody connected.

    Raises:
        EnrollmentError: Somebody else answers there.
        UnreachableError: Nobody does.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        async with _connected(server, context) as line:
            offer = await _receive(line)
    except (OSError, WebSocketException, EOFError) as error:
        raise UnreachableError(f"no labweb door answers at {server}: {error}") from error
    _heed(offer)
    try:
        found = key_hash(offer.ca) if isinstance(offer, JoinOffer) else ""
    except ValueError:
        found = ""
    if not hmac.compare_digest(found, token.ca_hash):
        raise _impostor(f"its authority is {found[:16] or 'none'}…, not {token.ca_hash[:16]}…")
    say(f"the server is the lab's own: its authority is {found[:16]}…")
    return offer.ca if isinstance(offer, JoinOffer) else ""


def _heed(frame: JoinFrame) -> None:
    """Stop where the door says that this machine asks too often; it has told nothing else.

    Raises:
        EnrollmentError: It says so. Whoever is there has not proved who it is yet, so that only
            plain letters of what it says are shown.
    """
    if not isinstance(frame, Refuse) or frame.code != TOO_FAST:
        return
    told = "".join(letter for letter in frame.message if letter.isprintable())[:_MOST_TOLD]
    text = (
        f"the door does not listen yet: {told}. Then run the same command again without a token; "
        "nothing was told to it, and the token is not used up"
    )
    raise EnrollmentError(text, code=TOO_FAST)


def _impostor(detail: str) -> EnrollmentError:
    text = (
        f"this is not the lab that the token is for ({detail}). Somebody may sit in between. "
        "Nothing was told to them: the token is not used up. Tell an admin"
    )
    return EnrollmentError(text, code="join.wrong_authority")


def _connected(server: str, context: ssl.SSLContext) -> connect:
    # Not the client for threads: one reads and another writes the same TLS connection there, and
    # OpenSSL under Python 3.11 then loses the answer of one opening in twenty.
    return connect(
        f"wss://{server}{PATH}",
        ssl=context,
        server_hostname=SERVER_NAME,
        open_timeout=PATIENCE_S,
        close_timeout=1.0,
        max_size=64 * 1024,
        proxy=None,
    )


async def _receive(line: ClientConnection, within_s: float | None = PATIENCE_S) -> JoinFrame:
    async with asyncio.timeout(within_s):
        told = await line.recv()
    try:
        frame: JoinFrame = msgspec.json.decode(told, type=JoinFrame)
    except msgspec.MsgspecError as error:
        raise EOFError(f"no labweb speaks there: {error}") from error
    return frame


class JoinScreen:
    """Shows the code once, however often the line breaks."""

    def __init__(self, code: str, say: Callable[[str], None]) -> None:
        self._code = code
        self._say = say
        self._is_shown = False

    def show(self) -> None:
        """Show the code that was computed here, whatever the server says it is."""
        if not self._is_shown:
            self._say(
                f"\n    {self._code}\n\n"
                "An admin types this code in labweb, under Hosts that ask. Waiting …"
            )
        self._is_shown = True


async def _ask(line: ClientConnection, key: HostKey, token: Token, begun: BegunJoin) -> None:
    _heed(await _receive(line))
    ask = JoinAsk(
        token_id=token.token_id,
        secret=token.secret,
        csr=signing_request(key),
        name=begun.name,
        machine_id=machine_id(),
        facts=facts(),
    )
    await line.send(msgspec.json.encode(ask).decode())


async def _wait(line: ClientConnection, screen: JoinScreen) -> AdmittedHost:
    while True:
        try:
            frame = await _receive(line, None)
        except ConnectionClosed as error:
            raise EOFError("the server closed") from error
        match frame:
            case JoinWaiting():
                screen.show()
            case AdmittedHost():
                return frame
            case Refuse():
                raise EnrollmentError(f"the server says: {frame.message}", code=frame.code)
            case JoinOffer():
                raise EOFError("the server began again")


def _settle(place: HostFolder, begun: BegunJoin, authority: str, answer: AdmittedHost) -> None:
    """Become the host: in this order, so that a crash in between only repeats it."""
    config = {
        "host_id": str(answer.host_id),
        "name": answer.name,
        "server_url": f"wss://{begun.server}",
        "data_dir": str(place.folder),
        "key_file": str(place.key_file),
        "ca_file": str(place.ca_file),
        "valkey": {"socket": str(place.socket)},
        "mode": begun.mode,
    }
    if place.config_file.exists():
        config = {**msgspec.json.decode(place.config_file.read_bytes()), **config}
    write_private(place.ca_file, authority.encode())
    write_private(place.config_file, msgspec.json.format(msgspec.json.encode(config), indent=1))
    if any(place.folder.glob("journal.*")):
        set_journal_aside(place.folder)
    place.asking_file.replace(place.key_file)
    place.begun_file.unlink(missing_ok=True)


def machine_id() -> str:
    """Return a hash that names this machine to labweb and to nobody else; "" is unknown.

    ``LABWEB_MACHINE_ID`` stands for the id where several hosts share a machine.

    Source:
        machine-id(5): never show the id itself; hash it with a key of the application.
    """
    try:
        raw = os.environ.get("LABWEB_MACHINE_ID", "").encode() or MACHINE_ID.read_bytes().strip()
    except OSError:
        return ""
    return hmac.new(raw, b"labweb edge host", hashlib.sha256).hexdigest() if raw else ""


def facts() -> dict[str, str]:
    """Return what an admin may want to read of this machine."""
    return {
        "hostname": socket.gethostname()[:LONGEST_NAME],
        "system": platform.platform(terse=True)[:LONGEST_NAME],
        "processor": platform.machine(),
        "software": f"labweb {version('labweb')}",
    }


def begin(arguments: Any, place: HostFolder) -> BegunJoin:  # noqa: ANN401 - argparse
    """Return what was asked for, or what an earlier call had begun here.

    Raises:
        DefinitionError: Neither a token nor anything begun; or the host is admitted already.
    """
    if arguments.token is None:
        return _begun_before(place)
    if arguments.server is None:
        raise DefinitionError("--server is missing: the address and port of the lab's door")
    text = sys.stdin.readline().strip() if arguments.token == "-" else arguments.token  # noqa: S105
    parse_token(text)
    begun = BegunJoin(
        server=arguments.server.removeprefix("wss://").rstrip("/"),
        token=text,
        name=arguments.name or socket.gethostname(),
        mode=arguments.mode,
    )
    if not place.asking_file.exists() or _read_begun(place) != begun:
        # A key that was rejected never asks again, so another request has another key.
        place.asking_file.unlink(missing_ok=True)
        write_private(place.begun_file, msgspec.json.encode(begun))
        create_key(place.asking_file)
    return begun


def _begun_before(place: HostFolder) -> BegunJoin:
    begun = _read_begun(place)
    if begun is not None and place.asking_file.exists():
        return begun
    if place.config_file.exists():
        place.begun_file.unlink(missing_ok=True)
        text = f"this host has joined: python -m workers.host --config {place.config_file}"
    else:
        text = f"nothing was begun in {place.folder}: give --server and --token"
    raise DefinitionError(text)


def _read_begun(place: HostFolder) -> BegunJoin | None:
    try:
        return msgspec.json.decode(place.begun_file.read_bytes(), type=BegunJoin)
    except (FileNotFoundError, msgspec.MsgspecError):
        return None


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m workers.enrollment.join",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--server", help="address and port of the lab's door, 192.0.2.7:8443")
    parser.add_argument("--token", help="the join token; - reads it from the keyboard")
    parser.add_argument("--name", help="name of the host (this machine's)")
    parser.add_argument("--mode", choices=["live", "sim"], default="live")
    parser.add_argument(
        "--data",
        type=Path,
        default=Path.home() / ".labweb-host",
        help="folder of the host: key, journal, configuration (~/.labweb-host)",
    )
    arguments = parser.parse_args(argv)
    try:
        place = HostFolder(arguments.data)
        lock = lock_folder(place.folder)
        try:
            answer = join(place, begin(arguments, place), _say)
        finally:
            os.close(lock)
    except LabError as error:
        sys.stderr.write(f"{error.code}: {error.message}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("\nNothing is lost: the same command without --token goes on.\n")
        return 130
    _say(
        f"{answer.name} is admitted. Start it: python -m workers.host --config {place.config_file}"
    )
    return 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
