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

from collections.abc import Callable, Iterator, Mapping, Sequence
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
        self._annotations = dict(compiler.annotation_col_map)

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
        for name, position in self._annotations.items():
            setattr(found, name, values[position])
        return cast("Row", found)


@dataclass(frozen=True, slots=True)
class Question(Generic[Row]):
    """A statement with its values, and how each row it returns is read.

    One that writes may be asked like any other; in a transaction, so that all of a set is
    written or nothing.
    """

    sql: str
    values: Sequence[Any] | Mapping[str, Any]
    read: Callable[[Sequence[Any]], Row]
    is_repeated: bool = False
    """The statement runs for each of the values, which are those of a row each; it returns
    nothing."""

    of: Model | None = None
    """The row that has to be there, where one is written."""


def together(*questions: Question[Any]) -> list[list[Any]]:
    """Ask one after the other, in order, without waiting for the answers in between.

    Returns:
        The rows of each; of a statement that returns none, the empty list.

    Raises:
        django.db.Error: One failed; those after it were not asked.
        ObjectDoesNotExist: A row that was to be written is gone; the others were written.
    """
    if len(questions) == 1 or connection.queries_logged:
        answers = []
        for question in questions:
            with prepared_cursor() as cursor:
                _ask(cursor, question)
                answers.append(cursor.fetchall() if cursor.description else [])
    else:
        connection.ensure_connection()
        connection.validate_no_broken_transaction()
        link: psycopg.Connection[Any] = connection.connection
        with connection.wrap_database_errors:
            cursors = [psycopg.Cursor(link) for _ in questions]
            with link.pipeline():
                for asked, question in zip(cursors, questions, strict=True):
                    _ask(asked, question)
            answers = [asked.fetchall() if asked.description else [] for asked in cursors]
    for question, rows in zip(questions, answers, strict=True):
        if question.of is not None and not rows:
            raise ObjectDoesNotExist(f"{question.of!r} is not there any more")
    return [
        [question.read(row) for row in rows]
        for question, rows in zip(questions, answers, strict=True)
    ]


def _ask(cursor: Any, question: Question[Any]) -> None:  # noqa: ANN401 - Django's or psycopg's
    if question.is_repeated:
        cursor.executemany(question.sql, question.values)
    else:
        cursor.execute(question.sql, question.values)


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
        (found,) = together(self.asking(values))
        return found

    def asking(self, values: Sequence[Any]) -> Question[tuple[Kept, tuple[Any, ...]]]:
        """Return the statement with these values, to be asked `together` with others."""
        built = self._statement
        if built is None:
            rows: QuerySet[Any, Kept] = self._model._default_manager.order_by()  # noqa: SLF001
            built = self._statement = _Statement(rows)
        statement, count = built, len(built.columns)
        return Question(
            self._sql.format(columns=", ".join(statement.columns)),
            values,
            lambda row: (statement.read(row[:count]), tuple(row[count:])),
        )


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
    if key in fields:
        together(inserting(rows))
        return
    with prepared_cursor() as cursor:
        for row in rows:
            cursor.execute(sql, _values(row, fields, is_new=True))
            (row.pk,) = cursor.fetchone()


def inserting(rows: Sequence[Model]) -> Question[Any]:
    """Return what writes new rows of a model whose keys are known, to be asked with others."""
    fields, sql = _insert(type(rows[0]))
    values = [_values(row, fields, is_new=True) for row in rows]
    return Question(sql, values, tuple, is_repeated=True)


def update_row(row: Model, *names: str) -> None:
    """Write these fields of a row, as `save(update_fields=...)` does; no signal is sent.

    Raises:
        ObjectDoesNotExist: Its row is gone.
    """
    together(updating(row, *names))


def updating(row: Model, *names: str) -> Question[Any]:
    """Return what writes these fields of a row, to be asked with others."""
    fields, sql = _update(type(row), names)
    return Question(sql, [*_values(row, fields, is_new=False), row.pk], tuple, of=row)


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
    sql = f'UPDATE "{options.db_table}" SET {columns} WHERE "{key}" = %s RETURNING true'  # noqa: S608
    return fields, sql
