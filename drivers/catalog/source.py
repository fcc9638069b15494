"""Driver source, read with bounds: whoever wrote the file may be hostile."""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from labweb.domain.errors import ConformanceError, Finding

MAX_SOURCE_BYTES = 256 * 1024
MAX_DEPTH = 100
"""Deepest nesting of the syntax tree; hand-written drivers stay below 40."""


@dataclass(frozen=True, slots=True)
class Source:
    """One parsed file."""

    path: Path
    text: str
    digest: str
    """SHA-256 of the bytes as they lie on disk."""

    tree: ast.Module
    comments: Mapping[int, str]
    """Line → comment on it."""

    def finding(self, rule: str, line: int, message: str, suggestion: str) -> Finding:
        """Report what breaks a rule, where, and what to change."""
        return Finding(
            f"driver.{rule}",
            message,
            subject=f"{self.path}:{line}",
            context={"file": str(self.path), "line": line, "suggestion": suggestion},
        )


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
    if len(data) > MAX_SOURCE_BYTES:
        raise _refusal(path, "source_too_large", 1, f"is larger than {MAX_SOURCE_BYTES} bytes")
    return parse_source(path, data)


def parse_source(path: Path, data: bytes) -> Source:
    """Parse the bytes of a file.

    Raises:
        ConformanceError: As `read_source`.
    """
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
    return Source(path, text, digest, tree, _comments(text))


def _parse(path: Path, text: str) -> ast.Module:
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        message = f"does not parse: {error.msg}"
        raise _refusal(path, "source_syntax", error.lineno or 1, message) from error
    except (RecursionError, MemoryError) as error:
        raise _refusal(path, "source_too_deep", 1, "is nested too deeply") from error
    except ValueError as error:
        raise _refusal(path, "source_syntax", 1, f"does not parse: {error}") from error
    _refuse_depth(path, tree)
    return tree


def _refuse_depth(path: Path, tree: ast.Module) -> None:
    level: list[ast.AST] = [tree]
    for _ in range(MAX_DEPTH):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return
    line = next((node.lineno for node in level if isinstance(node, ast.expr | ast.stmt)), 1)
    raise _refusal(path, "source_too_deep", line, f"is nested deeper than {MAX_DEPTH} levels")


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
