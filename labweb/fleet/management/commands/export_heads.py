"""Write the signed heads of the record, to be kept outside of this server."""

from __future__ import annotations

import base64
import urllib.request
from argparse import ArgumentParser
from pathlib import Path
from typing import Any
from urllib.error import URLError

import msgspec
from django.core.management.base import BaseCommand, CommandError

from labweb.accounts.selectors.hash_chains import HeadsFile, stamped_bytes
from labweb.common.signatures import time_stamp
from labweb.domain.errors import LabError
from labweb.fleet.selectors.countersigned_heads import heads_file
from labweb.fleet.services import countersigned_heads

ANSWER_S = 20.0
MOST_BYTES = 64 * 1024


class Command(BaseCommand):
    """`manage.py export_heads FILE`."""

    help = (
        "Sign where the audit trail, the decisions and the events of each lab end, and write these "
        "heads with the countersignatures of hosts. verify_audit, verify_decisions and "
        "verify_events hold the record against such a file with --heads."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("file", type=Path, help="file to write")
        parser.add_argument(
            "--time-stamp",
            metavar="URL",
            help="have an authority confirm the time (RFC 3161 over HTTP), and keep its answer",
        )

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Sign, and write the file.

        Raises:
            CommandError: The authority refuses or does not answer, or the file cannot be written
                (exit code 1). No file is left.
        """
        countersigned_heads.sign_heads()
        file = heads_file()
        try:
            if options["time_stamp"]:
                file = _stamped(file, str(options["time_stamp"]))
            content = msgspec.json.format(msgspec.json.encode(file), indent=1)
            Path(options["file"]).write_bytes(content + b"\n")
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        except OSError as error:
            raise CommandError(f"the file cannot be written: {error}") from error
        self.stdout.write(f"{options['file']}: {len(file.heads)} heads")


def _stamped(file: HeadsFile, url: str) -> HeadsFile:
    """Return the file with the answer of a time-stamping authority.

    Raises:
        CommandError: It does not answer, or not over this.
        LabError: It refuses.
    """
    if not url.startswith(("http://", "https://")):
        raise CommandError(f"{url} is no address of a time-stamping authority: use http or https")
    asked = time_stamp.request_over(stamped_bytes(file))
    query = urllib.request.Request(  # noqa: S310 - the scheme was looked at
        url, data=asked.der, headers={"Content-Type": "application/timestamp-query"}
    )
    try:
        with urllib.request.urlopen(query, timeout=ANSWER_S) as answer:  # noqa: S310 - the same
            raw = answer.read(MOST_BYTES)
    except (URLError, TimeoutError) as error:
        raise CommandError(f"the authority at {url} does not answer: {error}") from error
    time_stamp.check_answer(asked, raw)
    stamps = [*file.time_stamps, base64.b64encode(raw).decode()]
    return msgspec.structs.replace(file, time_stamps=stamps)
