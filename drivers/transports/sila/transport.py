"""A line to a SiLA 2 server: encrypted, or without encryption on the host itself.

Requests go one at a time. The library is imported when a line is opened: other hosts lack it.

Source:
    SiLA 2, part (B) 1.1, "Transport" and "Encryption".
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from drivers.transports.base import Transport
from drivers.transports.sila.features import Feature, parse_feature
from drivers.transports.tcp import tcp_line
from labweb.domain.errors import (
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)

if TYPE_CHECKING:
    from drivers.transports.sila.link import SilaLink

ANSWER_S = 5.0
Progress = Literal["waiting", "running", "succeeded", "failed"]
_PROGRESS: tuple[Progress, ...] = ("waiting", "running", "succeeded", "failed")


class SilaTransport(Transport):
    """One server."""

    sort: ClassVar[str] = "sila"

    def __init__(
        self, url: str, host: str, port: int, *, is_encrypted: bool, root: Path | None = None
    ) -> None:
        """Open nothing.

        Args:
            url: As it was given.
            host: Of the server.
            port: Of the server.
            is_encrypted: Ask for its certificate.
            root: File, PEM, with the certificate of who signed it; a server that signed its own
                is known by that one. None: what the host trusts.
        """
        super().__init__(url, tcp_line(host, port))
        self._target = f"{host}:{port}"
        self._is_encrypted, self._root = is_encrypted, root
        self._link: SilaLink | None = None
        self._features: dict[str, Feature | None] = {}

    @property
    def is_open(self) -> bool:
        """Tell whether there is a connection, as far as is known."""
        return self._link is not None

    def _open(self) -> None:
        try:
            module = import_module("drivers.transports.sila.link")
        except ImportError as error:
            text = f"{error}: this host lacks the extra edge-sila"
            raise UnreachableError(text, effect=Effect.NONE) from error
        try:
            root = b"" if self._root is None else self._root.read_bytes()
        except OSError as error:
            raise UnreachableError(
                f"the certificate cannot be read: {error}", effect=Effect.NONE
            ) from error
        link = module.SilaLink(
            self._target, self.line, ANSWER_S, root if self._is_encrypted else None
        )
        self._features = dict.fromkeys(link.open())
        self._link = link

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @property
    def features(self) -> tuple[str, ...]:
        """List the features of the server, fully qualified."""
        return tuple(self._features)

    def feature(self, feature_id: str) -> Feature:
        """Return what the server says of one of its features.

        Raises:
            RejectedError: It has no such feature; `context["features"]` lists those it has.
            DeviceError: As `read`.
        """
        if feature_id not in self._features:
            raise RejectedError(
                f"the server has no feature {feature_id}", context={"features": self.features}
            )
        known = self._features[feature_id]
        if known is None:
            with self._asking("define", feature_id) as link:
                known = parse_feature(link.definition(feature_id))
            if known.id != feature_id:
                raise FrameError(f"asked for {feature_id}, {known.id} was defined")
            self._features[feature_id] = known
        return known

    def read(self, feature: Feature, name: str) -> Any:  # noqa: ANN401 - a plain value
        """Return what a property tells.

        Raises:
            UnreachableError: No connection (NONE), or it broke (UNKNOWN).
            DeviceTimeoutError: No answer in time; UNKNOWN.
            RejectedError: The server refused; NONE.
            FrameError: The answer cannot be read; UNKNOWN.
            DeviceError: Code `device.alarm`, with the error that the feature defines; UNKNOWN.
        """
        with self._asking("read", f"{feature.id}/{name}") as link:
            value = link.read(feature, feature.properties[name])
            self._observe("in", _line("read", f"{feature.id}/{name}", value))
            return value

    def read_number(self, feature: Feature, name: str) -> float:
        """Return what a property tells that is a number.

        Raises:
            DeviceError: As `read`; FrameError where it is none.
        """
        value = self.read(feature, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise FrameError(f"{name} is {value!r} and no number", context={"line": self.line})
        return float(value)

    def call(self, feature: Feature, name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Run a command that is answered once it is done.

        Raises:
            DeviceError: As `read`.
        """
        with self._asking("call", f"{feature.id}/{name}", *arguments.values()) as link:
            return link.call(feature, feature.commands[name], arguments)

    def begin(self, feature: Feature, name: str, arguments: Mapping[str, Any]) -> str:
        """Begin a command that may be watched, and return the number of its execution.

        Raises:
            DeviceError: As `read`. RejectedError: it was not begun.
        """
        with self._asking("begin", f"{feature.id}/{name}", *arguments.values()) as link:
            return link.begin(feature, feature.commands[name], arguments)

    def progress(self, feature: Feature, name: str, number: str) -> Progress:
        """Tell how far the execution of a command is.

        Raises:
            DeviceError: As `read`.
        """
        with self._asking("watch", f"{feature.id}/{name}", number) as link:
            state = link.state(feature, feature.commands[name], number)
        if not 0 <= state < len(_PROGRESS):
            raise FrameError(f"the status of {name} is {state}", context={"line": self.line})
        return _PROGRESS[state]

    def result(self, feature: Feature, name: str, number: str) -> dict[str, Any]:
        """Return what an execution that is over has answered.

        Raises:
            DeviceError: As `read`, with the error by which it ended.
        """
        with self._asking("result", f"{feature.id}/{name}", number) as link:
            return link.result(feature, feature.commands[name], number)

    @contextmanager
    def _asking(self, service: str, subject: str, *values: Any) -> Iterator[SilaLink]:  # noqa: ANN401
        """Keep the line for one request; a connection that broke is closed.

        After an answer that did not come in time, or cannot be read, it is made anew, so that what
        brings the device to its safe state can still be sent.
        """
        with self.lock:
            self._require_open()
            if self._link is None:
                raise UnreachableError("the line is not open: connect again", effect=Effect.NONE)
            self._observe("out", _line(service, subject, *values))
            try:
                yield self._link
            except (DeviceTimeoutError, FrameError):
                self._close()
                with suppress(UnreachableError):
                    self._open()
                raise
            except UnreachableError:
                self._close()
                raise


def _line(service: str, subject: str, *values: Any) -> bytes:  # noqa: ANN401 - any JSON
    return json.dumps([service, subject, *values], ensure_ascii=False).encode()
