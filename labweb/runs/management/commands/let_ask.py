"""`manage.py let_ask HOST --user ADMIN (--as NAME | --off)`: may nodes beside a host ask."""

from __future__ import annotations

from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from labweb.accounts import selectors as account_selectors
from labweb.domain.errors import LabError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.runs import services


class Command(BaseCommand):
    """Switch the wishes of one host's neighbours on or off."""

    help = (
        "Let nodes beside a host, such as those of ROS 2, ask for actions of its devices in the "
        "name of a person. Each becomes a run that somebody else has to approve."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        """Take the host's key, the admin, and in whose name."""
        parser.add_argument("key")
        parser.add_argument("--user", required=True)
        how = parser.add_mutually_exclusive_group(required=True)
        how.add_argument("--as", dest="name")
        how.add_argument("--off", action="store_true")

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - as Django
        """Switch, or say why not."""
        host = enrollment_selectors.all_hosts().filter(key=options["key"]).first()
        actor = account_selectors.find_user(options["user"])
        name = account_selectors.find_user(options["name"]) if options["name"] else None
        if host is None or actor is None or (name is None and not options["off"]):
            raise CommandError("there is no such host or no such user")
        try:
            services.let_ask(host.id, name=name, actor=actor)
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        told = "may not ask" if name is None else f"may ask in the name of {name.get_username()}"
        self.stdout.write(f"nodes beside {host.name} {told}")
