"""One place in a ROS 2 domain: topics, services, and the nodes that others list.

Topics travel through Cyclone DDS, services through `rpc`; nothing is opened before the first
of each.

Source:
    Profiles of quality of service as rmw and rclpy have them by default: reliable, volatile,
    the last ten; lasting ones the last one. Nodes are told as rmw_dds_common does.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from cyclonedds.core import DDSException, Listener
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from drivers.transports.ros2 import ros_names as names
from drivers.transports.ros2 import rtps
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import ServiceDefinition
from drivers.transports.ros2.rpc import Participant
from drivers.transports.ros2.types import Types, type_name
from labweb.domain.errors import (
    DefinitionError,
    DeviceTimeoutError,
    Effect,
    LabError,
    UnreachableError,
)

log = logging.getLogger(__name__)

Plain = dict[str, Any]
Reply = Callable[[Mapping[str, Any]], None]
RequestHandler = Callable[[Plain, Reply], None]
KEPT = 10
MATCH_S = 0.02
_INFO = "rmw_dds_common/msg/ParticipantEntitiesInfo"

_domains: dict[int, tuple[str, Domain]] = {}
_domains_lock = threading.Lock()


class Publisher:
    """Tells one topic."""

    def __init__(self, types: Types, message: str, writer: DataWriter[Any]) -> None:
        self._types = types
        self._message = message
        self._writer: DataWriter[Any] | None = writer

    def publish(self, value: Mapping[str, Any]) -> None:
        """Tell a value to all who listen.

        Raises:
            DefinitionError: It is no such message.
            UnreachableError: The bus is closed.
        """
        told, writer = self._types.build(self._message, value), self._writer
        if writer is None:
            raise UnreachableError("the ROS 2 domain has been left", effect=Effect.NONE)
        writer.write(told)

    @property
    def listener_count(self) -> int:
        """Return how many listen."""
        writer = self._writer
        while writer is not None:
            with suppress(IndexError):  # who joins while the library counts makes it fail
                return len(writer.get_matched_subscriptions())
        return 0

    def close(self) -> None:
        """Let go of the writer: one that is still held keeps its participant in the domain."""
        self._writer = None


class Pending:
    """A request that waits for its answer."""

    def __init__(self, types: Types, message: str) -> None:
        self._types = types
        self._message = message
        self._answered = threading.Event()
        self._payload = b""

    def take(self, payload: bytes) -> None:
        """Take the answer; a second one is passed over."""
        if not self._answered.is_set():
            self._payload = payload
            self._answered.set()

    def wait(self, timeout_s: float) -> Plain | None:
        """Return the answer; None: it has not come yet.

        Raises:
            FrameError: It cannot be read; the effect is unknown.
        """
        if not self._answered.wait(timeout_s):
            return None
        return self._types.decode(self._message, self._payload)


class Client:
    """Calls one service."""

    def __init__(self, bus: Bus, name: str, service: ServiceDefinition) -> None:
        self._types = bus.types
        self._service = service
        self._name = name
        self._waiting: dict[int, Pending] = {}
        self._lock = threading.Lock()
        self._services = bus.services
        self._reader = self._services.reader(
            names.reply_topic(name), type_name(service.response), self._heard
        )
        self._writer = self._services.writer(names.request_topic(name), type_name(service.request))

    @property
    def is_served(self) -> bool:
        """Say whether somebody takes requests and answers."""
        found = self._services.matched_count
        return found(self._reader) > 0 and found(self._writer) > 0

    def wait(self, timeout_s: float) -> None:
        """Wait until somebody serves.

        Raises:
            UnreachableError: Nobody does; nothing was sent.
        """
        pause = threading.Event()
        for _ in range(max(1, int(timeout_s / MATCH_S))):
            if self.is_served:
                return
            pause.wait(MATCH_S)
        raise UnreachableError(f"nobody serves {self._name}", effect=Effect.NONE)

    def call(self, value: Mapping[str, Any], timeout_s: float) -> Plain:
        """Ask, and return what is answered.

        Raises:
            DefinitionError: The request is no such message; nothing was sent.
            UnreachableError: Nobody serves; nothing was sent.
            DeviceTimeoutError: Nobody answered in time; the effect is unknown.
            FrameError: The answer cannot be read; the effect is unknown.
        """
        with self.begin(value) as pending:
            answer = pending.wait(timeout_s)
        if answer is None:
            raise DeviceTimeoutError(f"{self._name} did not answer within {timeout_s:g} s")
        return answer

    @contextmanager
    def begin(self, value: Mapping[str, Any]) -> Iterator[Pending]:
        """Ask, and let the caller wait piece by piece.

        Raises:
            DefinitionError, UnreachableError: As `call`; nothing was sent.
        """
        payload = self._types.encode(self._service.request, value)
        if not self.is_served:
            raise UnreachableError(f"nobody serves {self._name}", effect=Effect.NONE)
        pending = Pending(self._types, self._service.response)
        with self._lock:
            asked = rtps.SampleIdentity(self._reader, rtps.NO_SEQUENCE)
            number = self._services.write(self._writer, payload, asked)
            self._waiting[number] = pending
        try:
            yield pending
        finally:
            with self._lock:
                del self._waiting[number]

    def _heard(self, _identity: rtps.SampleIdentity, sample: rtps.DataSubmessage) -> None:
        related = sample.related
        if related is None or related.guid not in {self._reader, self._writer}:
            return
        with self._lock:
            pending = self._waiting.get(related.sequence)
        if pending is not None:
            pending.take(sample.payload)


class Bus:
    """Takes part in one ROS 2 domain. Make it after the last fork: its threads do not survive."""

    def __init__(self, settings: LinkSettings, types: Types) -> None:
        self.settings = settings
        self.types = types
        self._lock = threading.RLock()
        self._services: Participant | None = None
        self._participant: DomainParticipant | None = None
        self._entities: list[Any] = []
        self._publishers: list[Publisher] = []
        self._nodes: dict[tuple[str, str], tuple[list[bytes], list[bytes]]] = {}
        self._info: DataWriter[Any] | None = None

    @property
    def services(self) -> Participant:
        """Return what services go through."""
        with self._lock:
            if self._services is None:
                self._services = Participant(self.settings)
            return self._services

    def close(self) -> None:
        """Leave the domain: the others forget at once what was here."""
        with self._lock:
            services, self._services = self._services, None
        if services is not None:
            services.close()
        with self._lock:
            for publisher in self._publishers:
                publisher.close()
            self._publishers.clear()
            self._nodes.clear()
            self._info = None
            self._entities.clear()
            self._participant = None

    def publisher(self, name: str, message: str, *, is_lasting: bool = False) -> Publisher:
        """Tell a topic; a lasting one is also told to who comes later.

        Raises:
            DefinitionError: The name or the type is none.
        """
        with self._lock:
            writer = self._writer(names.topic(names.check_name(name)), message, is_lasting)
            found = Publisher(self.types, message, writer)
            self._publishers.append(found)
            return found

    def _writer(self, topic: str, message: str, is_lasting: bool) -> DataWriter[Any]:  # noqa: FBT001
        participant = self._join()
        made = Topic(participant, topic, self.types.of(message))
        writer: DataWriter[Any] = DataWriter(participant, made, qos=_qos(is_lasting=is_lasting))
        self._entities += [made, writer]
        return writer

    def subscribe(
        self,
        name: str,
        message: str,
        heard: Callable[[Plain], None],
        *,
        is_lasting: bool = False,
    ) -> None:
        """Listen to a topic; `heard` is called on a thread of the library's.

        Raises:
            DefinitionError: The name or the type is none.
        """
        self.subscribe_from(name, message, lambda value, _: heard(value), is_lasting=is_lasting)

    def subscribe_from(
        self,
        name: str,
        message: str,
        heard: Callable[[Plain, str], None],
        *,
        is_lasting: bool = False,
    ) -> None:
        """As `subscribe`; `heard` is also told who published, by a name that holds here."""
        with self._lock:
            participant = self._join()
            topic = names.topic(names.check_name(name))
            made = Topic(participant, topic, self.types.of(message))
            listener = _Heard(self.types, message, heard)
            qos = _qos(is_lasting=is_lasting)
            reader: DataReader[Any] = DataReader(participant, made, qos=qos, listener=listener)
            self._entities += [made, reader, listener]
        listener.on_data_available(reader)  # what came while the reader was made

    def client(self, name: str, service: ServiceDefinition) -> Client:
        """Call a service.

        Raises:
            DefinitionError: The name is none.
        """
        names.check_name(name.replace("/_action/", "/"))
        return Client(self, name, service)

    def serve(self, name: str, service: ServiceDefinition, answer: RequestHandler) -> None:
        """Offer a service.

        `answer` gets the request, and calls what it is given once, then or later; it may not
        wait, for no other request is taken meanwhile.

        Raises:
            DefinitionError: The name is none.
        """
        names.check_name(name.replace("/_action/", "/"))
        services, types = self.services, self.types
        replies = services.writer(names.reply_topic(name), type_name(service.response))

        def heard(identity: rtps.SampleIdentity, sample: rtps.DataSubmessage) -> None:
            # The reader that waits for the answer is named where the request came from Fast DDS.
            asked = rtps.SampleIdentity((sample.related or identity).guid, identity.sequence)

            def reply(value: Mapping[str, Any]) -> None:
                services.write(replies, types.encode(service.response, value), asked)

            try:
                answer(types.decode(service.request, sample.payload), reply)
            except (LabError, KeyError, TypeError, ValueError) as error:
                log.warning("a request to %s: %s", name, error)

        services.reader(names.request_topic(name), type_name(service.request), heard)

    def add_node(self, namespace: str, name: str) -> None:
        """List a node, so that `ros2 node list` shows it.

        Raises:
            DefinitionError: The name is none.
        """
        names.check_name(f"{namespace.rstrip('/')}/{name}")
        with self._lock:
            self._nodes.setdefault((namespace, name), ([], []))
            if self._info is None:
                self._info = self._writer("ros_discovery_info", _INFO, is_lasting=True)
            guid = self._join().guid.bytes
            told = {
                "gid": {"data": list(guid)},
                "node_entities_info_seq": [
                    {"node_namespace": space, "node_name": node} for space, node in self._nodes
                ],
            }
            self._info.write(self.types.build(_INFO, told))

    def _join(self) -> DomainParticipant:
        if self._participant is None:
            _configure(self.settings)
            enclave = Qos(Policy.Userdata(b"enclave=/;"))
            self._participant = DomainParticipant(self.settings.domain, qos=enclave)
        return self._participant


class _Heard(Listener):
    """Hands on what arrives."""

    def __init__(self, types: Types, message: str, heard: Callable[[Plain, str], None]) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._types = types
        self._message = message
        self._heard = heard

    def on_data_available(self, reader: DataReader[Any] | None) -> None:
        """Take what there is; without a reader, the library is still making it."""
        kind = self._types.of(self._message)
        while reader is not None:
            try:
                samples = reader.take(N=1)
            except DDSException:
                return  # the reader is being closed
            except ValueError:
                continue  # a text that is none: the sample is gone, and the next one is not
            if not samples:
                return
            sample: Any = samples[0]
            sender = str(sample.sample_info.publication_handle)
            if isinstance(sample, kind):
                self._heard(self._types.plain(self._message, sample), sender)


def _qos(*, is_lasting: bool) -> Qos:
    durability = Policy.Durability.TransientLocal if is_lasting else Policy.Durability.Volatile
    return Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)),
        durability,
        Policy.History.KeepLast(1 if is_lasting else KEPT),
    )


def _configure(settings: LinkSettings) -> None:
    """Give Cyclone DDS its settings; a process has one set for each domain.

    Raises:
        DefinitionError: This process is in the domain already, on another network card.
    """
    wanted = settings.cyclone()
    with _domains_lock:
        found = _domains.get(settings.domain)
        if found is None:
            # Its own variable would be read on top of what is given here.
            os.environ.pop("CYCLONEDDS_URI", None)
            _domains[settings.domain] = (wanted, Domain(settings.domain, wanted))
        elif found[0] != wanted:
            message = f"this process is in domain {settings.domain} with other settings"
            raise DefinitionError(message, code="ros2.link")
