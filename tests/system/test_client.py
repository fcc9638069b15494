"""The Python client drives a whole lab: its example in the documentation, as it stands there."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from labweb_client import AsyncLabClient, CallRefusedError, LabClient
from labweb_client.generated import models
from tests.system.stack import Stack, running

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with running(tmp_path_factory.mktemp("c") / "data") as found:
        yield found


def a_token(stack: Stack, scope: str) -> str:
    person = stack.client("chemist")
    wanted = {"name": f"script {uuid4().hex}", "scope": scope, "days": 1}
    return str(person.call("POST", "tokens", wanted)["secret"])


def test_the_example_of_the_documentation_runs(stack: Stack) -> None:
    text = (ROOT / "docs" / "client.md").read_text()
    found = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert found is not None
    variables = {"LABWEB_URL": stack.url, "LABWEB_TOKEN": a_token(stack, "simulate")}
    done = subprocess.run(
        [sys.executable, "-c", found[1]],
        env=os.environ | variables,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "it ended as complete" in done.stdout
    assert "refused: token.not_by_token" in done.stdout
    assert "5.00 mL" in done.stdout, done.stdout


def test_a_program_that_is_asynchronous_follows_a_run(stack: Stack) -> None:
    async def follow() -> tuple[str, set[str]]:
        async with AsyncLabClient(stack.url, a_token(stack, "submit")) as lab:
            page = await lab.get_workflows()
            chosen = next(row for row in page.workflows if row.name == "Move 5 mL of water")
            whole = await lab.get_workflow(chosen.id)
            heard: set[str] = set()
            async with lab.follow("runs", "events") as news:
                run = await lab.post_runs(models.StartRun(version_id=whole.versions[0].id))
                async with asyncio.timeout(120):
                    async for one in news:
                        heard.add(one.topic)
                        if heard == {"runs", "events"}:
                            break
            ended = await lab.wait_for_run(run.id, timeout_s=120)
            return ended.state, heard

    state, heard = asyncio.run(follow())
    assert state == "complete"
    assert heard == {"runs", "events"}


def test_a_token_that_reads_starts_nothing(stack: Stack) -> None:
    with LabClient(stack.url, a_token(stack, "read")) as lab:
        chosen = lab.get_workflows().workflows[0]
        with pytest.raises(CallRefusedError) as refused:
            lab.post_workflows(models.NewWorkflow(name="by a script"))
        assert refused.value.code == "token.scope"
        assert chosen.name


def test_a_stream_says_why_it_is_refused(stack: Stack) -> None:
    token = a_token(stack, "draft")
    with (
        LabClient(stack.url, token) as lab,
        pytest.raises(CallRefusedError) as refused,
        lab.follow("no such topic"),
    ):
        pytest.fail("it was subscribed")
    assert refused.value.code == "feed.unknown_topic"
    with (
        LabClient(stack.url, "labweb_guess") as lab,
        pytest.raises(CallRefusedError) as refused,
        lab.follow("runs"),
    ):
        pytest.fail("it was subscribed")
    assert refused.value.status == 401


def test_provenance_is_read_as_a_graph_and_as_a_document(stack: Stack) -> None:
    with LabClient(stack.url, a_token(stack, "read")) as lab:
        thing = next(row for row in lab.get_resources().resources if row.key == "water")
        assert lab.get_resource_provenance(thing.id).root.endswith(thing.id)
        assert b"prefix" in lab.get_resource_provenance_document(thing.id)
