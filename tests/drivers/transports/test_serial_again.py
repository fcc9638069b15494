"""A pseudo-terminal that was opened with another framing before."""

from __future__ import annotations

import os
import tty

from drivers.transports.urls import open_transport


def test_a_pseudo_terminal_opens_again_and_again_whatever_framing_is_asked() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        for _ in range(3):
            transport = open_transport(f"serial://{os.ttyname(slave)}?baud=9600&format=7E1")
            transport.close()
    finally:
        os.close(master)
        os.close(slave)
