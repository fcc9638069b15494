"""A lab of small real servers, under the real supervisor.

``python plain_lab.py run …`` is the command line of `deploy.embedded` with the table below;
``python plain_lab.py part NAME …`` is one of the processes in the table.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from deploy.embedded.__main__ import main
from deploy.embedded.children import Process, StopOrder
from deploy.embedded.processes import Site
from deploy.embedded.stages import Stage

HERE = Path(__file__).resolve()


def processes(site: Site) -> list[Process]:
    """Web, an edge host with a child of its own, and one that does not listen to signals."""
    data = str(site.layout.data)
    return [
        _part("web", str(site.port)),
        _part("deaf", data),
        Process(
            "edge-host",
            (sys.executable, str(HERE), "part", "edge-host", data),
            stop_order=StopOrder.EDGE_HOST,
            after_web=True,
        ),
    ]


def stages(site: Site) -> list[Stage]:
    """Count in a file how often it was asked, and seed one user."""
    argv = (sys.executable, str(HERE), "part", "stage", str(site.layout.data))
    return [Stage("Lab and users", argv, "one", (site.layout.passwords,))]


def _part(name: str, *arguments: str) -> Process:
    return Process(name, (sys.executable, str(HERE), "part", name, *arguments))


class _Page(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        """Tell the process and its environment, or end the process as a fault would."""
        if self.path == "/die":
            os._exit(7)
        body = json.dumps({"pid": os.getpid(), "environment": dict(os.environ)}).encode()
        self.send_response(200)
        self.end_headers()
        self.wfile.write(body)


def _web(port: str) -> None:
    HTTPServer(("127.0.0.1", int(port)), _Page).serve_forever()


def _edge_host(data: str) -> None:
    """Have a worker with a session of its own and nothing in its environment."""
    program = "import threading; threading.Event().wait()"
    worker = subprocess.Popen([sys.executable, "-c", program], env={}, start_new_session=True)
    with (Path(data) / "workers").open("a", encoding="ascii") as stream:
        stream.write(f"{os.getpid()} {worker.pid}\n")
    worker.wait()


def _deaf(data: str) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    (Path(data) / "deaf").write_text(str(os.getpid()), encoding="ascii")
    threading.Event().wait()


def _stage(data: str) -> None:
    users = [
        {"username": "ada", "role": "chemist", "password": "first-secret", "changed": False},
        {"username": "eve", "role": "viewer", "password": "old-secret", "changed": True},
    ]
    (Path(data) / "passwords.json").write_text(json.dumps(users), encoding="utf-8")
    with (Path(data) / "stage-runs").open("a", encoding="ascii") as stream:
        stream.write("run\n")


PARTS = {"web": _web, "edge-host": _edge_host, "deaf": _deaf, "stage": _stage}

if __name__ == "__main__":
    if sys.argv[1] == "part":
        PARTS[sys.argv[2]](*sys.argv[3:])
    else:
        sys.exit(main(process_table=processes, stage_table=stages))
