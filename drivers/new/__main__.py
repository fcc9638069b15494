"""Command line: `python -m drivers.new NAME --role ROLE --transport TRANSPORT`.

It writes a driver, its simulated instrument and its test into the checkout that it runs in. They
speak to each other at once; the author puts the manual's frames in place of theirs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from drivers.catalog.inspect import PACKAGE
from drivers.new.order import CARRIERS, DriverOrder, take_order
from drivers.new.role import role_names
from drivers.new.write import write_order
from labweb.domain.enrollment.driver_bundle import CLASSES
from labweb.domain.errors import DefinitionError

REFUSED = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Write the files; the exit code is 2 when nothing was written."""
    parser = argparse.ArgumentParser(
        prog="python -m drivers.new",
        description="Begin a driver: its file, its simulated instrument and its test.",
        epilog="The way from here to a registered driver is in docs/write-a-driver.md.",
    )
    parser.add_argument("name", help="name of the module, maker and model: acme_pump")
    parser.add_argument("--role", required=True, help=f"one of {', '.join(role_names())}")
    parser.add_argument("--transport", required=True, help=f"one of {', '.join(CARRIERS)}")
    parser.add_argument(
        "--class",
        dest="folder",
        default="",
        help=f"one of {', '.join(CLASSES)}; as a rule where the drivers of the role are",
    )
    parser.add_argument("--title", default="", help="maker and model, as on the type plate")
    options = parser.parse_args(argv)
    root = PACKAGE.parent
    try:
        order = take_order(
            root,
            options.name,
            options.role,
            options.transport,
            folder=options.folder,
            title=options.title,
        )
        written = write_order(root, order)
    except DefinitionError as error:
        reasons = [finding.message for finding in error.findings] or [error.message]
        sys.stderr.write("".join(f"drivers.new: {reason}\n" for reason in reasons))
        return REFUSED
    sys.stdout.write(_told(order, written))
    return 0


def _told(order: DriverOrder, written: Sequence[Path]) -> str:
    lines = [f"wrote    {path}\n" for path in written[:3]]
    lines += [f"entered  {order.name} in {path}\n" for path in written[3:]]
    lines.append(f"try it   .venv/bin/python -m pytest {order.test_path}\n")
    return "".join(lines)


if __name__ == "__main__":
    sys.exit(main())
