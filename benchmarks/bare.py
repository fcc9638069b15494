"""What there is to beat: psycopg alone, writing as many rows into tables without any rule."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID

import psycopg
from django.db import connection
from psycopg import sql
from psycopg.types.json import Jsonb

from labweb.common.clock import new_id

_WRITTEN = "SELECT relname, n_tup_ins, n_tup_upd FROM pg_stat_xact_user_tables"
_PRIMARY = """
SELECT a.attname FROM pg_index i JOIN pg_attribute a
    ON a.attrelid = i.indrelid AND a.attnum = i.indkey[0]
WHERE i.indrelid = %s::regclass AND i.indisprimary
"""

Rows = Mapping[str, tuple[int, int]]
"""Rows inserted and updated by table."""


def written() -> Rows:
    """Return what the transaction under way has written so far, by the database's own count."""
    with connection.cursor() as cursor:
        cursor.execute(_WRITTEN)
        return {name: (inserted, updated) for name, inserted, updated in cursor.fetchall()}


def between(before: Rows, after: Rows) -> Rows:
    """Return what was written from one count to the next."""
    found = {}
    for name, (inserted, updated) in after.items():
        was = before.get(name, (0, 0))
        if (inserted, updated) != was:
            found[name] = (inserted - was[0], updated - was[1])
    return found


@dataclass(frozen=True, slots=True)
class _Table:
    insert: sql.Composed
    update: sql.Composed
    row: tuple[Any, ...]
    """One row as the service wrote it; its first field is the primary key."""


class Bare:
    """Rows like those of the service, in tables with a primary key and nothing else."""

    def __init__(self) -> None:
        """Open a connection of its own, as plain as psycopg gives it."""
        self._connection = psycopg.connect(os.environ["DATABASE_URL"])
        self._tables: dict[str, _Table] = {}
        self._numbers = itertools.count(10**12)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def write(self, *transactions: Rows) -> None:
        """Insert and update so many rows, a statement each; commit after each transaction."""
        for rows in transactions:
            for name, (inserted, updated) in rows.items():
                self._write(self._tables.get(name) or self._copy(name), inserted, updated)
            self._connection.commit()

    def _write(self, table: _Table, inserted: int, updated: int) -> None:
        key = table.row[0]
        for _ in range(inserted):
            fresh = new_id() if isinstance(key, UUID) else next(self._numbers)
            self._connection.execute(table.insert, (fresh, *table.row[1:]))
        for _ in range(updated):
            self._connection.execute(table.update, (table.row[-1], key))

    def _copy(self, name: str) -> _Table:
        """Make the table anew with the newest row of the original, and no rule but its key."""
        [(key,)] = self._connection.execute(_PRIMARY, (name,)).fetchall()
        original, bare = sql.Identifier(name), sql.Identifier(f"bare_{name}")
        newest = sql.SQL("CREATE TABLE {} AS SELECT * FROM {} ORDER BY ctid DESC LIMIT 1")
        self._connection.execute(newest.format(bare, original))
        primary = sql.SQL("ALTER TABLE {} ADD PRIMARY KEY ({})")
        self._connection.execute(primary.format(bare, sql.Identifier(key)))
        cursor = self._connection.execute(sql.SQL("SELECT * FROM {}").format(bare))
        names = [column.name for column in cursor.description or ()]
        [values] = cursor.fetchall()
        found = dict(zip(names, map(_dumpable, values), strict=True))
        columns = [key, *(column for column in names if column != key)]
        insert = sql.SQL("INSERT INTO {} ({}) VALUES ({})").format(
            bare,
            sql.SQL(", ").join(map(sql.Identifier, columns)),
            sql.SQL(", ").join([sql.Placeholder()] * len(columns)),
        )
        update = sql.SQL("UPDATE {} SET {} = %s WHERE {} = %s").format(
            bare, sql.Identifier(columns[-1]), sql.Identifier(key)
        )
        self._connection.commit()
        table = _Table(insert, update, tuple(found[column] for column in columns))
        self._tables[name] = table
        return table


def _dumpable(value: object) -> object:
    return Jsonb(value) if isinstance(value, dict | list) else value
