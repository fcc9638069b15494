"""`manage.py join_token --user NAME`: leave for one machine to ask to become an edge host."""

from __future__ import annotations

from typing import Any

from django.core.management.base import BaseCommand, CommandError, CommandParser

from labweb.accounts import selectors as account_selectors
from labweb.domain.enrollment.host_join import LONGEST_TOKEN_S, USUAL_TOKEN_S
from labweb.domain.errors import LabError
from labweb.enrollment import services
from labweb.resources import selectors as resource_selectors


class Command(BaseCommand):
    """Make a join token in the name of an admin, and print it once."""

    help = (
        "Make a join token: one machine may ask with it, once. The token is printed here and "
        "kept nowhere; of its secret the server has the hash alone."
    )

    def add_arguments(self, parser: CommandParser) -> None:
        """Take the person, the name of the host and the token's life."""
        parser.add_argument("--user", required=True, help="the admin in whose name it is made")
        parser.add_argument("--name", default="", help="name of the host; else the machine says")
        parser.add_argument(
            "--minutes",
            type=float,
            default=USUAL_TOKEN_S / 60,
            help=f"how long it lives: {USUAL_TOKEN_S / 60:g}, at most {LONGEST_TOKEN_S / 60:g}",
        )

    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - as Django
        """Print the token, or say why there is none."""
        actor = account_selectors.find_user(options["user"])
        if actor is None:
            raise CommandError(f"there is no user {options['user']}")
        try:
            made = services.make_token(
                resource_selectors.the_lab(),
                actor=actor,
                name=options["name"],
                lifetime_s=options["minutes"] * 60,
            )
        except LabError as error:
            raise CommandError(f"{error.code}: {error.message}") from error
        self.stdout.write(made.text)
        self.stderr.write(
            f"once, until {made.row.expires_at:%H:%M} UTC, on the new host:\n"
            f"{services.join_command(made.text)}"
        )
