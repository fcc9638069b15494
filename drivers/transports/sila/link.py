"""One connection to a SiLA 2 server, by gRPC.

A request is never repeated: retries are off, and so is waiting for a server that is not there.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import grpc  # type: ignore[import-untyped]
from google.protobuf.message import (  # type: ignore[import-untyped]
    DecodeError,
    Message,
)

from drivers.transports.sila.features import (
    SERVICE,
    Feature,
    FeatureCommand,
    FeatureProperty,
    Value,
)
from drivers.transports.sila.messages import Messages, fill, plain
from drivers.transports.sila.watch import StreamWatch
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)

OPTIONS = (
    ("grpc.enable_retries", 0),
    ("grpc.enable_http_proxy", 0),
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.initial_reconnect_backoff_ms", 200),
)
"""A connection of its own: one that failed before would be waited for, shared by its address."""

FRAMEWORK_ERRORS = (
    "the command was not accepted",
    "no such execution of a command",
    "the command is not finished",
    "metadata is missing or bad",
    "metadata is not allowed",
)


class SilaLink:
    """A connection; every method blocks, and may be called from any thread."""

    def __init__(self, target: str, line: str, timeout_s: float, root: bytes | None) -> None:
        """Begin nothing.

        Args:
            target: Host and port.
            line: As errors name it.
            timeout_s: Longest wait for each answer.
            root: Certificate of who signed that of the server, PEM, or b"" for those that the
                host trusts. None: no encryption.
        """
        self._target, self._line, self._timeout_s = target, line, timeout_s
        self._root = root
        self._messages = Messages()
        self._watches: dict[str, StreamWatch] = {}
        self._channel: grpc.Channel | None = None

    def open(self) -> tuple[str, ...]:
        """Connect and return the features of the server.

        Raises:
            UnreachableError: It did not work; NONE.
        """
        if self._root is None:
            channel = grpc.insecure_channel(self._target, options=OPTIONS)
        else:
            credentials = grpc.ssl_channel_credentials(self._root or None)
            channel = grpc.secure_channel(self._target, credentials, options=OPTIONS)
        self._channel = channel
        try:
            grpc.channel_ready_future(channel).result(timeout=self._timeout_s)
            return self._implemented()
        except (grpc.FutureTimeoutError, DeviceError) as error:
            self.close()
            why = str(error) or "nobody answers, or its certificate is not trusted"
            raise UnreachableError(
                f"{self._line} cannot be opened: {why}", effect=Effect.NONE
            ) from error

    def close(self) -> None:
        """End the connection. May be called twice."""
        for watch in self._watches.values():
            watch.end()
        self._watches.clear()
        channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()

    def _implemented(self) -> tuple[str, ...]:
        value = Value("ImplementedFeatures", "String")
        reply = self._messages.of([value], is_list=True)
        what = "Get_ImplementedFeatures"
        answer = self._ask(SERVICE, what, self._messages.of([])(), reply)
        found: Sequence[Any] = answer.ImplementedFeatures
        return tuple(str(one.value) for one in found)

    def definition(self, feature_id: str) -> str:
        """Return the definition of a feature, as XML."""
        arguments = {"FeatureIdentifier": feature_id}
        command = SERVICE.commands["GetFeatureDefinition"]
        return str(self.call(SERVICE, command, arguments)["FeatureDefinition"])

    def read(self, feature: Feature, one: FeatureProperty) -> Any:  # noqa: ANN401 - a plain value
        """Return what a property tells now."""
        reply = self._messages.of([one.value])
        empty = self._messages.of([])()
        if one.is_observable:
            answer = self._last(feature, f"Subscribe_{one.value.name}", empty, reply)
        else:
            answer = self._ask(feature, f"Get_{one.value.name}", empty, reply)
        return self._told(answer, one.value.name)

    def call(
        self, feature: Feature, command: FeatureCommand, arguments: Mapping[str, object]
    ) -> dict[str, Any]:
        """Run a command that is answered once it is done."""
        request = fill(self._messages.of(command.parameters), arguments)
        reply = self._messages.of(command.responses)
        answer = self._ask(feature, command.name, request, reply)
        return {one.name: self._told(answer, one.name) for one in command.responses}

    def begin(
        self, feature: Feature, command: FeatureCommand, arguments: Mapping[str, object]
    ) -> str:
        """Begin a command that may be watched, and return the number of its execution."""
        request = fill(self._messages.of(command.parameters), arguments)
        reply = self._messages.framework("CommandConfirmation")
        answer = self._ask(feature, command.name, request, reply)
        number = str(self._told(answer, "commandExecutionUUID"))
        if not number:
            raise FrameError("a command was begun without a number", context={"line": self._line})
        return number

    def state(self, feature: Feature, command: FeatureCommand, number: str) -> int:
        """Return the status of an execution: 0 waiting, 1 running, 2 succeeded, 3 failed."""
        reply = self._messages.framework("ExecutionInfo")
        answer = self._last(feature, f"{command.name}_Info", self._number(number), reply)
        return int(answer.commandStatus)

    def result(self, feature: Feature, command: FeatureCommand, number: str) -> dict[str, Any]:
        """Return what an execution that is over has answered."""
        reply = self._messages.of(command.responses)
        answer = self._ask(feature, f"{command.name}_Result", self._number(number), reply)
        return {one.name: self._told(answer, one.name) for one in command.responses}

    def _number(self, number: str) -> Message:
        return self._messages.framework("CommandExecutionUUID")(value=number)

    def _told(self, answer: Message, name: str) -> Any:  # noqa: ANN401 - a plain value
        if not answer.HasField(name):
            raise FrameError(f"{name} is not told", context={"line": self._line})
        return plain(answer, name)

    def _ask(
        self, feature: Feature, method: str, request: Message, reply: type[Message]
    ) -> Message:
        call = self._method("unary_unary", feature, method, reply)
        try:
            answer: Message = call(request, timeout=self._timeout_s)
        except grpc.RpcError as error:
            raise self._failure(error, method) from error
        return answer

    def _last(
        self, feature: Feature, method: str, request: Message, reply: type[Message]
    ) -> Message:
        """Return the last answer of a stream, once the server has shown that it still answers."""
        subject = f"{feature.id}/{method}"
        key = f"{subject}/{request.SerializeToString().hex()}"
        watch = self._watches.get(key)
        if watch is None:
            for other in [one for one in self._watches if one.startswith(f"{subject}/")]:
                self._watches.pop(other).end()
            stream = self._method("unary_stream", feature, method, reply)(request)
            watch = self._watches[key] = StreamWatch(stream)
        if not watch.has_ended:
            self._prove_alive()
        try:
            answer: Message | None = watch.last(self._timeout_s)
        except grpc.RpcError as error:
            del self._watches[key]
            raise self._failure(error, method) from error
        if answer is None:
            self._watches.pop(key).end()
            context = {"line": self._line}
            raise DeviceTimeoutError(f"{method}: no answer in time", context=context)
        return answer

    def _prove_alive(self) -> None:
        """Ask for what every server tells: a stream is silent when nothing changes, too."""
        self.read(SERVICE, SERVICE.properties["ServerUUID"])

    def _method(
        self, sort: str, feature: Feature, method: str, reply: type[Message]
    ) -> Callable[..., Any]:
        if self._channel is None:
            raise UnreachableError("the line is not open: connect again", effect=Effect.NONE)
        made: Callable[..., Any] = getattr(self._channel, sort)(
            f"/{feature.service}/{method}",
            request_serializer=lambda message: message.SerializeToString(),
            response_deserializer=reply.FromString,
        )
        return made

    def _failure(self, error: grpc.RpcError, what: str) -> DeviceError:
        code, details = error.code(), error.details() or ""
        context = {"line": self._line, "status": code.name}
        if code is grpc.StatusCode.DEADLINE_EXCEEDED:
            return DeviceTimeoutError(f"{what}: no whole answer in time", context=context)
        if code is grpc.StatusCode.UNAVAILABLE:
            return UnreachableError(
                f"{what}: the line broke: {details}", effect=Effect.UNKNOWN, context=context
            )
        if code is grpc.StatusCode.UNIMPLEMENTED:
            return RejectedError(f"{what} is not there", context=context)
        if code is grpc.StatusCode.ABORTED:
            return self._told_failure(details, what)
        return FrameError(f"{what}: the answer cannot be read: {details}", context=context)

    def _told_failure(self, details: str, what: str) -> DeviceError:
        """Read an error that the server tells itself."""
        context = {"line": self._line}
        try:
            data = base64.b64decode(details, validate=True)
            told: Any = self._messages.framework("SiLAError").FromString(data)
        except (binascii.Error, DecodeError) as error:
            return FrameError(f"{what}: the error cannot be read: {error}", context=context)
        sort = _sort(told)
        if sort == "validationError":
            text = told.validationError
            return RejectedError(
                f"{what}: {text.parameter} was refused: {text.message}", context=context
            )
        if sort == "frameworkError":
            number = told.frameworkError.errorType
            why = FRAMEWORK_ERRORS[number] if number < len(FRAMEWORK_ERRORS) else str(number)
            return RejectedError(f"{what}: {why}", context={**context, "framework_error": number})
        if sort == "definedExecutionError":
            text = told.definedExecutionError
            name = text.errorIdentifier.rpartition("/")[2]
            return DeviceError(
                f"{what}: {name}: {text.message}",
                code="device.alarm",
                context={**context, "error": text.errorIdentifier},
            )
        text = told.undefinedExecutionError.message
        return DeviceError(f"{what} failed: {text}", code="device.alarm", context=context)


def _sort(told: Message) -> str:
    """Return which of the errors is told."""
    return next((one.name for one, _ in told.ListFields()), "")
