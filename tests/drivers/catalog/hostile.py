"""Driver files that would write a file the moment that anything of them is executed."""

from __future__ import annotations

from pathlib import Path

MIB = 1024 * 1024

HEAD = '''"""A pump.

Protocol: none.
Quality: bronze, a trap.
"""
'''


def traps(canary: Path) -> dict[str, bytes]:
    """Return source by name; each one touches the canary if it is run, and some cannot be read."""
    touch = f"__import__('pathlib').Path({str(canary)!r}).touch()"
    texts = {
        "import side effect": f"{touch}\nclass Pump:\n    def go(self): ...\n",
        "decorator": f"@(lambda cls: {touch})\nclass Pump:\n    def go(self): ...\n",
        "method decorator": f"class Pump:\n    @(lambda f: {touch})\n    def go(self): ...\n",
        "default argument": f"class Pump:\n    def go(self, a={touch}): ...\n",
        "keyword default": f"class Pump:\n    def go(self, *, a={touch}): ...\n",
        "annotation": f"class Pump:\n    def go(self, a: ({touch})) -> ({touch}): ...\n",
        "base class": f"class Pump(({touch}, object)[1]):\n    def go(self): ...\n",
        "metaclass": (
            f"class Meta(type):\n    def __new__(cls, *a):\n        {touch}\n"
            "        return super().__new__(cls, *a)\n"
            "class Pump(metaclass=Meta):\n    def go(self): ...\n"
        ),
        "metaclass keyword": f"class Pump(metaclass=[type, {touch}][0]):\n    def go(self): ...\n",
        "init subclass": (
            f"class Base:\n    def __init_subclass__(cls):\n        {touch}\n"
            "class Pump(Base):\n    def go(self): ...\n"
        ),
        "set name": (
            f"class D:\n    def __set_name__(self, *a):\n        {touch}\n"
            "class Pump:\n    d = D()\n    def go(self): ...\n"
        ),
        "class body": f"class Pump:\n    {touch}\n    def go(self): ...\n",
        "f-string": f'class Pump:\n    a = f"{{{touch}}}"\n    def go(self): ...\n',
        "comprehension": f"a = [{touch} for _ in (1,)]\nclass Pump:\n    def go(self): ...\n",
        "walrus": f"if (a := {touch}): ...\nclass Pump:\n    def go(self): ...\n",
        "assert": f"assert {touch} is None\nclass Pump:\n    def go(self): ...\n",
        "try": f"try:\n    {touch}\nfinally: ...\nclass Pump:\n    def go(self): ...\n",
        "match": f"match {touch}:\n    case _: ...\nclass Pump:\n    def go(self): ...\n",
        "eval": f"eval({touch!r})\nclass Pump:\n    def go(self): ...\n",
        "module getattr": f"def __getattr__(n):\n    {touch}\nclass Pump:\n    def go(self): ...\n",
        "string annotation": f"class Pump:\n    def go(self, a: {touch!r}): ...\n",
        "literal range": (
            f"class Pump:\n    def go(self, a_ul: Annotated[float, Range({touch}, 1)]): ...\n"
        ),
        "coding line": f"# -*- coding: rot13 -*-\n{touch}\nclass Pump:\n    def go(self): ...\n",
        "type comment": f"a = 1  # type: {touch}\n{touch}\nclass Pump:\n    def go(self): ...\n",
    }
    found = {name: (HEAD + text).encode() for name, text in texts.items()}
    return found | _large(touch)


def _large(touch: str) -> dict[str, bytes]:
    """Return what would cost memory or time."""
    pump = "class Pump:\n    def go(self): ...\n"
    many = "".join(f"    def m{i}(self, a_ul: float = 1.0): ...\n" for i in range(20_000))
    return {
        "ten megabytes": f"{touch}\n#{'x' * 10 * MIB}\n{pump}".encode(),
        "a megabyte of names": f"{touch}\na = ({'b,' * (500 * 1024)})\n{pump}".encode()[:MIB],
        "a megabyte of lists": f"{touch}\na = [{'[],' * (300 * 1024)}]\n{pump}".encode(),
        "a megabyte of statements": (f"{touch}\n{pump}" + "a=1\n" * (200 * 1024)).encode(),
        "a megabyte of methods": f"{touch}\nclass Pump:\n{many}".encode()[:MIB],
        "just short enough": f"{touch}\na = [{'[],' * 26_000}]\n{pump}".encode(),
        "just few enough": f"{touch}\nclass Pump:\n{many}".encode()[:180_000] + b"\n",
        "a megabyte of comment": f"{touch}\n{pump}#{'x' * (900 * 1024)}".encode(),
        "a megabyte of imports": f"{touch}\n{pump}{'import os' + chr(10)}".encode() * 20_000,
        "one long string": f"{touch}\na = '{'x' * (1000 * 1024)}'\n{pump}".encode(),
        "one long number": f"{touch}\na = {'9' * (900 * 1024)}\n{pump}".encode(),
        "brackets": f"{touch}\na = {'(' * 100_000}{')' * 100_000}\n{pump}".encode(),
        "signs": f"{touch}\na = {'-' * 400_000}1\n{pump}".encode(),
        "attributes": f"{touch}\na = b{'.a' * 400_000}\n{pump}".encode(),
        "blocks": (touch + "\n" + "".join(" " * i + "if 1:\n" for i in range(1400))).encode(),
        "f-strings within": f"{touch}\na = {'f' * 1}'{'{' * 5000}1{'}' * 5000}'\n{pump}".encode(),
        "null byte": f"{touch}\na = '\0'\n{pump}".encode(),
        "no utf-8": f"{touch}\na = '".encode() + b"\xff\xfe'\n" + pump.encode(),
        "utf-16": f"{touch}\n{pump}".encode("utf-16"),
        "byte order mark": b"\xef\xbb\xbf" + f"{touch}\n{pump}".encode(),
        "form feeds": (f"{touch}\n" + "\f\n" * 400_000 + pump).encode(),
        "continuations": f"{touch}\na = 1{'+' + chr(92) + chr(10)}".encode() + b"\\\n" * 400_000,
        "empty": b"",
    }
