"""What a step costs where others run them: `python others.py NAME COUNT`, in `.cache/peers`.

Each peer runs COUNT steps that do nothing, one after the other, in its own usual way and with
what it writes down by itself. Prints JSON: the times at which the steps were called, s, and
the processor time of this process between the first and the last call, s.

Imports nothing of this project: the peers have an environment of their own.
"""

import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

calls_s: list[float] = []
processor_s: list[float] = []


def step() -> None:
    """Do nothing, and note when."""
    calls_s.append(time.perf_counter())
    processor_s.append(time.process_time())


class Timer:
    """A device of ivoryos: every public method is an action."""

    def step(self) -> None:
        """Do nothing."""
        step()


timer = Timer()


def bluesky(count: int) -> None:
    """Run a plan of the RunEngine: each step triggers nothing and saves one event."""
    from bluesky import RunEngine
    from bluesky import plan_stubs as stubs
    from bluesky.preprocessors import run_wrapper

    class Detector:
        name, parent = "timer", None

        def read(self) -> dict[str, Any]:
            step()
            return {"timer": {"value": len(calls_s), "timestamp": time.time()}}

        def describe(self) -> dict[str, Any]:
            return {"timer": {"source": "timer", "dtype": "number", "shape": []}}

        def read_configuration(self) -> dict[str, Any]:
            return {}

        def describe_configuration(self) -> dict[str, Any]:
            return {}

    detector = Detector()

    def plan() -> Iterator[Any]:
        for _ in range(count):
            yield from stubs.checkpoint()
            yield from stubs.create()
            yield from stubs.read(detector)
            yield from stubs.save()

    with Path("documents.jsonl").open("w", encoding="utf-8") as kept:
        engine = RunEngine(context_managers=[])
        engine.subscribe(lambda name, document: kept.write(json.dumps([name, document]) + "\n"))
        engine(run_wrapper(plan()))


def ivoryos(count: int) -> None:
    """Run a script of the canvas by its own runner, with its SQLite database."""
    from ivoryos.app import create_app
    from ivoryos.config import ProductionConfig
    from ivoryos.runtime.runner_runtime import global_state
    from ivoryos.runtime.script_runner import ScriptRunner
    from ivoryos.script.editor import ScriptEditor
    from ivoryos.script.models import Script

    app = create_app(config_class=ProductionConfig)
    app.config["LOGGERS"] = None
    with app.app_context():
        global_state.deck = sys.modules[__name__]
        script = Script(author="benchmark", name="steps", deck="deck")
        editor = ScriptEditor(script)
        for _ in range(count):
            editor.add_action(
                {
                    "instrument": "deck.timer",
                    "action": "step",
                    "args": {},
                    "arg_types": {},
                    "return": "",
                }
            )
        runner = ScriptRunner()
        thread = runner.run_script(
            script,
            repeat_count=1,
            run_name="steps",
            logger=logging.getLogger("ivoryos"),
            current_app=app,
            output_path=app.config["DATA_FOLDER"],
        )
        thread.join()


def prefect(count: int) -> None:
    """Run a flow of tasks against the server that Prefect starts for it, with its database."""
    from prefect import flow, task

    one = task(step, name="step")

    def steps() -> None:
        for _ in range(count):
            one()

    flow(steps, name="steps")()


PEERS: dict[str, Callable[[int], None]] = {
    "bluesky": bluesky,
    "ivoryos": ivoryos,
    "prefect": prefect,
}


def main() -> None:
    """Run one peer in the present folder."""
    os.environ["PREFECT_HOME"] = str(Path("prefect").resolve())
    os.environ["PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS"] = "300"
    os.environ["DO_NOT_TRACK"] = "1"
    name, count = sys.argv[1], int(sys.argv[2])
    PEERS[name](count)
    if len(calls_s) != count:
        sys.exit(f"{name} called {len(calls_s)} of {count} steps")
    found = {"calls_s": calls_s, "processor_s": processor_s[-1] - processor_s[0]}
    sys.stdout.write("\n" + json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
