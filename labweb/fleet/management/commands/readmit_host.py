"""`manage.py readmit_host KEY --user NAME --reason TEXT`: let a quarantined host in again."""

from __future__ import annotations

from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from labweb.accounts import selectors as account_selectors
from labweb.domain.errors import LabError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services


class Command(BaseCommand):
    """Readmit one host in the name of a person who has been there."""

    help = (
        "Let a quarantined host begin again, after its journal was set aside there "
        "(python -m workers.host reset-journal) and its vessels were looked at."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        """Take the host's key, the person and the reason."""
        parser.add_argument("key")
        parser.add_argument("--user", required=True)
        parser.add_argument("--reason", required=True)

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - as Django
        """Readmit, or say why not."""
        host = enrollment_selectors.all_hosts().filter(key=options["key"]).first()
        actor = account_selectors.find_user(options["user"])
        if host is None or actor is None:
            raise CommandError("there is no such host or no such user")
        try:
            enrollment_services.readmit_host(host.id, actor=actor, reason=options["reason"])
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        self.stdout.write(f"{host.name} may begin again with a new journal")
