"""Network camera that serves still pictures over HTTP and looks at one place.

Protocol: HTTP/1.1 GET of a JPEG picture, or of the first picture of a
    `multipart/x-mixed-replace` stream; tags are Data Matrix, QR or Aztec codes.
Quality: bronze, simulated instrument; not checked on hardware.
Safe state: idle; a camera moves nothing.

Source:
    Still pictures and motion JPEG as makers of IP cameras publish them (Axis VAPIX, Video
    streaming, section Image request and MJPEG); multipart bodies RFC 2046, section 5.1.
"""

from __future__ import annotations

import hashlib
import time
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.camera import Camera
from drivers.sensors._sight import look_at, open_picture
from drivers.transports.http import HttpReply, HttpTransport
from labweb.domain.errors import DefinitionError, FrameError, RejectedError

ANSWER_S = 5.0
MOST_BYTES = 4 * 2**20
"""Largest picture that is taken in."""

STREAM_BYTES = 2 * MOST_BYTES
JPEG = "image/jpeg"
STREAM = "multipart/x-mixed-replace"
HEAD_END = b"\r\n\r\n"
OK = 200
KEPT_COUNT = 8
DATE_STEP_S = 1.0
"""HTTP tells whole seconds: so much less may have passed."""

AGAIN_S = 0.1
SHOWN_S = 1.0
"""How old a sighting may be that only shows a person what there is."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """Where the picture is, and which part of it shows the place."""

    place_tag: str
    """Text of the tag that lies on the empty place, and that a vessel covers."""

    path: str = "/snapshot.jpg"
    """What is asked for: a still picture, or a stream of them."""

    left_ratio: Annotated[float, Range(0.0, 0.99)] = 0.0
    """Left edge of the place, as a share of the picture's width."""

    top_ratio: Annotated[float, Range(0.0, 0.99)] = 0.0
    """Upper edge of the place, as a share of the picture's height."""

    width_ratio: Annotated[float, Range(0.01, 1.0)] = 1.0
    """Width of the place, as a share of the picture's."""

    height_ratio: Annotated[float, Range(0.01, 1.0)] = 1.0
    """Height of the place, as a share of the picture's."""

    max_age_s: Annotated[float, Range(0.5, 60.0)] = 2.0
    """How old a picture may be, or how long it may stand still, to count."""


class NetworkCamera(Driver[HttpTransport, Config], Camera):
    """One camera, one place. Another place in the same picture is another device."""

    transport_type: ClassVar[type] = HttpTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _last_sha256: str = ""
    _pictures: dict[str, bytes] | None = None
    _sighting: dict[str, Any] | None = None
    _looked_s: float = 0.0

    def identify(self) -> None:
        """Take a picture: a camera has no other name. The next ones must differ from it.

        Raises:
            DefinitionError: The settings name no path or no tag.
            DeviceError: No picture comes, or none that can be unpacked.
        """
        if not self.config.path.startswith("/") or not self.config.path.isascii():
            raise DefinitionError("path begins with a slash", code="driver.config")
        if not self.config.place_tag.strip():
            raise DefinitionError("place_tag is empty", code="driver.config")
        data = self._fetch()
        open_picture(data)
        self._last_sha256 = hashlib.sha256(data).hexdigest()

    def halt(self) -> None:
        """Nothing to send: a camera moves nothing."""

    def picture(self, sha256: str) -> bytes | None:
        """Return the bytes of one of the last pictures, or None."""
        return (self._pictures or {}).get(sha256)

    @action(timeout_s=30.0, recovery="R1", operation="read")
    def look(self) -> Report:
        """Take a picture and return what it tells, as evidence `sighting`.

        Effect:
            None.
        """
        self.refuse_if_stopped()
        with before_acting():
            return Report(evidence={"sighting": self.sighting()})

    @status(every_s=1.0)
    def sighting(self) -> dict[str, Any]:
        """Tell what a picture taken at this moment shows."""
        with self.transport.lock:
            data, sha256 = self._take()
            box = (
                self.config.left_ratio,
                self.config.top_ratio,
                self.config.width_ratio,
                self.config.height_ratio,
            )
            seen = look_at(open_picture(data), box, self.config.place_tag)
            kept = {**(self._pictures or {}), sha256: data}
            self._pictures = dict(list(kept.items())[-KEPT_COUNT:])
            self._looked_s = time.monotonic()
            self._sighting = {**seen.to_json(), "image_sha256": sha256, "media_type": JPEG}
            return self._sighting

    @status(every_s=2.0)
    def is_present(self) -> bool | None:
        """Tell whether a vessel stands at the place; None: the picture does not tell."""
        found: bool | None = self._shown()["is_present"]
        return found

    @status(every_s=2.0)
    def tag(self) -> str | None:
        """Tell the vessel's tag, "" where none stands; None: the picture does not tell."""
        found: str | None = self._shown()["tag"]
        return found

    def _shown(self) -> dict[str, Any]:
        with self.transport.lock:
            if self._sighting is None or time.monotonic() - self._looked_s > SHOWN_S:
                return self.sighting()
            return self._sighting

    def _take(self) -> tuple[bytes, str]:
        """Take a picture that is not the one before: the noise of a sensor never repeats.

        Raises:
            FrameError: The picture stands still, so it may show the past.
        """
        deadline_s = time.monotonic() + self.config.max_age_s
        while True:
            data = self._fetch()
            sha256 = hashlib.sha256(data).hexdigest()
            if sha256 != self._last_sha256:
                self._last_sha256 = sha256
                return data, sha256
            if time.monotonic() > deadline_s:
                raise FrameError(
                    f"the picture has stood still for {self.config.max_age_s:g} s",
                    context={"image_sha256": sha256},
                )
            self.rest(AGAIN_S)

    def _fetch(self) -> bytes:
        reply = self.transport.get(
            self.config.path, timeout_s=ANSWER_S, longest_bytes=STREAM_BYTES, enough=has_part
        )
        if reply.status != OK:
            raise RejectedError(f"{self.config.path} was answered with status {reply.status}")
        return decode_picture(reply, self.config.max_age_s)


def decode_picture(reply: HttpReply, max_age_s: float) -> bytes:
    """Return the bytes of the picture in a reply.

    Raises:
        FrameError: It is no JPEG picture, too large, or older than is allowed by the
            camera's own clock, where it tells that.
    """
    _check_age(reply, max_age_s)
    sort, data = _media(reply.content_type), reply.body
    if sort == STREAM:
        part = _part_of(reply.content_type, reply.body)
        if part is None:
            raise FrameError("the stream ended before its first picture")
        head, data = part
        sort = _media(head.get("content-type", ""))
    if sort != JPEG:
        raise FrameError(f"the camera sent {sort or 'no media type'}, wanted {JPEG}")
    if not 0 < len(data) <= MOST_BYTES:
        raise FrameError(f"a picture of {len(data)} bytes; 1 to {MOST_BYTES} are allowed")
    return data


def has_part(content_type: str, body: bytes | bytearray) -> bool:
    """Tell whether a stream's first picture has come whole; what is no stream ends by itself."""
    return _media(content_type) == STREAM and _part_of(content_type, body) is not None


def _media(content_type: str) -> str:
    return content_type.partition(";")[0].strip().lower()


def _check_age(reply: HttpReply, max_age_s: float) -> None:
    content_age_s = reply.content_age_s
    if content_age_s is None:
        return
    age_s = content_age_s - DATE_STEP_S
    if age_s > max_age_s:
        raise FrameError(f"the picture is over {age_s:g} s old; {max_age_s:g} s are allowed")


def _part_of(content_type: str, body: bytes | bytearray) -> tuple[dict[str, str], bytes] | None:
    """Return head and bytes of the first whole part of a stream; None: it has not come yet."""
    boundary = _boundary(content_type)
    start = body.find(boundary)
    end = body.find(HEAD_END, start)
    if start < 0 or end < 0:
        return None
    lines = body[start + len(boundary) : end].decode("latin-1").split("\r\n")
    pairs = (line.partition(":") for line in lines if ":" in line)
    head = {name.strip().lower(): value.strip() for name, _, value in pairs}
    data = bytes(body[end + len(HEAD_END) :])
    length = head.get("content-length", "")
    if length.isdecimal() and len(length) < len(str(STREAM_BYTES)) + 1:
        return (head, data[: int(length)]) if len(data) >= int(length) else None
    after = data.find(b"\r\n" + boundary)
    return (head, data[:after]) if after >= 0 else None


def _boundary(content_type: str) -> bytes:
    """Return what stands before each part.

    Raises:
        FrameError: The stream names none.
    """
    for parameter in content_type.split(";")[1:]:
        name, _, value = parameter.partition("=")
        if name.strip().lower() == "boundary" and value.strip(' "'):
            return b"--" + value.strip(' "').removeprefix("--").encode("latin-1", "replace")
    raise FrameError("the stream names no boundary")
