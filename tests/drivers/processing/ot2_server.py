"""What the document of the robot server says of runs and commands, in a few lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Server:
    """What the document says of runs and commands, in a few lines."""

    def __init__(self) -> None:
        self.model = "OT-2 Standard"
        self.runs: list[dict[str, Any]] = []
        self.commands: list[dict[str, Any]] = []
        self.results: dict[str, dict[str, Any]] = {
            "loadPipette": {"pipetteId": "pip-1"},
            "home": {},
            "pickUpTip": {"tipVolume": 300},
        }
        self.errors: dict[str, str] = {}
        self.holds = ""
        """A kind of command that does not end by itself."""

        self.labware: list[dict[str, Any]] = [{"id": "fixedTrash"}]
        self.spoil: Callable[[str, str, bytes], tuple[int, bytes] | None] = lambda *_: (0, b"")
        self.headers: list[str | None] = []

    def kinds(self) -> list[str]:
        return [one["commandType"] for one in self.commands]

    def answer(self, method: str, path: str, body: dict[str, Any]) -> tuple[int, object]:
        words = path.partition("?")[0].strip("/").split("/")
        if words == ["health"]:
            return 200, {"name": "ot", "robot_model": self.model, "api_version": "7.5.0"}
        if words == ["runs"]:
            return self._runs(method)
        run = next((one for one in self.runs if one["id"] == words[1]), None)
        if run is None:
            return 404, {"errors": [{"detail": f"Run {words[1]} was not found."}]}
        if words[2:] == ["actions"]:
            return self._stop(run)
        if words[2:] == ["commands"] and method == "POST":
            return self._command(run, body["data"])
        found = [one for one in self.commands if one["run"] == run["id"]]
        if words[2:] == ["commands"]:
            return 200, {"data": found, "meta": {"cursor": 0, "totalLength": len(found)}}
        return 200, {"data": next(one for one in found if one["id"] == words[3])}

    def _runs(self, method: str) -> tuple[int, object]:
        if method == "GET":
            return 200, {"data": self.runs}
        for run in self.runs:
            run["current"] = False
        made = {"id": f"run-{len(self.runs)}", "status": "idle", "current": True}
        self.runs.append({**made, "labware": self.labware})
        return 201, {"data": self.runs[-1]}

    def _stop(self, run: dict[str, Any]) -> tuple[int, object]:
        if run["status"] == "stopped":
            return 409, {"errors": [{"detail": "stopped"}]}
        run["status"] = "stopped"
        for one in self.commands:
            if one["status"] == "running":
                one |= {"status": "failed", "error": {"errorType": "RunStoppedError"}}
        return 201, {"data": {"id": "act-1", "actionType": "stop"}}

    def _command(self, run: dict[str, Any], sent: dict[str, Any]) -> tuple[int, object]:
        if run["status"] == "stopped":
            return 409, {"errors": [{"detail": "The run has already stopped."}]}
        kind = sent["commandType"]
        result = self.results.get(kind, {})
        if kind in {"aspirate", "dispense"}:
            result = {"volume": sent["params"]["volume"]}
        if kind == "loadLabware":
            result = {"labwareId": f"lab-{sent['params']['location']['slotName']}"}
        done: dict[str, Any] = {"status": "succeeded", "result": result}
        if kind in self.errors:
            done = {"status": "failed", "error": {"errorType": self.errors[kind], "detail": "no"}}
        if kind == self.holds:
            done = {"status": "running"}
        self.commands.append({**sent, "id": f"c-{len(self.commands)}", "run": run["id"], **done})
        if kind.startswith("load"):
            return 201, {"data": self.commands[-1]}
        return 201, {"data": {**self.commands[-1], "status": "queued", "error": None}}
