"""The Python client drives a whole lab: its example in the documentation, as it stands there."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from labweb_client import AsyncClient, Client, RefusedError
from labweb_client.generated import models
from tests.system.stack import Stack, running

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with running(tmp_path_factory.mktemp("c") / "data") as found:
        yield found


def a_token(stack: Stack, scope: str) -> str:
    person = stack.client("chemist")
    wanted = {"name": f"script {scope}", "scope": scope, "days": 1}
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
        async with AsyncClient(stack.url, a_token(stack, "submit")) as lab:
            page = await lab.get_workflows()
            chosen = next(row for row in page.workflows if row.name == "Move 5 mL of water")
            whole = await lab.get_workflow(chosen.id)
            heard: set[str] = set()

            async def listen() -> None:
                async for news in lab.follow("runs", "events"):
                    heard.add(news.topic)

            listening = asyncio.create_task(listen())
            await asyncio.sleep(1)
            run = await lab.post_runs(models.StartRun(version_id=whole.versions[0].id))
            ended = await lab.wait_for_run(run.id, timeout_s=120)
            assert not listening.done(), listening.exception()
            listening.cancel()
            return ended.state, heard

    state, heard = asyncio.run(follow())
    assert state == "complete"
    assert "runs" in heard


def test_a_token_that_reads_starts_nothing(stack: Stack) -> None:
    with Client(stack.url, a_token(stack, "read")) as lab:
        chosen = lab.get_workflows().workflows[0]
        with pytest.raises(RefusedError) as refused:
            lab.post_workflows(models.NewWorkflow(name="by a script"))
        assert refused.value.code == "token.scope"
        assert chosen.name
