"""Queries of hot ways: their SQL is built once for each process, and planned once by PostgreSQL.

Django builds the SQL of a query anew each time it runs, and binds values into its text, so that
PostgreSQL plans it anew too. For a lookup by id that costs several times what the lookup does.
Here a queryset is built once, with `Given` where a value will stand, and then runs as a prepared
statement. What comes back are the same objects, or tuples of a `values_list`.

    _RUN = Prepared(lambda: Run.objects.filter(pk=Given("id", UUIDField())))
    run = _RUN.first(id=run_id)

Source:
    PostgreSQL documentation, "PREPARE"; psycopg 3, "Prepared statements".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, TypeVar, cast

import psycopg
from django.core.exceptions import ObjectDoesNotExist
from django.db import DEFAULT_DB_ALIAS, connection
from django.db.backends.utils import CursorWrapper
from django.db.models import AutoField, BooleanField, Expression, Field, Func, Model, QuerySet
from django.db.models.query import ModelIterable, get_related_populators
from django.db.transaction import TransactionManagementError

Row = TypeVar("Row")
Kept = TypeVar("Kept", bound=Model)


class Given(Expression):
    """A value that is known when the query runs, not when it is built."""

    def __init__(self, name: str, kind: Field[Any, Any]) -> None:
        super().__init__(output_field=kind)
        self.name = name

    def as_sql(self, *_args: object, **_options: object) -> tuple[str, Any]:
        """Stand for itself until it is bound."""
        return "%s", [self]


class IsAnyOf(Func):
    """Whether a column is among values that are given as one array."""

    template = "%(expressions)s)"
    arg_joiner = " = ANY("
    output_field = BooleanField()


@contextmanager
def prepared_cursor() -> Iterator[CursorWrapper]:
    """Open a cursor whose statements the server plans once for each connection.

    Its values are bound by the server, so that a statement must leave no doubt of their types.
    Where queries are logged (in tests) they are bound into the text, so that the log has them.
    """
    connection.ensure_connection()
    if connection.queries_logged:
        with connection.cursor() as logged:
            yield logged
        return
    cursor = cast("CursorWrapper", psycopg.Cursor(connection.connection))
    with connection.make_cursor(cursor) as wrapped:
        yield wrapped


class _Statement(Generic[Row]):
    """The SQL of a queryset, and how its rows become objects."""

    def __init__(self, queryset: QuerySet[Any, Row]) -> None:
        compiler = queryset.query.get_compiler(DEFAULT_DB_ALIAS)
        self.sql, self.values = compiler.as_sql()
        self.is_locking = queryset.query.select_for_update
        selected = compiler.select
        converters = compiler.get_converters([column for column, _, _ in selected])
        self._converters = list(converters.items())
        if queryset._iterable_class is not ModelIterable:  # noqa: SLF001
            return
        shape = compiler.klass_info
        columns = shape["select_fields"]
        self._part = slice(columns[0], columns[-1] + 1)
        self._attributes = [column.target.attname for column, _, _ in selected[self._part]]
        populators: Any = get_related_populators
        self._populators = populators(shape, selected, DEFAULT_DB_ALIAS)
        self._model = shape["model"]
        self.columns = [column.target.column for column, _, _ in selected[self._part]]

    _model: Any = None

    def read(self, row: Sequence[Any]) -> Row:
        """Turn a row of the database into what the queryset is of."""
        values = list(row)
        for position, (converters, expression) in self._converters:
            for convert in converters:
                values[position] = convert(values[position], expression, connection)
        if self._model is None:
            return cast("Row", tuple(values))
        found = self._model.from_db(DEFAULT_DB_ALIAS, self._attributes, values[self._part])
        for populator in self._populators:
            populator.populate(values, found)
        return cast("Row", found)


@dataclass(frozen=True, slots=True)
class Question(Generic[Row]):
    """A statement with its values, and how each row it returns is read."""

    sql: str
    values: Sequence[Any]
    read: Callable[[Sequence[Any]], Row]


def together(*questions: Question[Any]) -> list[list[Any]]:
    """Ask one after the other, in order, without waiting for the answers in between.

    Returns:
        The rows of each.

    Raises:
        django.db.Error: One failed; those after it were not asked.
    """
    if len(questions) == 1 or connection.queries_logged:
        found = []
        for question in questions:
            with prepared_cursor() as cursor:
                cursor.execute(question.sql, question.values)
                found.append([question.read(row) for row in cursor.fetchall()])
        return found
    connection.ensure_connection()
    connection.validate_no_broken_transaction()
    link: psycopg.Connection[Any] = connection.connection
    with connection.wrap_database_errors:
        with link.pipeline():
            cursors = [psycopg.Cursor(link).execute(one.sql, one.values) for one in questions]
        answers = [cursor.fetchall() for cursor in cursors]
    return [
        [question.read(row) for row in rows]
        for question, rows in zip(questions, answers, strict=True)
    ]


class Prepared(Generic[Row]):
    """A query that is built when it first runs.

    Args:
        build: Returns the queryset; of its features no annotation, no prefetch and no known
            relation are carried over.
    """

    def __init__(self, build: Callable[[], QuerySet[Any, Row]]) -> None:
        self._build = build
        self._statement: _Statement[Row] | None = None

    def rows(self, **given: object) -> list[Row]:
        """Run the query with these values for what is `Given` in it.

        Raises:
            KeyError: One is missing.
            TransactionManagementError: It locks rows, and there is no transaction to hold them.
        """
        (found,) = together(self.asking(**given))
        return found

    def asking(self, **given: object) -> Question[Row]:
        """Return the query with these values, to be asked `together` with others."""
        statement = self._statement
        if statement is None:
            statement = self._statement = _Statement(self._build())
        if statement.is_locking and connection.get_autocommit():
            raise TransactionManagementError("rows are locked for the length of a transaction")
        values = [
            given[value.name] if isinstance(value, Given) else value for value in statement.values
        ]
        return Question(statement.sql, values, statement.read)

    def first(self, **given: object) -> Row | None:
        """Run the query as above and return its first row, or None."""
        return next(iter(self.rows(**given)), None)


class Written(Generic[Kept]):
    """A statement that is written out, which returns objects and what it found beside them.

    Args:
        model: What the objects are of.
        sql: It has `{columns}` where it names all columns of the model, then what else it
            selects.
    """

    def __init__(self, model: type[Kept], sql: str) -> None:
        self._model = model
        self._sql = sql
        self._statement: _Statement[Kept] | None = None

    def rows(self, values: Sequence[Any]) -> list[tuple[Kept, tuple[Any, ...]]]:
        """Run it with these values."""
        statement = self._statement
        if statement is None:
            rows: QuerySet[Any, Kept] = self._model._default_manager.order_by()  # noqa: SLF001
            statement = self._statement = _Statement(rows)
        count = len(statement.columns)
        with prepared_cursor() as cursor:
            cursor.execute(self._sql.format(columns=", ".join(statement.columns)), values)
            found = cursor.fetchall()
        return [(statement.read(row[:count]), row[count:]) for row in found]


def insert_rows(rows: Sequence[Model]) -> None:
    """Write new rows of one model; a number that the database gives is put on each.

    No signal is sent, and defaults of the database are not asked for.

    Raises:
        django.db.IntegrityError: One breaks a constraint; none was written, in a transaction.
    """
    if not rows:
        return
    fields, sql = _insert(type(rows[0]))
    key = type(rows[0])._meta.pk  # noqa: SLF001 - as Django documents it
    values = [_values(row, fields, is_new=True) for row in rows]
    with prepared_cursor() as cursor:
        if key in fields:
            cursor.executemany(sql, values)
            return
        for row, columns in zip(rows, values, strict=True):
            cursor.execute(sql, columns)
            (row.pk,) = cursor.fetchone()


def update_row(row: Model, *names: str) -> None:
    """Write these fields of a row, as `save(update_fields=...)` does; no signal is sent.

    Raises:
        ObjectDoesNotExist: Its row is gone.
    """
    fields, sql = _update(type(row), names)
    with prepared_cursor() as cursor:
        cursor.execute(sql, [*_values(row, fields, is_new=False), row.pk])
        if cursor.rowcount != 1:
            raise ObjectDoesNotExist(f"{row!r} is not there any more")


def _values(row: Model, fields: Sequence[Field[Any, Any]], *, is_new: bool) -> list[Any]:
    return [field.get_db_prep_save(field.pre_save(row, add=is_new), connection) for field in fields]


@cache
def _insert(model: type[Model]) -> tuple[Sequence[Field[Any, Any]], str]:
    options = model._meta  # noqa: SLF001
    fields = [field for field in options.concrete_fields if not isinstance(field, AutoField)]
    columns = ", ".join(f'"{field.column}"' for field in fields)
    places = ", ".join(["%s"] * len(fields))
    sql = f'INSERT INTO "{options.db_table}" ({columns}) VALUES ({places})'  # noqa: S608
    if len(fields) < len(options.concrete_fields):
        sql += f' RETURNING "{options.pk.column}"'
    return fields, sql


@cache
def _update(model: type[Model], names: Sequence[str]) -> tuple[Sequence[Field[Any, Any]], str]:
    options = model._meta  # noqa: SLF001
    fields: list[Any] = [options.get_field(name) for name in names]
    columns = ", ".join(f'"{field.column}" = %s' for field in fields)
    key = options.pk.column
    return fields, f'UPDATE "{options.db_table}" SET {columns} WHERE "{key}" = %s'  # noqa: S608
