"""Lists that grow, given page by page without loss or doubling while rows are added."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeVar

from django.core.exceptions import ValidationError
from django.db.models import Field, Model, Q, QuerySet
from rest_framework.request import Request

from labweb.common.requests import Parameter, whole_number
from labweb.domain.errors import DefinitionError

T = TypeVar("T")
M = TypeVar("M", bound=Model)

_LONGEST_CURSOR = 4000


@dataclass(frozen=True, slots=True)
class Paging:
    """How many rows of a list one answer brings."""

    usual: int
    most: int

    @property
    def parameters(self) -> dict[str, Parameter]:
        """What an address with such a list takes: `limit`, and `after` for the next page."""
        count = {"type": "integer", "minimum": 1, "maximum": self.most, "default": self.usual}
        text = f"How many rows, at most {self.most}."
        return {
            "limit": Parameter(count, text),
            "after": Parameter(
                {"type": "string"}, "Go on behind the page before: the `next` of its answer."
            ),
        }

    def of_rows(
        self, request: Request, rows: QuerySet[M], *order: str
    ) -> tuple[list[M], str | None]:
        """Read one page from the database.

        Args:
            request: Says `limit` and `after`.
            rows: All of the list.
            order: Columns as `order_by` takes them, none of them null, the last one unique.

        Returns:
            The rows, and the cursor of the next page; None: these are the last.

        Raises:
            DefinitionError: `limit` or `after` is none.
        """
        limit, names = self._limit(request), [name.lstrip("-") for name in order]
        last = _read(request, order)
        if last is not None:
            try:
                rows = rows.filter(_behind(order, _as_columns(rows.model, names, last)))
            except (ValidationError, ValueError, TypeError, OverflowError) as error:
                raise _no_cursor() from error
        found = list(rows.order_by(*order)[: limit + 1])
        if len(found) <= limit:
            return found, None
        at = [getattr(found[limit - 1], name) for name in names]
        return found[:limit], _written(order, at)

    def of_list(
        self, request: Request, rows: Iterable[T], key: Callable[[T], Sequence[Any]]
    ) -> tuple[list[T], str | None]:
        """Cut one page out of rows that are at hand.

        Args:
            request: Says `limit` and `after`.
            rows: All of the list, in any order.
            key: Texts and numbers by which a row is ordered; no two rows have the same.

        Returns:
            The rows in the order of their keys, and the cursor of the next page; None: these
            are the last.

        Raises:
            DefinitionError: `limit` or `after` is none.
        """
        limit, name = self._limit(request), ("key",)
        last = _read(request, name)
        keyed = sorted(((list(key(row)), row) for row in rows), key=lambda pair: pair[0])
        if last is not None:
            try:
                keyed = [pair for pair in keyed if pair[0] > last]
            except TypeError as error:
                raise _no_cursor() from error
        found = [row for _, row in keyed[:limit]]
        return found, _written(name, keyed[limit - 1][0]) if len(keyed) > limit else None

    def _limit(self, request: Request) -> int:
        return whole_number(request, "limit", default=self.usual, low=1, high=self.most)


HISTORY = Paging(usual=100, most=500)
"""What happened: it grows with every day."""

STANDING = Paging(usual=1000, most=5000)
"""What there is; pages read all of it."""


def _as_columns(model: type[Model], names: Sequence[str], values: Sequence[Any]) -> list[Any]:
    known: dict[str, Field[Any, Any]] = {one.attname: one for one in model._meta.concrete_fields}  # noqa: SLF001 - documented by Django
    found = [
        getattr(known[name], "target_field", known[name]).to_python(value)
        for name, value in zip(names, values, strict=True)
    ]
    if None in found or any(isinstance(v, int) and abs(v) >= 2**63 for v in found):
        raise ValueError(names)
    return found


def _behind(order: Sequence[str], values: Sequence[Any]) -> Q:
    """Return what stands behind a row: greater in one column, equal in all before it."""
    behind, equal = Q(pk__in=[]), Q()
    for name, value in zip(order, values, strict=True):
        plain = name.lstrip("-")
        behind |= equal & Q(**{f"{plain}__{'lt' if name.startswith('-') else 'gt'}": value})
        equal &= Q(**{plain: value})
    return behind


def _written(order: Sequence[str], values: Sequence[Any]) -> str:
    told = [",".join(order), *values]
    text = json.dumps(told, default=_plain, ensure_ascii=False, separators=(",", ":"))
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def _plain(value: object) -> str:
    return value.isoformat() if isinstance(value, datetime) else str(value)


def _read(request: Request, order: Sequence[str]) -> list[Any] | None:
    """Return where the page before ended; None: this is the first."""
    text = request.query_params.get("after")
    if text is None:
        return None
    try:
        if len(text) > _LONGEST_CURSOR:
            raise ValueError(len(text))
        raw = base64.b64decode(text.encode() + b"=" * (-len(text) % 4), b"-_", validate=True)
        told = json.loads(raw)
    except (ValueError, RecursionError) as error:
        raise _no_cursor() from error
    is_ours = isinstance(told, list) and told[:1] == [",".join(order)] and len(told) > 1
    if not is_ours or any(not isinstance(v, str | int | float) for v in told):
        raise _no_cursor()
    values: list[Any] = told[1:]
    return values


def _no_cursor() -> DefinitionError:
    text = "after is no page of this list: give it the `next` of the answer before, as it is"
    return DefinitionError(text, code="http.query")
