"""Let a role of the database use labweb's tables, and rewrite nothing of the record."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db import connection
from django.db.transaction import atomic
from psycopg import sql

_APPENDED = """
SELECT DISTINCT c.relname FROM pg_trigger t JOIN pg_class c ON c.oid = t.tgrelid
WHERE t.tgname LIKE '%_append_only' AND c.relnamespace = 'public'::regnamespace
"""
"""The tables whose rows a trigger keeps from being edited."""


class Command(BaseCommand):
    """`manage.py grant_database ROLE`."""

    help = (
        "Run as the owner of the tables, after each migrate: let ROLE read and write them, and "
        "only read and append to what is never edited. The role is made where there is none; it "
        "gets no password here."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Declare the options."""
        parser.add_argument("role", help="role with which the lab's processes sign in")

    @atomic
    def handle(self, *_args: object, **options: Any) -> None:  # noqa: ANN401 - parsed options
        """Grant all of it, or nothing.

        Raises:
            CommandError: The role owns the tables, or is a superuser: no grant restricts it.
        """
        role = str(options["role"])
        with connection.cursor() as cursor:
            cursor.execute("SELECT rolsuper FROM pg_roles WHERE rolname = %s", [role])
            known = cursor.fetchone()
            cursor.execute("SELECT current_user, current_database()")
            (owner, database) = cursor.fetchone() or ("", "")
            if role == owner or (known is not None and known[0]):
                raise CommandError(
                    f"{role} owns the tables or is a superuser: no grant restricts it. Name "
                    "another role, and have the lab's processes sign in with it"
                )
            cursor.execute(_APPENDED)
            appended = [name for (name,) in cursor.fetchall()]
            if known is None:
                _run(cursor, "CREATE ROLE {} LOGIN", role)
            for statement in _STATEMENTS:
                _run(cursor, statement, role, database=database)
            for table in appended:
                text = "REVOKE UPDATE, DELETE ON {table} FROM {}"
                _run(cursor, text, role, table=table)
        self.stdout.write(f"{role} may use the tables, and only append to {len(appended)} of them")


_STATEMENTS = (
    "REVOKE ALL ON ALL TABLES IN SCHEMA public FROM {}",
    "REVOKE CREATE ON SCHEMA public FROM PUBLIC",
    "GRANT CONNECT ON DATABASE {database} TO {}",
    "GRANT USAGE ON SCHEMA public TO {}",
    "GRANT SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA public TO {}",
    "GRANT USAGE, SELECT ON ALL SEQUENCES IN SCHEMA public TO {}",
    "REVOKE INSERT, UPDATE, DELETE ON django_migrations FROM {}",
)


def _run(cursor: Any, text: str, role: str, **names: str) -> None:  # noqa: ANN401 - Django's cursor
    places = {key: sql.Identifier(name) for key, name in names.items()}
    cursor.execute(sql.SQL(text).format(sql.Identifier(role), **places))
