"""A driver travels, and is approved, with what it shares; two versions do not meet."""

from __future__ import annotations

import sys

import pytest

from drivers.base import Driver
from drivers.catalog.bundle import gather
from drivers.catalog.scan import inspect_bundle, inspect_file, scan_text
from drivers.catalog.source import path_of, read_source
from drivers.load import load_bundle
from drivers.transports.virtual import VirtualTransport
from labweb.domain.enrollment.driver_bundle import decode_bundle, digest_of, encode_bundle
from labweb.domain.errors import ConformanceError
from tests.drivers.conftest import Play

PUMP = "drivers.connectors.runze_sy03b"
TIMER = "drivers.virtual.timer"


def bundle(module: str) -> dict[str, str]:
    return gather(read_source(path_of(module)))


def test_a_bundle_holds_the_driver_and_every_shared_module_it_reaches() -> None:
    assert set(bundle(TIMER)) == {TIMER}
    shared = {"drivers.connectors._dt", "drivers.connectors._motion", "drivers.waiting"}
    assert set(bundle(PUMP)) - {PUMP} <= shared | {"drivers.connectors._runze"}
    assert "drivers.connectors._dt" in bundle(PUMP)


def test_the_digest_changes_with_one_byte_of_a_shared_module() -> None:
    modules = bundle(PUMP)
    assert inspect_file(path_of(PUMP)).digest == digest_of(modules)
    changed = modules | {"drivers.connectors._dt": modules["drivers.connectors._dt"] + "\n"}
    assert inspect_bundle(changed).digest == digest_of(changed) != digest_of(modules)


def test_only_the_bytes_of_the_digest_are_a_bundle() -> None:
    data = encode_bundle(bundle(TIMER))
    digest = digest_of(bundle(TIMER))
    assert decode_bundle(data, digest) == bundle(TIMER)
    with pytest.raises(ConformanceError) as refusal:
        decode_bundle(data + b" ", digest)
    assert refusal.value.code == "driver.digest"


@pytest.mark.parametrize(
    "modules",
    [
        {},
        {"drivers.connectors._dt": ""},
        {TIMER: "", PUMP: ""},
        {TIMER: "", "os": ""},
        {TIMER: "", "drivers.base": ""},
        {"drivers.virtual.../../timer": ""},
    ],
)
def test_a_bundle_of_anything_but_one_driver_and_what_it_shares_is_refused(
    modules: dict[str, str],
) -> None:
    with pytest.raises(ConformanceError) as refusal:
        decode_bundle(encode_bundle(modules), digest_of(modules))
    assert refusal.value.code == "driver.bundle"


def made(text: str, name: str = TIMER) -> Driver[object, object]:  # type: ignore[type-var]
    return load_bundle({name: text}, "HostTimer", VirtualTransport("virtual:t"), {})


def test_two_versions_run_beside_each_other_and_beside_the_installed_one() -> None:
    text = bundle(TIMER)[TIMER]
    first = made(text)
    second = made(text.replace("class Config", "VERSION_COUNT = 2\n\n\nclass Config"))
    assert type(first) is not type(second)
    assert not hasattr(sys.modules[type(first).__module__], "VERSION_COUNT")
    assert sys.modules[type(second).__module__].VERSION_COUNT == 2
    installed = sys.modules.get(TIMER)
    assert installed is None or not hasattr(installed, "VERSION_COUNT")


def test_a_driver_of_a_bundle_uses_the_shared_modules_of_the_bundle(play: Play) -> None:
    modules = bundle(PUMP)
    name = "drivers.connectors._dt"
    modules[name] += "\nMARK = 'of the bundle'\n"
    pump = load_bundle(modules, "RunzeSy03b", play(text=""), {"syringe_ul": 5000.0})
    shared = sys.modules[type(pump._pump).__module__]  # type: ignore[attr-defined]
    assert shared.MARK == "of the bundle"
    assert not hasattr(sys.modules.get(name), "MARK")


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("class HostTimer", "NOTHING = 1 // 0\n\n\nclass HostTimer", "driver.import"),
        (
            "import msgspec\n",
            "import msgspec\nfrom labweb.domain.errors import Nope\n",
            "driver.import",
        ),
        (
            "    def identify",
            "    def __init__(self, *args):\n        raise KeyError(1)\n\n    def identify",
            "driver.build",
        ),
        ("@action(timeout_s", "@action(time_s", "driver.conformance"),
    ],
)
def test_a_driver_that_cannot_be_made_is_refused_with_the_reason(
    old: str, new: str, code: str
) -> None:
    with pytest.raises(ConformanceError) as refusal:
        made(bundle(TIMER)[TIMER].replace(old, new))
    assert refusal.value.code == code


@pytest.mark.parametrize(
    ("line", "rule"),
    [
        ("import os", "drv009"),
        ("from subprocess import run", "drv009"),
        ("from drivers.transports.tcp import socket", "drv009"),
        ("import numpy", "drv011"),
        ("import random", "drv011"),
        ("from drivers.load import load_driver", "drv011"),
        ("from drivers.virtual.timer import HostTimer", "drv011"),
        ("from drivers.connectors._nowhere import x", "drv011"),
        ("from drivers.connectors import _dt", "drv011"),
        ("from labweb.enrollment import models", "drv011"),
        ("from . import timer", "drv011"),
        ("from math import *", "drv011"),
        ("import drivers.base", "drv011"),
    ],
)
def test_each_import_that_a_driver_may_not_make_is_listed_with_its_line(
    line: str, rule: str
) -> None:
    text = bundle(TIMER)[TIMER] + f"\n\ndef late() -> None:\n    {line}\n"
    (spec,) = scan_text(TIMER, text.encode()).drivers
    last = text.count("\n")
    assert [(one.code, one.context["line"]) for one in spec.findings] == [(f"driver.{rule}", last)]
    assert spec.findings[0].subject == f"drivers/virtual/timer.py:{last}"


def test_what_computes_may_be_imported() -> None:
    lines = "from math import floor\nimport struct\nfrom drivers.waiting import once_started\n"
    text = bundle(TIMER)[TIMER].replace("import msgspec\n", f"import msgspec\n{lines}")
    (spec,) = scan_text(TIMER, text.encode()).drivers
    assert not spec.findings


@pytest.mark.parametrize("name", ["timer", "drivers.timer", "drivers.virtual._x", "os.path", ""])
def test_a_driver_needs_a_name_in_one_of_the_classes(name: str) -> None:
    catalog = scan_text(name, b"x = 1\n")
    assert [one.code for one in catalog.findings] == ["driver.no_module"]
