"""Announce a device over DDS: `python -m workers.enrollment.announce FILE --key KEY`.

Again and again, for the computer beside an instrument that has none of its own. FILE is JSON of
what `labweb.domain.enrollment.device_announcements` describes, without key and signature, and with
its address:

    {"name": "Stirrer", "model": "HS-1", "serial": "0815", "port": 5000, "address": "192.0.2.9"}
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import msgspec

from drivers.transports.ros2.announcing import Announcements
from drivers.transports.ros2.link import LinkSettings
from labweb.domain.enrollment.device_announcements import (
    LONGEST_BEACON_BYTES,
    DdsBeacon,
    beacon_bytes,
    parse_dds_beacon,
)
from labweb.domain.errors import DefinitionError, LabError
from workers.base.host_key import HostKey, create_key, load_key

EVERY_S = 10.0


def signed(text: bytes, key: HostKey) -> bytes:
    """Return what a file says as an announcement with its key and signature.

    Raises:
        DefinitionError: It is none, or too long once it is signed.
    """
    try:
        said = msgspec.json.decode(text, type=dict)
        plain = msgspec.convert({"labweb": 1, **said, "key": key.public_base64}, DdsBeacon)
    except msgspec.MsgspecError as error:
        text_of = f"the file is no announcement: {error}"
        raise DefinitionError(text_of, code="beacon.malformed") from error
    whole = msgspec.structs.replace(plain, signature=key.sign(beacon_bytes(plain)))
    announced = msgspec.json.encode(whole)
    parse_dds_beacon(announced)
    return announced


def main(argv: Sequence[str] | None = None) -> int:
    """Announce until told to end."""
    parser = argparse.ArgumentParser(
        prog="python -m workers.enrollment.announce", description=__doc__
    )
    parser.add_argument("file", type=Path)
    parser.add_argument("--key", type=Path, required=True, help="made where it is not there")
    parser.add_argument("--domain", type=int, default=0, help="of DDS")
    parser.add_argument("--address", default="127.0.0.1", help="of the network card")
    parser.add_argument("--peer", action="append", default=[], help="where multicast does not go")
    parser.add_argument("--every", type=float, default=EVERY_S, help="seconds")
    options = parser.parse_args(argv)
    try:
        key = load_key(options.key) if options.key.exists() else create_key(options.key)
        text = signed(options.file.read_bytes(), key)
        link = LinkSettings(options.domain, options.address, tuple(options.peer))
        announcements = Announcements(link, LONGEST_BEACON_BYTES)
        pause = threading.Event()
        while True:
            announcements.say(text)
            pause.wait(max(1.0, options.every))
    except (LabError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except KeyboardInterrupt:
        return 0


if __name__ == "__main__":
    sys.exit(main())
