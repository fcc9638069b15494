#!/usr/bin/env python
"""Django's command line."""

from __future__ import annotations

import os
import sys

from django.core.management import execute_from_command_line
from django.db.utils import OperationalError

NO_DATABASE = """\
No database can be used: {error}
A lab that `make run` has started: python -m deploy.embedded manage {words}
A database of your own: set DATABASE_URL
"""


def main(words: list[str]) -> int:
    """Do one command; a database that is not there is said in words."""
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "labweb.settings.local")
    try:
        execute_from_command_line(words)
    except OperationalError as error:
        sys.stderr.write(NO_DATABASE.format(error=error, words=" ".join(words[1:])))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
