"""`manage.py register_driver PATH --user NAME`: read a driver's source and propose it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from labweb.accounts import selectors as account_selectors
from labweb.approvals import services
from labweb.domain.errors import LabError

MAX_BYTES = 1024 * 1024


class Command(BaseCommand):
    """Propose one driver in the name of a person; another person approves it."""

    help = (
        "Read the source of a driver, list what breaks the rules, and propose it for approval "
        "by a second person. Nothing of it is executed, and nothing is written if it is refused."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        """Take the file, the person, and what it is."""
        parser.add_argument("path", type=Path)
        parser.add_argument("--user", required=True)
        parser.add_argument(
            "--module", help="drivers.CLASS.MODEL; else of the file's name and its folder's"
        )
        parser.add_argument("--note", default="", help="what is new, for who approves it")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - as Django
        """Propose, or print every finding."""
        actor = account_selectors.find_user(options["user"])
        if actor is None:
            raise CommandError(f"there is no user {options['user']}")
        path: Path = options["path"].resolve()
        module = options["module"] or f"drivers.{path.parent.name}.{path.stem}"
        try:
            row = services.submit_driver(module, _read(path), note=options["note"], actor=actor)
        except LabError as error:
            lines = [f"{one.subject}: {one.message}" for one in error.findings]
            raise CommandError("\n".join([f"{error.code}: {error.message}", *lines])) from error
        self.stdout.write(f"{row.module} {row.class_name} {row.digest} is proposed as {row.id}")


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise CommandError(f"{path} is larger than {MAX_BYTES} bytes")
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise CommandError(f"{path} is not UTF-8: {error}") from error
    except OSError as error:
        raise CommandError(f"{path} cannot be read: {error}") from error
