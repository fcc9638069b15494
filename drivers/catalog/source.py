"""Driver source, read with bounds: whoever wrote the file may be hostile."""

from __future__ import annotations

import ast
import hashlib
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from labweb.domain.errors import ConformanceError, Finding

PACKAGE = Path(__file__).resolve().parent.parent

MAX_SOURCE_BYTES = 1024 * 1024
"""The longest published driver that is known has 630 KiB; a person wrote all of it."""

MAX_WORDS = 80_000
"""Most words and signs in a text that is sent in: reading it stays below a second. The longest
driver of this package has 4 000."""

MAX_DEPTH = 100
"""Deepest nesting of the syntax tree; hand-written drivers stay below 40."""


_WORD = re.compile(rb"\w+|[^\s\w]")


@dataclass(frozen=True)
class Source:
    """One parsed file."""

    path: Path
    text: str
    digest: str
    """SHA-256 of the bytes as they lie on disk."""

    tree: ast.Module
    nodes: Mapping[type[ast.AST], list[Any]]
    """Every node of the tree by its type: whoever looks for something looks here."""

    module: str = ""
    """Dotted name, "" for a file outside the package."""

    @cached_property
    def comments(self) -> Mapping[int, str]:
        """Return line → comment on it."""
        return _comments(self.text)

    @cached_property
    def imports(self) -> tuple[str, ...]:
        """Return every module that an import statement names, wherever it stands, in order."""
        plain = {alias.name for node in self.find(ast.Import) for alias in node.names}
        others = {"." * node.level + (node.module or "") for node in self.find(ast.ImportFrom)}
        return tuple(sorted(plain | others))

    def find(self, *types: type[ast.AST]) -> Iterator[Any]:
        """Yield the nodes of these types."""
        for kind in types:
            yield from self.nodes.get(kind, ())

    def finding(self, rule: str, line: int, message: str, suggestion: str) -> Finding:
        """Report what breaks a rule, where, and what to change."""
        return Finding(
            f"driver.{rule}",
            message,
            subject=f"{self.path}:{line}",
            context={"file": str(self.path), "line": line, "suggestion": suggestion},
        )


def module_of(path: Path) -> str:
    """Name the module of a file of this package, "" for any other."""
    try:
        inside = path.resolve().relative_to(PACKAGE)
    except ValueError:
        return ""
    return ".".join((PACKAGE.name, *inside.with_suffix("").parts))


def path_of(module: str) -> Path:
    """Return where a module of this package lies, or would lie."""
    return PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py")


def read_source(path: Path) -> Source:
    """Read and parse a file; nothing in it is executed.

    Raises:
        ConformanceError: Too large, not UTF-8, null bytes, a syntax error, or nested too
            deeply. The finding has file and line.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_SOURCE_BYTES + 1)
    except OSError as error:
        raise _refusal(path, "source_unreadable", 1, f"cannot be read: {error}") from error
    return parse_source(path, data, module_of(path))


def check_words(path: Path, data: bytes) -> None:
    """Refuse a text that would take long to read, by the count of its words and signs.

    Raises:
        ConformanceError: It has more than `MAX_WORDS`.
    """
    count = sum(1 for _ in islice(_WORD.finditer(data[:MAX_SOURCE_BYTES]), MAX_WORDS + 1))
    if count > MAX_WORDS:
        raise _refusal(path, "source_too_long", 1, f"has more than {MAX_WORDS} words and signs")


def parse_source(path: Path, data: bytes, module: str = "") -> Source:
    """Parse the bytes of a file that is, or shall be, this module.

    Raises:
        ConformanceError: As `read_source`.
    """
    if len(data) > MAX_SOURCE_BYTES:
        raise _refusal(path, "source_too_large", 1, f"is larger than {MAX_SOURCE_BYTES} bytes")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise _refusal(path, "source_encoding", line, "is not UTF-8") from error
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise _refusal(path, "source_null_byte", line, "holds a null byte")
    tree = _parse(path, text)
    digest = hashlib.sha256(data).hexdigest()
    return Source(path, text, digest, tree, _nodes_of(path, tree), module)


def _parse(path: Path, text: str) -> ast.Module:
    try:
        return ast.parse(text)
    except SyntaxError as error:
        message = f"does not parse: {error.msg}"
        raise _refusal(path, "source_syntax", error.lineno or 1, message) from error
    except (RecursionError, MemoryError) as error:
        raise _refusal(path, "source_too_deep", 1, "is nested too deeply") from error
    except ValueError as error:
        raise _refusal(path, "source_syntax", 1, f"does not parse: {error}") from error


def _nodes_of(path: Path, tree: ast.Module) -> Mapping[type[ast.AST], list[Any]]:
    """Sort the nodes of a tree, level by level; `ast.walk` takes several times as long."""
    found: defaultdict[type[ast.AST], list[Any]] = defaultdict(list)
    level: list[ast.AST] = [tree]
    for _ in range(MAX_DEPTH):
        for node in level:
            found[type(node)].append(node)
        level = _below(level)
        if not level:
            return dict(found)
    line = next((node.lineno for node in level if isinstance(node, ast.expr | ast.stmt)), 1)
    raise _refusal(path, "source_too_deep", line, f"is nested deeper than {MAX_DEPTH} levels")


def _below(level: list[ast.AST]) -> list[ast.AST]:
    found: list[ast.AST] = []
    for node in level:
        values = vars(node)
        for name in node._fields:
            value = values.get(name)
            if type(value) is list:
                found += [item for item in value if isinstance(item, ast.AST)]
            elif isinstance(value, ast.AST) and name != "ctx":
                found.append(value)
    return found


def _comments(text: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    try:
        return {token.start[0]: token.string for token in tokens if token.type == tokenize.COMMENT}
    except (tokenize.TokenError, SyntaxError):
        return {}


def _refusal(path: Path, rule: str, line: int, message: str) -> ConformanceError:
    finding = Finding(
        f"driver.{rule}",
        f"{path.name} {message}",
        subject=f"{path}:{line}",
        context={"file": str(path), "line": line, "suggestion": "send a plain Python module"},
    )
    return ConformanceError(f"{path}:{line}: {finding.message}", findings=[finding])
