"""The lock works on any machine, and an edge host gets no Django."""

from __future__ import annotations

import re

import pytest

from tests.architecture.project import ROOT, run_tool

LOCK = (ROOT / "uv.lock").read_text("utf-8")


def packages_of(*extras: str) -> set[str]:
    """List what an installation with these extras brings."""
    chosen = [word for extra in extras for word in ("--extra", extra)]
    done = run_tool(
        "uv", "export", "--frozen", "--offline", "--no-default-groups", "--no-hashes",
        "--no-emit-project", "--no-header", "--no-annotate", *chosen,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return {re.split(r"[=<>;\s\[]", line)[0] for line in done.stdout.splitlines() if line}


def test_the_lock_names_the_public_index_and_no_mirror() -> None:
    hosts = set(re.findall(r'"(?:https?|file)://([^/"]*)', LOCK))
    assert hosts == {"pypi.org", "files.pythonhosted.org"}


def test_the_plain_package_is_the_domain_and_nothing_else() -> None:
    plain = packages_of()
    assert {"pint", "rustworkx", "msgspec"} <= plain
    assert not plain & {"django", "celery", "redis", "websockets", "viser"}


@pytest.mark.parametrize(
    "extra",
    [
        *("edge", "edge-arm", "edge-camera", "edge-opcua", "edge-ros2", "edge-s7", "edge-sila"),
        *("edge-visa", "twin", "embedded"),
    ],
)
def test_only_a_server_gets_django(extra: str) -> None:
    assert "django" not in packages_of(extra)
    assert "django" in packages_of("server")
