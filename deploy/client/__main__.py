"""Write `labweb_client/generated` from `frontend/openapi.json`.

python -m deploy.client

The types are made by a library; the operations, one method each, are written here, twice: for
programs that wait, and for those that are asynchronous.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = ROOT / "frontend" / "openapi.json"
TARGET = ROOT / "labweb_client" / "generated"
METHODS = ("get", "post", "put", "patch", "delete")

_MODELS = [
    "--input-file-type",
    "openapi",
    "--output-model-type",
    "msgspec.Struct",
    "--target-python-version",
    "3.11",
    "--use-union-operator",
    "--use-standard-collections",
    "--disable-timestamp",
    "--use-schema-description",
    "--collapse-root-models",
    "--enum-field-as-literal",
    "all",
    "--use-msgspec-tagged-unions",
    "--formatters",
    "ruff-format",
]
_PREFIX = "/api/v1/"
_TYPES = {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}

_HEAD = '''"""Every operation of the interface; made by `make generate` from its schema."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, TypeVar

from labweb_client.generated import models
from labweb_client.sending import ApiCall, Files

A = TypeVar("A")
'''
_CLASS = '''

class {name}(ABC):
    """{about}"""

    @abstractmethod
    {async_}def call(self, call: ApiCall, answer: type[A]) -> A:
        """Send a call until it is answered."""

    @abstractmethod
    {async_}def call_either(self, call: ApiCall, answers: Mapping[int, type[Any]]) -> Any:
        """Send a call until it is answered; the status says with which struct."""
'''


@dataclass(frozen=True, kw_only=True)
class ApiOperation:
    """One method of one address."""

    method: str
    path: str
    about: str
    answers: Mapping[int, str]
    """Status → type of the answer, as Python has it."""

    body: str = ""
    """Type of the body; empty: there is none."""

    is_form: bool = False
    path_names: tuple[str, ...] = ()
    query: Mapping[str, str] = field(default_factory=dict)
    """Parameter of the address → its type."""

    documents: Mapping[str, str] = field(default_factory=dict)
    """Parameter → value with which the answer is a document in a format of its own."""

    is_document: bool = False
    """That document is asked for."""

    @property
    def name(self) -> str:
        """Return the name of the method: the verb, and the path without its parameters."""
        words = self.path.removeprefix(_PREFIX).split("/")
        named = []
        for place, word in enumerate(words):
            following = words[place + 1] if place + 1 < len(words) else ""
            if not word.startswith("{"):
                named.append(_one_of(word) if following.startswith("{") else word)
        named += ["document"] if self.is_document else []
        return f"{self.method}_{'_'.join(named)}".replace("-", "_")


def _one_of(word: str) -> str:
    """Return what one thing of a list is called."""
    return word.removesuffix("s") if word.endswith("s") else f"{word}_one"


def read_operations(schema: Mapping[str, Any]) -> list[ApiOperation]:
    """Return the operations of a schema by their address."""
    found = [
        _operation(path, method, item[method])
        for path, item in sorted(schema["paths"].items())
        for method in METHODS
        if method in item and path.startswith(_PREFIX)
    ]
    found += [
        replace(one, is_document=True, answers=dict.fromkeys(one.answers, "bytes"))
        for one in found
        if one.documents
    ]
    counted = Counter(operation.name for operation in found)
    doubled = sorted(name for name, count in counted.items() if count > 1)
    if doubled:
        raise ValueError(f"operations of one name: {', '.join(doubled)}")
    return found


def _operation(path: str, method: str, told: Mapping[str, Any]) -> ApiOperation:
    content = told.get("requestBody", {}).get("content", {})
    body = content.get("application/json", {}).get("schema")
    documents = told.get("x-documents", {})
    return ApiOperation(
        method=method,
        path=path,
        about=_first_line(told.get("description", "")),
        answers=_answers(told["responses"]),
        body="" if body is None else _type_of(body),
        is_form="multipart/form-data" in content,
        path_names=tuple(re.findall(r"{(\w+)}", path)),
        query={
            one["name"]: _type_of(one["schema"]) + ("" if one.get("required") else " | None = None")
            for one in told.get("parameters", ())
            if one["in"] == "query" and one["name"] not in documents
        },
        documents=documents,
    )


def _first_line(text: str) -> str:
    line = text.strip().split("\n\n", maxsplit=1)[0]
    return " ".join(line.split()).replace("\\", "\\\\").replace('"""', "'''") or "Send the call."


def _answers(responses: Mapping[str, Any]) -> dict[int, str]:
    found = {}
    for status, response in responses.items():
        if status.startswith("2"):
            content = response.get("content", {})
            schema = content.get("application/json", {}).get("schema", {})
            schema = schema.get("anyOf", [schema])[0]
            is_file = bool(content) and "$ref" not in schema
            found[int(status)] = "bytes" if is_file else _type_of(schema) if schema else "None"
    return found


def _type_of(schema: Mapping[str, Any]) -> str:
    if "$ref" in schema:
        return "models." + str(schema["$ref"]).rsplit("/", 1)[-1]
    if schema.get("type") == "array":
        return f"list[{_type_of(schema['items'])}]"
    return _TYPES.get(str(schema.get("type")), "object")


def write_operations(operations: list[ApiOperation]) -> str:
    """Return the module with every operation, for both kinds of programs."""
    parts = [_HEAD]
    for is_async in (False, True):
        name = "AsyncOperations" if is_async else "Operations"
        about = "Each operation, to be awaited." if is_async else "Each operation."
        parts.append(_CLASS.format(name=name, about=about, async_="async " if is_async else ""))
        parts += [text for one in operations for text in _method(one, is_async=is_async)]
    return "".join(parts)


def _method(one: ApiOperation, *, is_async: bool) -> Iterator[str]:
    taken = ["self", *(f"{name}: str" for name in one.path_names)]
    taken += [f"body: {one.body}"] if one.body else []
    taken += ["form: Mapping[str, str]", "files: Files"] if one.is_form else []
    named = [f"{name}: {kind}" for name, kind in one.query.items()]
    named += ["key: str | None = None"] if one.method != "get" else []
    taken += ["*", *named] if named else []
    path = one.path.removeprefix(_PREFIX.rstrip("/"))
    given = [
        f"method={one.method.upper()!r}",
        f"path=f{path!r}" if one.path_names else f"path={path!r}",
    ]
    given += ["body=body"] if one.body else []
    given += ["form=form", "files=files"] if one.is_form else []
    given += ["key=key"] if one.method != "get" else []
    query = [f"{name!r}: {name}" for name in one.query]
    query += [f"{name!r}: {word!r}" for name, word in one.documents.items() if one.is_document]
    given += [f"query={{{', '.join(query)}}}"] if query else []
    kinds = ["type(None)" if kind == "None" else kind for kind in one.answers.values()]
    pairs = zip(one.answers, kinds, strict=True)
    listed = ", ".join(f"{status}: {kind}" for status, kind in pairs)
    is_one = len(kinds) == 1
    send, wanted = ("call", kinds[0]) if is_one else ("call_either", f"{{{listed}}}")
    returned = " | ".join(dict.fromkeys(one.answers.values()))
    word, wait = ("async ", "await ") if is_async else ("", "")
    yield f"\n    {word}def {one.name}({', '.join(taken)}) -> {returned}:\n"
    yield f'        """{one.about}"""\n'
    yield f"        return {wait}self.{send}(ApiCall({', '.join(given)}), {wanted})\n"


def main() -> int:
    """Write both modules, and format them."""
    TARGET.mkdir(parents=True, exist_ok=True)
    (TARGET / "__init__.py").write_text('"""Made from the schema of the interface."""\n')
    models, operations = TARGET / "models.py", TARGET / "operations.py"
    codegen = [sys.executable, "-m", "datamodel_code_generator", "--input", str(SCHEMA)]
    quiet = {**os.environ, "PYTHONWARNINGS": "ignore"}
    subprocess.run([*codegen, "--output", str(models), *_MODELS], check=True, env=quiet)
    found = read_operations(json.loads(SCHEMA.read_text()))
    operations.write_text(write_operations(found))
    ruff = [sys.executable, "-m", "ruff", "format", "--quiet"]
    subprocess.run([*ruff, str(models), str(operations)], check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
