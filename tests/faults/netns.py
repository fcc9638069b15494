"""Network namespaces: hosts that are cut off for good, as by a cable that was pulled.

A bridge in the middle, one namespace for each party, one cable to each. Whether this machine
permits it is asked by doing it.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from secrets import token_hex

CLONE_NEWNET = 0x40000000


class NotPermittedError(Exception):
    """This machine lets nobody make a namespace here; the message says what it said."""


def ip(*words: str) -> None:
    """Run ip(8).

    Raises:
        NotPermittedError: It is missing, or refused.
    """
    program = shutil.which("ip", path="/usr/sbin:/sbin:/usr/bin:/bin")
    if program is None:
        raise NotPermittedError("ip(8) of iproute2 is not installed")
    done = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise NotPermittedError(f"ip {' '.join(words)}: {done.stderr.strip()}")


class Net:
    """Some parties on one switch, each in a namespace of its own."""

    def __init__(self, tag: str, names: list[str]) -> None:
        self.tag = tag
        self.names = names

    def namespace(self, name: str) -> str:
        """Name a party's namespace for ip(8)."""
        return f"{self.tag}-{name}"

    def address(self, name: str) -> str:
        """Give a party's address."""
        return f"10.77.0.{self.names.index(name) + 1}"

    def cable(self, name: str) -> str:
        """Name the switch's end of a party's cable; a kernel's names are short."""
        return f"{self.tag}{self.names.index(name)}"

    def pull(self, name: str) -> None:
        """Pull a party's cable out: packets are lost both ways, and nobody is told."""
        ip("-n", self.namespace("switch"), "link", "set", self.cable(name), "down")

    def plug(self, name: str) -> None:
        """Plug it in again."""
        ip("-n", self.namespace("switch"), "link", "set", self.cable(name), "up")

    def enter(self, name: str) -> None:
        """Move this process's thread into a party's namespace, for good.

        Source:
            setns(2).
        """
        handle = os.open(f"/run/netns/{self.namespace(name)}", os.O_RDONLY)
        try:
            libc = ctypes.CDLL(None, use_errno=True)
            if libc.setns(handle, CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")
        finally:
            os.close(handle)

    def command(self, name: str, *argv: str) -> list[str]:
        """Give a command that runs in a party's namespace."""
        return ["ip", "netns", "exec", self.namespace(name), *argv]


@contextmanager
def a_net(names: list[str]) -> Iterator[Net]:
    """Make the namespaces and the cables, and remove them after.

    Raises:
        NotPermittedError: This machine does not let us.
    """
    net = Net(f"lw{token_hex(3)}", names)
    with ExitStack() as stack:
        for name in ["switch", *names]:
            ip("netns", "add", net.namespace(name))
            stack.callback(ip, "netns", "del", net.namespace(name))
        switch = net.namespace("switch")
        ip("-n", switch, "link", "add", "br0", "type", "bridge")
        ip("-n", switch, "link", "set", "br0", "up")
        for name in names:
            own, cable = net.namespace(name), net.cable(name)
            ip(
                "-n",
                switch,
                "link",
                "add",
                cable,
                "type",
                "veth",
                "peer",
                "name",
                "eth0",
                "netns",
                own,
            )
            ip("-n", switch, "link", "set", cable, "master", "br0", "up")
            ip("-n", own, "addr", "add", f"{net.address(name)}/24", "dev", "eth0")
            ip("-n", own, "link", "set", "eth0", "up")
            ip("-n", own, "link", "set", "lo", "up")
        yield net


def why_not() -> str | None:
    """Say why this machine has no namespaces for us; None: it has."""
    try:
        with a_net(["probe"]):
            return None
    except NotPermittedError as error:
        return str(error)
