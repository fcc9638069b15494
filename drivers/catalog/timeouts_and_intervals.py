"""What the marks of a driver's actions and statuses say: rule DRV004, in the text alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from drivers.catalog.annotations import as_number, last_name, literal
from drivers.catalog.inspect import DriverClass, Function, mark_of
from drivers.catalog.source import Source
from labweb.domain.errors import Finding


def timeouts(driver: DriverClass) -> Iterator[Finding]:
    """List each action without a timeout, and each status that does not say how often to ask."""
    for method in driver.actions.values():
        if not _is_positive((mark_of(method, "action") or {}).get("timeout_s")):
            yield driver.source.finding(
                "drv004",
                method.lineno,
                f"action {method.name} has no timeout_s, written as a positive number",
                "@action(timeout_s=60.0)",
            )
    for method in driver.statuses.values():
        if not _is_positive((mark_of(method, "status") or {}).get("every_s")):
            yield driver.source.finding(
                "drv004",
                method.lineno,
                f"status {method.name} does not say how often to ask",
                "@status(every_s=1.0)",
            )


def marks(driver: DriverClass) -> Iterator[Finding]:
    """List what a mark says and nobody can read: left out, a hazard is seen by no policy."""
    for name, methods in (("action", driver.actions), ("status", driver.statuses)):
        for method in methods.values():
            for mark in method.decorator_list:
                if last_name(mark) == name and isinstance(mark, ast.Call):
                    yield from _mark(driver.source, method, mark)


def _mark(source: Source, method: Function, mark: ast.Call) -> Iterator[Finding]:
    for given in mark.args:
        text = f"{method.name}: {ast.unparse(given)[:80]} has no name"
        yield source.finding("drv004", given.lineno, text, "timeout_s=60.0")
    for word in mark.keywords:
        is_known, value = literal(word.value)
        told = ast.unparse(word)[:80]
        if word.arg is None or not is_known:
            text = f"{method.name}: {told} cannot be read in the text"
            yield source.finding("drv004", word.value.lineno, text, "write the value itself")
        elif word.arg in _CHOICES and value not in _CHOICES[word.arg]:
            instead = f"{word.arg} is one of {', '.join(_CHOICES[word.arg])}"
            text = f"{method.name}: {told} is none that there is"
            yield source.finding("drv004", word.value.lineno, text, instead)
        elif word.arg == "hazards" and not _is_list_of_texts(value):
            text = f"{method.name}: {told} is no list of texts"
            yield source.finding("drv004", word.value.lineno, text, 'hazards=("hot",)')


_CHOICES = {"recovery": ("R0", "R1", "R2", "R3"), "operation": ("read", "update", "transfer")}


def _is_list_of_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)


def _is_positive(value: object) -> bool:
    return (as_number(value) or 0.0) > 0.0
