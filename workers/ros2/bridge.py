"""The process that shows the devices of one host to ROS 2: one node for each device.

It reads what the lines have sampled and what the journal says of the devices, and opens no
device. What others ask for goes to the server as a wish.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import UUID

from redis.exceptions import RedisError

from drivers.catalog.scan import inspect_bundle
from drivers.load import read_spec
from drivers.transports.ros2.bus import Bus, Plain, Publisher, Reply
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.ros_names import check_name, fit_name
from drivers.transports.ros2.types import Types
from labweb.domain.enrollment.driver_spec import DriverSpec, StatusSpec
from labweb.domain.errors import DefinitionError, LabError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base.config import HostConfig, Ros2Config
from workers.base.device_lines import fingerprint
from workers.base.valkey_store import StatusSample, ValkeyStore
from workers.journal.journal import Journal
from workers.line.driver_store import DriverStore, is_installed
from workers.ros2.goals import Goals
from workers.ros2.mapping import (
    action_name,
    action_text,
    offered_actions,
    parameters_of,
    status_message,
    status_type,
)
from workers.ros2.scene import begin

log = logging.getLogger(__name__)

LOOK_S = 1.0
"""How often it is looked whether the host has other devices."""

STALE_PERIODS, STALE_S = 3.0, 2.0
"""A value older than so many periods, and than this, is not told any more."""

_READ_ONLY = "settings are changed at the server, by a person"


class ChangedError(Exception):
    """The host has other devices: the process begins anew."""


class DeviceNode:
    """One device: its topics, its parameters, its actions."""

    def __init__(self, bus: Bus, space: str, device: DeviceConfig, spec: DriverSpec) -> None:
        """Show it.

        Raises:
            DefinitionError: Its name is none for ROS 2.
        """
        self.name = check_name(f"{space}/{fit_name(device.key)}")
        self._bus = bus
        self.device = device
        self.spec = spec
        self._topics: dict[str, tuple[StatusSpec, Publisher]] = {}
        for status in spec.statuses:
            if status.name in device.statuses:
                topic = f"{self.name}/{status.name}"
                self._topics[status.name] = (status, bus.publisher(topic, status_type(status)))
        self._parameters = parameters_of(spec, device.config)
        self._serve()
        bus.add_node(space, fit_name(device.key))

    def tell(self, sample: StatusSample, now_s: float) -> None:
        """Tell a value, unless it is stale."""
        found = self._topics.get(sample.status)
        period_s = self.device.statuses.get(sample.status, 0.0)
        if found is None or now_s - sample.mono_s > max(STALE_S, STALE_PERIODS * period_s):
            return
        status, publisher = found
        try:
            publisher.publish(status_message(status, sample.value))
        except (LabError, TypeError, ValueError) as error:
            log.debug("%s of %s is not told: %s", sample.status, self.name, error)

    def _serve(self) -> None:
        answers = {
            "GetParameters": self._get,
            "GetParameterTypes": self._types,
            "ListParameters": self._list,
            "DescribeParameters": self._describe,
            "SetParameters": self._set,
            "SetParametersAtomically": self._set_all,
        }
        for short, answer in answers.items():
            service = self._bus.types.definitions.service(f"rcl_interfaces/srv/{short}")
            words = "".join(f"_{c.lower()}" if c.isupper() else c for c in short).strip("_")
            self._bus.serve(f"{self.name}/{words}", service, _answering(answer))

    def _get(self, request: Plain) -> Plain:
        unset: tuple[Plain, Plain] = ({"type": 0}, {})
        return {"values": [self._parameters.get(name, unset)[0] for name in request["names"]]}

    def _types(self, request: Plain) -> Plain:
        return {"types": [one["type"] for one in self._get(request)["values"]]}

    def _list(self, request: Plain) -> Plain:
        prefixes = request["prefixes"]
        names = [name for name in self._parameters if not prefixes or name in prefixes]
        return {"result": {"names": names, "prefixes": []}}

    def _describe(self, request: Plain) -> Plain:
        known = [name for name in request["names"] if name in self._parameters]
        return {"descriptors": [self._parameters[name][1] for name in known]}

    def _set(self, request: Plain) -> Plain:
        refused = {"successful": False, "reason": _READ_ONLY}
        return {"results": [refused for _ in request["parameters"]]}

    def _set_all(self, _request: Plain) -> Plain:
        return {"result": {"successful": False, "reason": _READ_ONLY}}


def _answering(answer: Any) -> Any:  # noqa: ANN401 - a function of a request
    def serve(request: Plain, reply: Reply) -> None:
        reply(answer(request))

    return serve


class Bridge:
    """All devices of one host."""

    def __init__(self, config: HostConfig, wanted: Ros2Config) -> None:
        """Read what there is; nothing is opened yet.

        Raises:
            DefinitionError: The settings, or an interface, cannot be.
        """
        self._config, self._wanted = config, wanted
        self._store = ValkeyStore(config.valkey_url)
        journal = Journal(config.journal_path)
        try:
            self._devices = sorted(journal.devices(), key=lambda one: one.id)
            self._mark = fingerprint(self._devices)
            specs = {one.id: _spec_of(config, journal, one) for one in self._devices}
        finally:
            journal.close()
        self._specs = {key: spec for key, spec in specs.items() if spec is not None}
        texts = {
            action_name(spec, action): action_text(action)
            for spec in self._specs.values()
            for action in offered_actions(spec)
        }
        settings = LinkSettings(wanted.domain, wanted.address, tuple(wanted.peers))
        self.bus = Bus(settings, Types(Definitions(INTERFACES, texts)))
        self._goals = Goals(self._store, is_open=wanted.has_goals)
        self._latest: dict[tuple[str, str], StatusSample] = {}
        self._ending = threading.Event()
        self.nodes: dict[UUID, DeviceNode] = {}

    def run(self) -> None:
        """Show the devices until the host has others.

        Raises:
            LabError: The domain cannot be joined.
        """
        try:
            self._show()
            if self._wanted.scene is not None:
                begin(self.bus, Path(self._wanted.scene), self._wanted.rate_hz)
            threading.Thread(target=self._listen, name="samples", daemon=True).start()
            self._tell()
        finally:
            self._ending.set()
            self.bus.close()

    def stop(self) -> None:
        """End `run`."""
        self._ending.set()

    def _show(self) -> None:
        space = check_name(self._wanted.namespace)
        for device in self._devices:
            spec = self._specs.get(device.id)
            if spec is None:
                continue
            try:
                if any(fit_name(device.key) == fit_name(n.device.key) for n in self.nodes.values()):
                    raise DefinitionError(f"another device has the name of {device.key}")
                node = self.nodes[device.id] = DeviceNode(self.bus, space, device, spec)
                self._offer(node)
            except DefinitionError as error:
                log.error("device %s is not shown to ROS 2: %s", device.key, error)

    def _offer(self, node: DeviceNode) -> None:
        if not self._wanted.has_goals:
            return
        admitted = node.device.admission
        for action in offered_actions(node.spec):
            if admitted is None or action.name in admitted:
                kind = action_name(node.spec, action)
                name = f"{node.name}/{action.name}"
                self._goals.offer(self.bus, name, node.device.id, action, kind)

    def _listen(self) -> None:
        after = ""
        while not self._ending.is_set():
            try:
                after = after or self._store.last_key()
                for batch in self._store.batches(after, wait_s=0.2):
                    after = batch.key
                    for sample in batch.samples:
                        self._latest[(sample.device_id, sample.status)] = sample
            except RedisError:
                after = ""
                self._ending.wait(1.0)

    def _tell(self) -> None:
        """Tell every value at the rate that is set, and look after goals between."""
        for sample in self._store.latest_of(self.nodes):
            self._latest.setdefault((sample.device_id, sample.status), sample)
        period_s = 1.0 / self._wanted.rate_hz
        due_s = look_s = time.monotonic()
        while not self._ending.is_set():
            now_s = time.monotonic()
            for sample in list(self._latest.values()):
                node = self.nodes.get(UUID(sample.device_id))
                if node is not None:
                    node.tell(sample, now_s)
            self._goals.look()
            if now_s >= look_s:
                look_s = now_s + LOOK_S
                self._look()
            due_s = max(due_s + period_s, now_s)
            self._ending.wait(max(0.0, due_s - time.monotonic()))

    def _look(self) -> None:
        journal = Journal(self._config.journal_path)
        try:
            if fingerprint(sorted(journal.devices(), key=lambda one: one.id)) != self._mark:
                raise ChangedError
        finally:
            journal.close()


def _spec_of(config: HostConfig, journal: Journal, device: DeviceConfig) -> DriverSpec | None:
    """Return what the driver of a device declares; None: it cannot be read here."""
    try:
        if is_installed(device.module, device.digest):
            return read_spec(device.module)
        keys: Mapping[str, str] = journal.command_keys()
        return inspect_bundle(DriverStore(config.drivers_folder).read(device.digest, keys))
    except LabError as error:
        log.warning("device %s is not shown to ROS 2: %s", device.key, error)
        return None


def run_bridge(config: HostConfig) -> None:
    """Run until told to end, or until the host has other devices."""
    wanted = config.ros2
    if wanted is None:
        return
    try:
        Bridge(config, wanted).run()
    except ChangedError:
        log.info("the devices of this host have changed")
