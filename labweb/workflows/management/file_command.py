"""What the commands that read files, and ask no database, have in common."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, NoReturn

from django.core.management.base import BaseCommand, CommandParser

MANY: Mapping[str, Any] = {"nargs": "+", "action": "extend", "default": []}
"""An option that takes several words, and may be given several times."""


class FileCommand(BaseCommand):
    """A command whose exit code 2 says that something is refused, and nothing else.

    Words that it does not understand are exit code 1, where others exit with 2.
    """

    requires_system_checks = ()

    def create_parser(self, prog_name: str, subcommand: str, **kwargs: Any) -> CommandParser:  # noqa: ANN401 - as its base
        """Return the parser of the command line."""
        parser = super().create_parser(prog_name, subcommand, **kwargs)
        parser.__class__ = _Parser
        return parser


class _Parser(CommandParser):
    def error(self, message: str) -> NoReturn:
        if not self.called_from_command_line:
            super().error(message)
        self.print_usage(sys.stderr)
        self.exit(1, f"{self.prog}: error: {message}\n")
