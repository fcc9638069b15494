"""What the person at the terminal sees."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import TextIO

from deploy.embedded.layout import read_json
from deploy.embedded.processes import Site

BROWSER_MARK = "LABWEB_BROWSER"
"""Environment variable of a browser that we opened: it outlives the lab."""


class Console:
    """Plain lines, each flushed; on a terminal a stage shows before it is over."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """Write to a stream, by default standard output."""
        self._stream = stream or sys.stdout
        self._is_terminal = self._stream.isatty()
        self._open_line = ""

    def line(self, text: str) -> None:
        """Write one line."""
        if self._open_line:
            self._write("\n")
            self._open_line = ""
        self._write(f"{text}\n")

    @contextmanager
    def stage(self, name: str, done: str = "ready") -> Iterator[None]:
        """Write a stage's line with the time it took; one that was broken off says so."""
        began = monotonic()
        self._open_line = f"{name} … "
        if self._is_terminal:
            self._write(self._open_line)
        word = "broken off after"
        try:
            yield
            word = done
        finally:
            start = "" if self._is_terminal and self._open_line else f"{name} … "
            self._open_line = ""
            self._write(f"{start}{word} {monotonic() - began:.1f} s\n")

    def box(self, lines: Sequence[str]) -> None:
        """Write lines that belong together, framed on a terminal."""
        if not self._is_terminal:
            for text in lines:
                self.line(text)
            return
        width = max(len(text) for text in lines)
        self.line(f"╭{'─' * (width + 2)}╮")
        for text in lines:
            self.line(f"│ {text:<{width}} │")
        self.line(f"╰{'─' * (width + 2)}╯")

    def open_browser(self, url: str) -> None:
        """Open the page where a person is sitting: at a terminal with a display."""
        has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if not (self._is_terminal and has_display):
            return
        subprocess.Popen(
            [sys.executable, "-m", "webbrowser", url],
            env=os.environ | {BROWSER_MARK: "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (BrokenPipeError, OSError):
            # The terminal or the pipe is gone; the lab goes on, and its logs are kept.
            return


def welcome(site: Site) -> list[str]:
    """Say where the lab is, who may enter, and what is simulated."""
    lines = [f"labweb     {site.url}", *_accounts(site), ""]
    pace = "real time" if site.speed == 1 else f"{site.speed:g} times real time"
    lines.append(f"Simulated  every instrument, at {pace}")
    if site.edge is not None:
        lines.append(f"Edge hosts {site.edge}, by a join token")
    lines.append(f"Data       {site.layout.data}")
    lines.append("Ctrl-C stops everything")
    return lines


def _accounts(site: Site) -> list[str]:
    users = read_json(site.layout.passwords)
    if not isinstance(users, list):
        return [f"Users      {site.layout.passwords} is missing or not a list of users"]
    try:
        fresh = [user for user in users if not user["changed"]]
        rows = [f"{user['username']}  {user['password']}  ({user['role']})" for user in fresh]
    except (KeyError, TypeError):
        return [f"Users      {site.layout.passwords} is not a list of users"]
    if not rows:
        return ["Users      every seeded password has been changed"]
    return [f"{'Users' if index == 0 else '':<10} {row}" for index, row in enumerate(rows)]
