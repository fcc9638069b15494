"""Build what many tests begin with once, and put its rows there again by one statement.

The rows are those that the services of the server have written, with the ids and times that they
had then. A database that holds anything else, or whose user may not put rows past its triggers,
gets everything built anew: then nothing is saved, and nothing is different.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cache
from typing import Any

from django.db import connection
from django.db.transaction import atomic
from psycopg import sql

_OF_MIGRATIONS = ("django_migrations", "django_content_type", "auth_permission")
"""Filled as soon as there are tables."""

_rows: dict[Hashable, str] = {}


def again(name: Hashable, build: Callable[[], object]) -> None:
    """See to it that an empty database holds what `build` leaves there.

    Args:
        name: What is built; the same name is the same rows, as long as this process lives.
        build: Writes it. It is called the first time, and whenever rows cannot be put there.
    """
    if not _may_pass_triggers() or _has_rows():
        build()
    elif name in _rows:
        with atomic(), connection.cursor() as cursor:
            cursor.execute(_rows[name])
    else:
        build()
        _rows[name] = _statement()


def contents() -> dict[str, str]:
    """Return all rows of each table that has some, as one literal.

    They are ordered by what they say: where a row lies in its table is the database's affair.
    """
    column = "(SELECT array_agg({0} ORDER BY {0}::text) FROM {0})::text"
    return {table: rows for table, rows in zip(_tables(), _of_each(column), strict=True) if rows}


def _has_rows() -> bool:
    return any(_of_each("EXISTS (SELECT FROM {0})"))


def _of_each(column: str) -> tuple[Any, ...]:
    """Ask something of every table in one query."""
    parts = [sql.SQL(column).format(sql.Identifier(table)) for table in _tables()]
    return _row(sql.SQL("SELECT {}").format(sql.SQL(", ").join(parts)))


@cache
def _tables() -> tuple[str, ...]:
    (found,) = _row(
        "SELECT array_agg(relname::text ORDER BY relname) FROM pg_class "
        "WHERE relnamespace = 'public'::regnamespace AND relkind = 'r'"
    )
    return tuple(table for table in found if table not in _OF_MIGRATIONS)


@cache
def _may_pass_triggers() -> bool:
    (found,) = _row("SELECT usesuper FROM pg_user WHERE usename = current_user")
    return bool(found)


def _row(query: str | sql.Composed) -> tuple[Any, ...]:
    with connection.cursor() as cursor:
        cursor.execute(query)
        return tuple(cursor.fetchone())


def _statement() -> str:
    """Say in SQL what fills an empty database with the rows of this one.

    They satisfied every trigger once; most of them would take rows as news and write further ones.
    """
    parts: list[sql.Composable] = [sql.SQL("SET LOCAL session_replication_role = replica")]
    parts += [
        sql.SQL("INSERT INTO {0} SELECT * FROM unnest({1}::{0}[])").format(
            sql.Identifier(table), sql.Literal(rows)
        )
        for table, rows in contents().items()
    ]
    parts += _sequences()
    parts.append(sql.SQL("SET LOCAL session_replication_role = origin"))
    return sql.SQL("; ").join(parts).as_string(connection.connection)


def _sequences() -> list[sql.Composable]:
    """Let no sequence give a number that stands in a row: `flush` begins them anew."""
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT table_name::text, column_name::text, "
            "pg_get_serial_sequence(quote_ident(table_name), column_name) "
            "FROM information_schema.columns "
            "WHERE table_schema = 'public' AND is_identity = 'YES'"
        )
        found = cursor.fetchall()
    statement = "SELECT setval({2}, greatest(max({1}), (SELECT last_value FROM {3}))) FROM {0}"
    filled = contents()
    return [
        sql.SQL(statement).format(
            sql.Identifier(table),
            sql.Identifier(column),
            sql.Literal(sequence),
            sql.SQL(sequence),
        )
        for table, column, sequence in found
        if table in filled
    ]
