"""What one edge host is told about itself, in `host.json`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal
from urllib.parse import quote
from uuid import UUID

import msgspec

from labweb.domain.enrollment.device_announcements import expand_addresses
from labweb.domain.errors import DefinitionError
from workers.base import faults

LONGEST_SOCKET_PATH = 100
"""Bytes; the kernel's limit for a unix socket is 108."""

SLOWEST_HZ, FASTEST_HZ = 10, 100
SLOWEST_PACE, FASTEST_PACE = 0.001, 1000.0


class ValkeyConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The host's own broker: one it starts on a unix socket, or one that runs already."""

    socket: str | None = None
    url: str | None = None


class BeaconConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where announcements of devices are heard."""

    port: int = 47899
    group: str = "239.255.76.66"
    """Multicast group; broadcasts to the port are heard as well."""

    interface: str = "0.0.0.0"  # noqa: S104 - the one that the system chooses
    """Address of the network card towards the instruments."""


class DdsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where announcements of devices are heard over DDS."""

    domain: int = 0
    """Of DDS, `ROS_DOMAIN_ID` of ROS 2 nodes."""

    address: str = "127.0.0.1"
    """Of the network card towards the instruments; the loopback address: this machine alone."""

    peers: list[str] = msgspec.field(default_factory=list)
    """Machines that multicast does not reach."""


class DiscoveryConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the host looks for. Nothing is looked for unless it stands here."""

    beacon: BeaconConfig | None = None
    dds: DdsConfig | None = None
    serial: list[str] = msgspec.field(default_factory=list)
    """Patterns of paths, `/dev/ttyUSB*`; ports are listed and not opened."""

    network: list[str] = msgspec.field(default_factory=list)
    """Addresses with port, `192.0.2.0/28:5000`, at most 256; tried without sending a byte."""

    every_s: float = 30.0


class Ros2Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the host shows its devices to ROS 2."""

    domain: int = 0
    """`ROS_DOMAIN_ID` of the others."""

    address: str = "127.0.0.1"
    """Of the network card towards them; the loopback address: nodes of this machine alone."""

    peers: list[str] = msgspec.field(default_factory=list)
    """Machines that multicast does not reach."""

    namespace: str = "/labweb"
    rate_hz: float = 10.0
    """How often each status is told, 10 to 100."""

    has_goals: bool = False
    """Whether nodes may ask for actions here; the server has to allow it besides."""

    scene: str | None = None
    """The twin's configuration: also tell `/tf`, `/joint_states` and `/robot_description`."""


class HostConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One edge host."""

    host_id: UUID
    name: str
    server_url: str
    """`ws://` or `wss://` address of the server, without path."""

    broker_url: str = ""
    """Celery address of the server's broker. Empty: commands come over the uplink alone."""

    data_dir: str
    key_file: str
    """The host's key, and after it the host's certificate once it has joined; mode 0600."""

    ca_file: str | None = None
    """Certificate of the lab's authority; None: over loopback, without TLS."""

    valkey: ValkeyConfig
    mode: Literal["sim", "live"] = "sim"
    pace: float = 1.0
    """Seconds of lab time in one real second, as the simulated instruments run; 1 where the mode
    is `live`, always. Drivers wait by lab time, and their limits count in it."""

    stop_grace_s: float = 2.0
    """How long a running action may go on after the first request to end."""

    retention_s: float = 30 * 86400.0
    """How long acknowledged events are kept."""

    log_level: str = "INFO"
    discovery: DiscoveryConfig | None = None
    """None: the host looks for no devices."""

    ros2: Ros2Config | None = None
    """None: the host speaks no ROS 2."""

    tryouts: bool = False
    """Whether authors may try drivers here on simulated instruments, before anybody approves."""

    unconfined: Literal["refuse", "accept"] | None = None
    """Whether lines may run unconfined where the kernel cannot confine them. None: only when
    the mode is `sim`."""

    faults: str | None = None
    """Fault to inject, `point:kill`; for tests of crashes only."""

    @property
    def folder(self) -> Path:
        """Return the folder that holds journal, seal and locks."""
        return Path(self.data_dir)

    @property
    def ca_path(self) -> Path | None:
        """Return where the lab's authority lies; None: over loopback, without TLS."""
        return None if self.ca_file is None else Path(self.ca_file)

    @property
    def journal_path(self) -> Path:
        """Return where the journal lies."""
        return self.folder / "journal.sqlite3"

    @property
    def supervisor_bell(self) -> Path:
        """Return where the bell hangs that tells the supervisor of other devices and drivers."""
        return self.folder / "supervisor.bell"

    @property
    def bells_path(self) -> Path:
        """Return where the bells of the lines hang."""
        return self.folder / "bells"

    def bell_of(self, line: str) -> Path:
        """Return where the bell of one line hangs."""
        return self.bells_path / line_queue(line)

    @property
    def files_path(self) -> Path:
        """Return where files wait for the server, in a folder of each line."""
        return self.folder / "files"

    def files_of(self, line: str) -> Path:
        """Return where the files of one line wait for the server."""
        return self.files_path / line_queue(line)

    @property
    def drivers_folder(self) -> Path:
        """Return where the sources of drivers lie that the server sent."""
        return self.folder / "drivers"

    @property
    def accepts_unconfined(self) -> bool:
        """Say whether lines may run unconfined where the kernel cannot confine them."""
        if self.unconfined is None:
            return self.mode == "sim"
        return self.unconfined == "accept"

    @property
    def valkey_url(self) -> str:
        """Return the host's own Valkey in the form that redis-py reads."""
        if self.valkey.socket is not None:
            return f"unix://{quote(self.valkey.socket)}?db=0"
        return self.valkey.url or ""

    @property
    def host_broker_url(self) -> str:
        """Return the host's own broker in the form that Celery reads."""
        if self.valkey.socket is not None:
            return f"redis+socket://{quote(self.valkey.socket)}?virtual_host=1"
        return self.valkey.url or ""

    @property
    def uplink_url(self) -> str:
        """Return the address of the server's end of the uplink."""
        return f"{self.server_url.rstrip('/')}/ws/edge/v1/"


def load_config(path: Path) -> HostConfig:
    """Read `host.json`.

    Raises:
        DefinitionError: It is missing, malformed, or contradicts itself.
    """
    try:
        config = msgspec.json.decode(path.read_bytes(), type=HostConfig)
    except OSError as exc:
        raise DefinitionError(f"cannot read the host's configuration {path}: {exc}") from exc
    except msgspec.MsgspecError as exc:
        raise DefinitionError(f"{path} is no host configuration: {exc}") from exc
    _check(config, path)
    return config


def _check(config: HostConfig, path: Path) -> None:
    valkey = config.valkey
    if (valkey.socket is None) == (valkey.url is None):
        raise DefinitionError(f"{path}: valkey needs either a socket or a url")
    if valkey.socket is not None and len(valkey.socket.encode()) > LONGEST_SOCKET_PATH:
        raise DefinitionError(f"{path}: the socket's path is longer than {LONGEST_SOCKET_PATH}")
    if not config.server_url.startswith(("ws://", "wss://")):
        raise DefinitionError(f"{path}: server_url must begin with ws:// or wss://")
    if (config.ca_file is not None) != config.server_url.startswith("wss://"):
        raise DefinitionError(f"{path}: wss:// and ca_file go together, so that no one listens")
    if config.mode == "live" and (config.faults is not None or faults.are_wanted()):
        raise DefinitionError(f"{path}: a live host injects no faults; unset LABWEB_FAULTS")
    _check_pace(config, path)
    if config.discovery is not None:
        expand_addresses(config.discovery.network)
        if not config.discovery.every_s >= 1:
            raise DefinitionError(f"{path}: discovery looks at most once a second")
    ros2 = config.ros2
    if ros2 is not None and not SLOWEST_HZ <= ros2.rate_hz <= FASTEST_HZ:
        raise DefinitionError(f"{path}: ros2 tells statuses {SLOWEST_HZ} to {FASTEST_HZ} times/s")
    if config.stop_grace_s < 0:
        raise DefinitionError(f"{path}: stop_grace_s may not be negative")


def _check_pace(config: HostConfig, path: Path) -> None:
    if not SLOWEST_PACE <= config.pace <= FASTEST_PACE:
        raise DefinitionError(f"{path}: pace lies between {SLOWEST_PACE:g} and {FASTEST_PACE:g}")
    if config.mode == "live" and config.pace != 1.0:
        raise DefinitionError(f"{path}: a live host has the pace 1; only simulations run faster")


def command_queue(host_id: UUID) -> str:
    """Return the queue on the server's broker that belongs to one host alone."""
    return f"edge.{host_id}.cmd"


def line_queue(line: str) -> str:
    """Return the queue on the host's own broker that wakes one line."""
    return f"line.{hashlib.sha256(line.encode()).hexdigest()[:12]}"
