"""The server's end of the uplink, as small as it can be: it keeps what comes and acknowledges."""

from __future__ import annotations

import base64
import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from labweb.domain.action_files import WANTED, FileOffer, FilePart, FileParts, FileTaken
from labweb.domain.messages.commands import Nudge
from labweb.domain.messages.devices_and_drivers import DeviceConfig, Signed
from labweb.domain.messages.events import Ack, EdgeEvent, EventsFrame
from labweb.domain.messages.frames import CLOSE_BAD_FRAME, EdgeFrame, ServerFrame
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION
from labweb.domain.messages.session import (
    Challenge,
    Heartbeat,
    Hello,
    Pulse,
    Refuse,
    ResumeSession,
    hello_bytes,
)
from labweb.domain.messages.stops import StopAcknowledged, StopLabFrame
from labweb.domain.messages.telemetry import TelemetryFrame, TelemetryTaken
from tests.workers.bench import Server


class Hub:
    """Takes one host in at a time."""

    def __init__(self, server: Server, devices: list[DeviceConfig], public_key: str) -> None:
        self.server = server
        self.devices = devices
        self.key = Ed25519PublicKey.from_public_bytes(base64.b64decode(public_key))
        self.hellos: list[Hello] = []
        self.events: dict[int, EdgeEvent] = {}
        self.received_s: dict[int, float] = {}
        self.frames: list[EdgeFrame] = []
        self.is_acking = True
        self.is_storing = True
        self.is_refusing = False
        self.version = PROTOCOL_VERSION
        self.knows: Callable[[EdgeFrame], bool] = lambda _frame: True
        """Whether this server knows a frame; else it closes as one of an earlier release does."""

        self.ahead_s = 0.0
        """How far the server's clock is before the one of this machine."""

        self.way_s = 0.0
        """How long a HELLO is on its way."""

        self.mode = "normal"
        self.will_resume = True
        self.socket: ServerConnection | None = None
        self.url = ""
        self.files: list[tuple[FilePart, bytes]] = []
        self.file_codes: list[str] = []
        """What the next offers are answered with; then files are wanted."""

        self.cuts_at: Callable[[FilePart], bool] = lambda _part: False
        """Whether the connection breaks at a part of a file."""

        self._parts = FileParts()

    @property
    def acked(self) -> int:
        return max(self.events, default=0)

    @property
    def now_s(self) -> float:
        return time.time() + self.ahead_s

    @property
    def kinds(self) -> list[str]:
        return [self.events[seq].kind for seq in sorted(self.events)]

    @property
    def acknowledged_stops(self) -> list[StopAcknowledged]:
        return [frame for frame in self.frames if isinstance(frame, StopAcknowledged)]

    @property
    def telemetry(self) -> list[TelemetryFrame]:
        return [frame for frame in self.frames if isinstance(frame, TelemetryFrame)]

    @property
    def heartbeats(self) -> list[Heartbeat]:
        return [frame for frame in self.frames if isinstance(frame, Heartbeat)]

    def send(self, frame: ServerFrame) -> None:
        assert self.socket is not None
        self.socket.send(msgspec.json.encode(frame).decode())

    def nudge(self, signed: Signed) -> None:
        self.send(Nudge(signed=signed))

    def stop(self, stop: StopLabFrame) -> None:
        self.send(stop)

    def cut(self) -> None:
        assert self.socket is not None
        self.socket.close()

    @contextlib.contextmanager
    def open(self, port: int = 0, host: str = "127.0.0.1") -> Iterator[None]:
        with serve(self._handle, host, port) as listening:
            self.url = f"ws://{host}:{listening.socket.getsockname()[1]}"
            thread = threading.Thread(target=listening.serve_forever)
            thread.start()
            try:
                yield
            finally:
                if self.socket is not None:
                    self.socket.close()
                listening.shutdown()
                thread.join()

    def _handle(self, socket: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            assert socket.request is not None
            assert socket.request.path == "/ws/edge/v1/"
            self._greet(socket)
            self.socket = socket
            for text in socket:
                self._take(socket, msgspec.json.decode(text, type=EdgeFrame))

    def _greet(self, socket: ServerConnection) -> None:
        nonce = f"nonce {len(self.hellos)}"
        socket.send(msgspec.json.encode(Challenge(nonce=nonce, v=self.version)).decode())
        hello = msgspec.json.decode(socket.recv(), type=Hello)
        self.key.verify(base64.b64decode(hello.signature), hello_bytes(hello, nonce))
        self.hellos.append(hello)
        if self.is_refusing:
            refuse = Refuse(code="host.revoked", message="this host's key was revoked")
            socket.send(msgspec.json.encode(refuse).decode())
            return
        self.server.epoch = hello.epoch_last + 1
        time.sleep(self.way_s)
        heard_at_s = self.now_s
        changes = {"heard_at_s": heard_at_s, "server_at_s": self.now_s, "mode": self.mode}
        welcome = self.server.welcome(*self.devices, acked_seq=self.acked, **changes)
        socket.send(msgspec.json.encode(welcome).decode())
        if self.will_resume:
            resume = ResumeSession(epoch=self.server.epoch)
            socket.send(msgspec.json.encode(resume).decode())

    def _say_time(self, socket: ServerConnection, frame: EdgeFrame) -> None:
        if isinstance(frame, Heartbeat) and frame.asked_s is not None:
            at_s = self.now_s
            pulse = Pulse(asked_s=frame.asked_s, heard_at_s=at_s, told_at_s=at_s)
            socket.send(msgspec.json.encode(pulse).decode())

    def _take(self, socket: ServerConnection, frame: EdgeFrame) -> None:
        self.frames.append(frame)
        if not self.knows(frame):
            socket.close(CLOSE_BAD_FRAME, "frame heartbeat")
            return
        self._say_time(socket, frame)
        if isinstance(frame, EventsFrame):
            for event in frame.events:
                if event.seq > self.acked:
                    assert event.seq == self.acked + 1, "a gap"
                    self.events[event.seq] = event
                    self.received_s[event.seq] = time.time()
            if self.is_acking:
                socket.send(msgspec.json.encode(Ack(seq=self.acked)).decode())
        if isinstance(frame, TelemetryFrame) and self.is_storing:
            socket.send(msgspec.json.encode(TelemetryTaken(key=frame.key)).decode())
        if isinstance(frame, FileOffer):
            self._say(socket, frame, self.file_codes.pop(0) if self.file_codes else WANTED)
        if isinstance(frame, FilePart) and self.cuts_at(frame):
            socket.close()
            return
        if isinstance(frame, FilePart) and (whole := self._parts.add(frame)) is not None:
            self.files.append((frame, whole))
            self._say(socket, frame, "")

    @property
    def offers(self) -> list[FileOffer]:
        return [frame for frame in self.frames if isinstance(frame, FileOffer)]

    def _say(self, socket: ServerConnection, of: FileOffer | FilePart, code: str) -> None:
        taken = FileTaken(action_id=of.action_id, sha256=of.sha256, code=code)
        socket.send(msgspec.json.encode(taken).decode())
