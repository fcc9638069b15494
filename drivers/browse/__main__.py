r"""Ask a server what a device offers, and write it down as a `DriverSpec`.

```text
python -m drivers.browse opc.tcp://192.168.1.20:4840 DeviceSet/Controller
python -m drivers.browse sila://192.168.1.60:50052?ca=/etc/labweb/server.pem \
    org.silastandard/examples/TemperatureController/v1
python -m drivers.browse http://192.168.1.20/openapi.json /api/v1/Process
python -m drivers.browse openapi.json /api/v1/Process
```

What is printed is JSON: the spec, and for each of its names the node behind it with the factor
between the server's unit and ours. What cannot be mapped is left out and stands in the findings,
so nobody takes the spec for more than it is. It drives nothing: a driver on it is written,
read and approved as any other.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import msgspec

from drivers.browse.browsed import Browsed
from drivers.browse.opcua import browse
from drivers.browse.openapi import browse_document, fetch_document, parse_document
from drivers.browse.sila import browse_feature
from drivers.transports.opcua.transport import OpcUaTransport
from drivers.transports.sila.transport import SilaTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import DefinitionError, LabError


def browse_any(where: str, what: str) -> Browsed:
    """Browse an OPC UA or a SiLA 2 server by its URL, or an OpenAPI document by URL or file.

    Raises:
        LabError: It cannot be reached or read, or has no such part.
    """
    parts = tuple(part for part in what.split("/") if part)
    if where.startswith(("http://", "https://")):
        return browse_document(fetch_document(where), what)
    if where.endswith(".json"):
        return browse_document(_read(Path(where)), what)
    transport = make_transport(where)
    if not isinstance(transport, OpcUaTransport | SilaTransport):
        raise DefinitionError(
            f"{where} is no opc.tcp://, sila://, http:// or https:// URL, and no .json file",
            code="transport.url",
        )
    transport.open()
    try:
        if isinstance(transport, SilaTransport):
            return browse_feature(transport, what)
        return browse(transport, parts)
    finally:
        transport.close()


def _read(path: Path) -> dict[str, Any]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DefinitionError(f"{path} cannot be read: {error}", code="browse.file") from error
    return parse_document(data, str(path))


def main(arguments: list[str] | None = None) -> int:
    """Browse and print; the exit code is 1 when something was left out, 2 when it failed."""
    parser = argparse.ArgumentParser(
        prog="python -m drivers.browse", description="Write down what a device says it offers."
    )
    parser.add_argument(
        "where", help="opc.tcp://host:port/path, sila://host:port, http://host/doc.json, doc.json"
    )
    parser.add_argument(
        "what", help="DeviceSet/Controller, a feature of SiLA 2, or a path of the document"
    )
    options = parser.parse_args(arguments)
    try:
        found = browse_any(options.where, options.what)
    except LabError as error:
        sys.stderr.write(f"{error.code}: {error.message}\n")
        return 2
    sys.stdout.write(msgspec.json.encode(found, order="sorted").decode() + "\n")
    for finding in found.spec.findings:
        sys.stderr.write(f"{finding.code} {finding.subject}: {finding.message}\n")
    return 1 if found.spec.findings else 0


if __name__ == "__main__":
    sys.exit(main())
