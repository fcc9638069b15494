"""From the URL in a lab's binding to a transport."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import SplitResult, parse_qsl, urlsplit

from drivers.transports.base import Transport
from drivers.transports.http import HttpTransport
from drivers.transports.modbus import ModbusTransport, serial_client, tcp_client
from drivers.transports.opcua.transport import OpcUaTransport
from drivers.transports.ros2.link import HIGHEST_DOMAIN, LinkSettings
from drivers.transports.ros2.ros_names import check_name
from drivers.transports.ros2.transport import Ros2Transport
from drivers.transports.s7.transport import S7Transport
from drivers.transports.serial import SerialSettings, SerialTransport, serial_line
from drivers.transports.share import Share
from drivers.transports.sila.transport import SilaTransport
from drivers.transports.tcp import TcpTransport, tcp_line
from drivers.transports.virtual import VirtualTransport
from drivers.transports.visa.transport import VisaTransport, check_resource
from labweb.domain.errors import DefinitionError

FORMS = (
    "serial:///dev/ttyUSB0?baud=9600&format=8N1&flow=none",
    "tcp://127.0.0.1:4305",
    "tcp://192.168.1.10:5000?beat=192.168.255.255:3000",
    "tcp://192.168.1.30:19204?also=19206",
    "tcp://192.168.1.40:13000?share=8080",
    "modbus+tcp://127.0.0.1:502?device=1",
    "modbus+serial:///dev/ttyUSB0?baud=9600&format=8N1&device=1",
    "http://192.168.1.20:80",
    "http://192.168.1.21:6820?token=/etc/labweb/cluster.token",
    "opc.tcp://192.168.1.20:4840/path",
    "s7://192.168.1.40:102/0/1",
    "sila://192.168.1.60:50052?ca=/etc/labweb/server.pem",
    "sila+local://127.0.0.1:50052",
    "visa://GPIB0::8::INSTR",
    "visa://USB0::0x2A8D::0x1301::MY1::INSTR",
    "visa://TCPIP0::192.168.1.50::hislip0::INSTR",
    "ros2://192.168.1.7/arm_1?domain=0",
    "virtual:timer",
)
"""Every accepted form, by example."""

_FORMAT = re.compile(r"([78])([NEO])([12])")
_FILES = {
    "sila": ("ca", Path("/etc/labweb/server.pem")),
    "http": ("token", Path("/etc/labweb/cluster.token")),
}
"""Which word of an address names a file, and how."""

_VIRTUAL = re.compile(r"virtual:[a-z0-9_-]{1,64}")
_SERIAL_KEYS = frozenset({"baud", "format", "flow"})
_THIS_HOST = ("127.0.0.1", "localhost")
_HIGHEST_PORT = 65535
_HIGHEST_RACK, _HIGHEST_SLOT = 7, 31  # three and five bits of the called TSAP
_HIGHEST_MODBUS_DEVICE = 247  # Modbus over serial line V1.02, section 2.2


def open_transport(url: str) -> Transport:
    """Build the transport a URL names and open its line.

    Raises:
        DefinitionError: The URL is none of the accepted forms.
        UnreachableError: The line cannot be opened, or somebody else holds it; effect NONE.
    """
    transport = make_transport(url)
    transport.open()
    return transport


def make_transport(url: str) -> Transport:
    """Build the transport a URL names; nothing is opened.

    Raises:
        DefinitionError: The URL is none of the accepted forms.
    """
    make, _ = _scheme(url)
    return make(url)


def line_key(url: str) -> str:
    """Name the line a URL shares; devices with the same key take turns.

    Raises:
        DefinitionError: The URL is none of the accepted forms.

    Example:
        >>> line_key("modbus+tcp://10.0.0.7:502?device=1")
        'tcp:10.0.0.7:502'
    """
    _, key = _scheme(url)
    return key(url)


def addresses_of(url: str) -> tuple[tuple[str, int], ...]:
    """List hosts and TCP ports that a line has to reach.

    Raises:
        DefinitionError: As `line_key`.

    Example:
        >>> addresses_of("tcp://10.0.0.7:19204?also=19206")
        (('10.0.0.7', 19204), ('10.0.0.7', 19206))
    """
    kind, _, address = line_key(url).partition(":")
    if kind != "tcp":
        return ()
    host, own = address.rpartition(":")[0], int(address.rpartition(":")[2])
    more = (*_further(url, own), *_shared(url, own)) if url.startswith("tcp:") else ()
    return tuple((host, port) for port in (own, *more))


def _scheme(url: str) -> tuple[Callable[[str], Transport], Callable[[str], str]]:
    name, separator, _ = url.partition(":")
    if not separator or name not in _SCHEMES:
        raise _bad(url, "unknown scheme")
    return _SCHEMES[name]


def _make_serial(url: str) -> Transport:
    return SerialTransport(url, _serial_settings(url, _SERIAL_KEYS))


def _make_tcp(url: str) -> Transport:
    host, port = _address(url, frozenset({"beat", "also", "share"}))
    made = TcpTransport(url, host, port, beat=beat_of(url), also=_further(url, port))
    for one in _shared(url, port):
        made.share = Share(made, host, one)
    return made


def _make_modbus_tcp(url: str) -> Transport:
    host, port = _address(url, frozenset({"device"}))
    return ModbusTransport(url, tcp_line(host, port), _device(url), tcp_client(host, port))


def _make_modbus_serial(url: str) -> Transport:
    settings = _serial_settings(url, _SERIAL_KEYS | {"device"})
    return ModbusTransport(url, serial_line(settings.path), _device(url), serial_client(settings))


def _make_http(url: str) -> Transport:
    host, port = _address(url, frozenset({"token"}))
    return HttpTransport(url, host, port, token_file=file_of(url))


def _make_opcua(url: str) -> Transport:
    return OpcUaTransport(url, *_opcua(url))


def _opcua_line(url: str) -> str:
    return tcp_line(*_opcua(url))


def _opcua(url: str) -> tuple[str, int]:
    """Return host and port; a path may follow, and a user may not stand before them."""
    parts = _split(url)
    _query(url, parts, frozenset())
    if not re.fullmatch(r"(?:/[A-Za-z0-9._~/-]{0,200})?", parts.path):
        raise _bad(url, "a path has letters, digits and ._~/-")
    return _address(f"opc.tcp://{parts.netloc}", frozenset())


def _make_s7(url: str) -> Transport:
    return S7Transport(url, *_s7(url))


def _s7_line(url: str) -> str:
    host, port, _, _ = _s7(url)
    return tcp_line(host, port)


def _s7(url: str) -> tuple[str, int, int, int]:
    """Return host and port, rack and slot."""
    parts = _split(url)
    _query(url, parts, frozenset())
    place = re.fullmatch(r"/([0-9]{1,2})/([0-9]{1,2})", parts.path)
    if place is None:
        raise _bad(url, "behind the port come rack and slot: /0/1")
    rack, slot = _number(url, place[1], 0, _HIGHEST_RACK), _number(url, place[2], 0, _HIGHEST_SLOT)
    return *_address(f"s7://{parts.netloc}", frozenset()), rack, slot


def _make_sila(url: str) -> Transport:
    host, port = _sila(url)
    file = file_of(url)
    root = None if file is None else Path(file)
    return SilaTransport(url, host, port, is_encrypted=url.startswith("sila:"), root=root)


def _sila_line(url: str) -> str:
    return tcp_line(*_sila(url))


def _sila(url: str) -> tuple[str, int]:
    """Return host and port; what is not encrypted does not leave this host."""
    if url.startswith("sila:"):
        return _address(url, frozenset({"ca"}))
    host, port = _address(url, frozenset())
    if host not in _THIS_HOST:
        raise _bad(url, f"sila+local is one of {', '.join(_THIS_HOST)}; others are encrypted")
    return host, port


def file_of(url: str) -> str | None:
    """Return the file that a line reads beside its device, None where it reads none.

    Raises:
        DefinitionError: It is no absolute path.

    Example:
        >>> file_of("sila://10.0.0.7:50052?ca=/etc/labweb/server.pem")
        '/etc/labweb/server.pem'
    """
    parts = _split(url)
    if parts.scheme not in _FILES:
        return None
    name, example = _FILES[parts.scheme]
    file = _query(url, parts, frozenset({name})).get(name)
    if file is not None and not (file.startswith("/") and Path(file).suffix == example.suffix):
        raise _bad(url, f"{name} is an absolute path like {example}")
    return file


def _make_visa(url: str) -> Transport:
    return VisaTransport(url, _visa(url))


def _visa_line(url: str) -> str:
    return check_resource(_visa(url))


def _visa(url: str) -> str:
    """Return the name of the resource."""
    resource = url.removeprefix("visa://")
    try:
        check_resource(resource)
    except DefinitionError as error:
        raise _bad(url, error.message) from error
    return resource


def _make_virtual(url: str) -> Transport:
    return VirtualTransport(_virtual_line(url))


def _make_ros2(url: str) -> Transport:
    settings, namespace = ros2_of(url)
    return Ros2Transport(url, settings, namespace)


def _ros2_line(url: str) -> str:
    settings, namespace = ros2_of(url)
    return f"ros2:{settings.address}:{settings.domain}{namespace}"


def ros2_of(url: str) -> tuple[LinkSettings, str]:
    """Return domain, network card and named peers, and the namespace of the nodes."""
    parts = _split(url)
    query = _query(url, parts, frozenset({"domain", "peers"}))
    if parts.netloc != parts.hostname or not parts.hostname:
        raise _bad(url, "after the slashes comes the IPv4 address of this host's network card")
    peers = tuple(one for one in query.get("peers", "").split(",") if one)
    try:
        if parts.path not in {"", "/"}:
            check_name(parts.path)
        domain = _number(url, query.get("domain", "0"), 0, HIGHEST_DOMAIN)
        return LinkSettings(domain, parts.hostname, peers), parts.path or "/"
    except DefinitionError as error:
        raise _bad(url, error.message) from error


def _serial_line(url: str) -> str:
    return serial_line(_serial_settings(url, _SERIAL_KEYS | {"device"}).path)


def _tcp_line(url: str) -> str:
    return tcp_line(*_address(url, frozenset({"device", "beat", "also", "share", "token"})))


def _virtual_line(url: str) -> str:
    if _VIRTUAL.fullmatch(url) is None:
        raise _bad(url, "a virtual line has a name of small letters, digits, _ and -")
    return url


def _serial_settings(url: str, keys: frozenset[str]) -> SerialSettings:
    parts = _split(url)
    query = _query(url, parts, keys)
    if parts.netloc or not parts.path.startswith("/"):
        raise _bad(url, "a serial port is an absolute path after three slashes")
    form = _FORMAT.fullmatch(query.get("format", "8N1"))
    if form is None:
        raise _bad(url, "format is data bits, parity, stop bits: 8N1, 7E1")
    if (flow := query.get("flow", "none")) not in {"none", "rtscts", "xonxoff"}:
        raise _bad(url, "flow is none, rtscts or xonxoff")
    baud = _number(url, query.get("baud", "9600"), 50, 4_000_000)
    return SerialSettings(parts.path, baud, int(form[1]), form[2], int(form[3]), flow)


def _address(url: str, keys: frozenset[str]) -> tuple[str, int]:
    parts = _split(url)
    _query(url, parts, keys)
    if not parts.hostname or parts.path not in {"", "/"} or "@" in parts.netloc:
        raise _bad(url, "an address is host and port")
    port = parts.netloc.rpartition(":")[2]
    return parts.hostname, _number(url, port, 1, _HIGHEST_PORT)


def beat_of(url: str) -> tuple[str, int] | None:
    """Return where datagrams go that keep the device's watchdog quiet, None without them."""
    text = dict(parse_qsl(_split(url).query)).get("beat")
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if not re.fullmatch(r"[0-9]{1,3}(?:\.[0-9]{1,3}){3}", host):
        raise _bad(url, "beat is an IPv4 address and a port")
    return host, _number(url, port, 1, _HIGHEST_PORT)


def _further(url: str, own: int) -> tuple[int, ...]:
    """Return the further ports of the same device, none of them twice."""
    text = dict(parse_qsl(_split(url).query, keep_blank_values=True)).get("also")
    ports = [] if text is None else [_number(url, one, 1, _HIGHEST_PORT) for one in text.split(",")]
    if len({own, *ports}) <= len(ports):
        raise _bad(url, "also names ports of the same device, each once: also=19205,19206")
    return tuple(ports)


def _shared(url: str, own: int) -> tuple[int, ...]:
    """Return the port at which the device's files are read over HTTP, or none."""
    text = dict(parse_qsl(_split(url).query, keep_blank_values=True)).get("share")
    if text is None:
        return ()
    port = _number(url, text, 1, _HIGHEST_PORT)
    if port in {own, *_further(url, own)}:
        raise _bad(url, "share is a port of its own")
    return (port,)


def _device(url: str) -> int:
    query = dict(parse_qsl(_split(url).query))
    return _number(url, query.get("device", "1"), 1, _HIGHEST_MODBUS_DEVICE)


def _number(url: str, text: str, low: int, high: int) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", text) or not low <= int(text) <= high:
        raise _bad(url, f"{text!r} is no whole number from {low} to {high}")
    return int(text)


def _split(url: str) -> SplitResult:
    try:
        return urlsplit(url)
    except ValueError as error:
        raise _bad(url, str(error)) from error


def _query(url: str, parts: SplitResult, keys: frozenset[str]) -> Mapping[str, str]:
    try:
        pairs = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError as error:
        raise _bad(url, str(error)) from error
    query = dict(pairs)
    if len(query) != len(pairs) or parts.fragment:
        raise _bad(url, "a key comes twice, or there is a fragment")
    unknown = sorted(set(query) - keys)
    if unknown:
        raise _bad(url, f"unknown keys {unknown}; known are {sorted(keys)}")
    return query


def _bad(url: str, reason: str) -> DefinitionError:
    return DefinitionError(
        f"{url!r}: {reason}. Write one of: {', '.join(FORMS)}", code="transport.url"
    )


_SCHEMES: Mapping[str, tuple[Callable[[str], Transport], Callable[[str], str]]] = {
    "serial": (_make_serial, _serial_line),
    "tcp": (_make_tcp, _tcp_line),
    "modbus+tcp": (_make_modbus_tcp, _tcp_line),
    "modbus+serial": (_make_modbus_serial, _serial_line),
    "http": (_make_http, _tcp_line),
    "opc.tcp": (_make_opcua, _opcua_line),
    "s7": (_make_s7, _s7_line),
    "sila": (_make_sila, _sila_line),
    "sila+local": (_make_sila, _sila_line),
    "visa": (_make_visa, _visa_line),
    "ros2": (_make_ros2, _ros2_line),
    "virtual": (_make_virtual, _virtual_line),
}
