"""A syringe pump on TCP that counts, outside the system under test, what it was made to do.

Run as `python pump_server.py LOGFILE`: prints its port, appends a line to LOGFILE for each
plunger move. A second pump has address 2 of the same line, and writes `2` before its moves.
Commands on standard input are for the first one: `mute` (no more answers), `mute_after_move`,
`talk`, `slow FACTOR`, `unstoppable` (a stroke goes on whatever it is told).
"""

from __future__ import annotations

import re
import socket
import sys
import threading
import time
from pathlib import Path


class Pump:
    def __init__(self, log: Path, mark: str = "") -> None:
        self.log = log
        self.mark = mark
        self.position = 0.0
        self.target = 0
        self.speed = 1000.0
        self.moved_at_s = time.monotonic()
        self.port = 1
        self.is_mute = False
        self.is_shy = False
        self.is_unstoppable = False
        self.factor = 1.0
        self.lock = threading.Lock()

    def settle(self) -> None:
        now_s = time.monotonic()
        reach = (now_s - self.moved_at_s) * self.speed / self.factor
        self.moved_at_s = now_s
        left = self.target - self.position
        self.position += max(-reach, min(reach, left))

    def answer(self, request: str) -> bytes:
        with self.lock:
            self.settle()
            data = self.obey(request)
            is_idle = abs(self.target - self.position) < 0.5
            status = bytes([0x40 | (0x20 if is_idle else 0)])
            return b"/0" + status + data.encode() + b"\x03\r\n"

    def obey(self, request: str) -> str:
        simple = {"?19": "1", "?23": "TEST 1.0", "?6": str(self.port), "Q": ""}
        if request in simple:
            return simple[request]
        if request == "?":
            return str(round(self.position))
        if request == "TR":
            if not self.is_unstoppable:
                self.target = round(self.position)
            return ""
        if found := re.fullmatch(r"I(\d+)R", request):
            self.port = int(found[1])
            return ""
        if found := re.fullmatch(r"V(\d+)A(\d+)R", request):
            self.speed, self.target = float(found[1]), int(found[2])
            with self.log.open("a") as stream:
                stream.write(f"{self.mark}A{self.target}\n")
            self.is_mute = self.is_shy
            return ""
        raise ValueError(request)


def serve(pumps: dict[str, Pump], server: socket.socket) -> None:
    while True:
        client, _ = server.accept()
        threading.Thread(target=talk, args=(pumps, client), daemon=True).start()


def talk(pumps: dict[str, Pump], client: socket.socket) -> None:
    waiting = b""
    while data := client.recv(4096):
        waiting += data
        while b"\r" in waiting:
            line, _, waiting = waiting.partition(b"\r")
            pump = pumps[line[1:2].decode()]
            reply = pump.answer(line[2:].decode())
            if not pump.is_mute:
                client.sendall(reply)


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> None:
    pump = Pump(Path(sys.argv[1]))
    pumps = {"1": pump, "2": Pump(pump.log, "2")}
    server = socket.create_server(("127.0.0.1", 0))
    say(str(server.getsockname()[1]))
    threading.Thread(target=serve, args=(pumps, server), daemon=True).start()
    for line in sys.stdin:
        word, _, rest = line.strip().partition(" ")
        if word == "slow":
            pump.factor = float(rest)
        elif word == "unstoppable":
            pump.is_unstoppable = True
        elif word == "mute_after_move":
            pump.is_shy = True
        else:
            pump.is_mute = word == "mute"
        say("ok")


if __name__ == "__main__":
    main()
