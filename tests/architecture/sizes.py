"""How long files and functions are."""

from __future__ import annotations

import ast
import re
from pathlib import PurePath

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60

_NOISE = re.compile(
    r"""//[^\n]*|/\*.*?\*/|'(?:\\.|[^'\\\n])*'|"(?:\\.|[^"\\\n])*"|`(?:\\.|[^`\\])*`""", re.DOTALL
)
_OPENS_FUNCTION = re.compile(r"(?:=>|\)\s*(?::[^;{}()]+)?)\s*$")
_OPENS_BLOCK = re.compile(r"\b(?:if|for|while|switch|catch|with)\s*\([^{}]*\)\s*$")


def is_exempt(path: PurePath) -> bool:
    """Say whether nobody writes or reads this file line by line."""
    generated = ".gen." in path.name or path.name.endswith("_pb2.py") or "generated" in path.parts
    return generated or "migrations" in path.parts or path.name.endswith("_table.py")


def long_files(name: str, text: str) -> list[str]:
    """Report a file that does not fit in the head."""
    lines = len(text.splitlines())
    return [f"{name}: {lines} lines"] if lines > MAX_FILE_LINES else []


def long_functions(name: str, text: str) -> list[str]:
    """Report each function of a Python or TypeScript file that is too long."""
    spans = _python_spans(text) if name.endswith(".py") else _typescript_spans(text)
    return [
        f"{name}:{first} {label}: {last - first + 1} lines"
        for label, first, last in spans
        if last - first + 1 > MAX_FUNCTION_LINES
    ]


def _python_spans(text: str) -> list[tuple[str, int, int]]:
    return [
        (node.name, node.lineno, node.end_lineno or node.lineno)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def _typescript_spans(text: str) -> list[tuple[str, int, int]]:
    """Pair braces, and keep the pairs that hold a function's body."""
    code = _NOISE.sub(lambda found: "\n" * found.group().count("\n"), text)
    spans: list[tuple[str, int, int]] = []
    open_braces: list[tuple[bool, int]] = []
    line = 1
    for position, sign in enumerate(code):
        line += sign == "\n"
        if sign == "{":
            before = code[max(0, position - 200) : position]
            is_body = bool(_OPENS_FUNCTION.search(before)) and not _OPENS_BLOCK.search(before)
            open_braces.append((is_body, line))
        elif sign == "}" and open_braces:
            is_body, first = open_braces.pop()
            if is_body:
                spans.append(("function", first, line))
    return spans
