"""A bell between the processes of one host: there is something for another of them to look at.

It carries nothing and may be lost; who hears it looks into the journal, and looks now and
then without it.

Source:
    fifo(7): a reader that holds both ends never sees its end, and a full pipe is a bell that
    rings already.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import select
import stat
from pathlib import Path

MOST_RINGS = 4096


def ring(path: Path) -> bool:
    """Wake whoever waits; False: nobody does."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        if not stat.S_ISFIFO(os.fstat(handle).st_mode):
            return False
        os.write(handle, b"!")
    except BlockingIOError:
        return True  # it is full, and so rings already
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def hang(path: Path) -> None:
    """Hang the bell up, unless it hangs.

    Raises:
        OSError: The folder takes no FIFO, or something else lies there: a file would ring for ever.
    """
    with contextlib.suppress(FileExistsError):
        os.mkfifo(path, 0o600)
    if not stat.S_ISFIFO(path.stat().st_mode):
        raise FileExistsError(errno.EEXIST, "this is no FIFO: take it away", str(path))


class WakePipe:
    """The waiting end, in a process that does one thing after the other."""

    def __init__(self, path: Path) -> None:
        """Hang the bell up.

        Raises:
            OSError: The folder takes no FIFO.
        """
        hang(path)
        self._handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def wait(self, longest_s: float) -> bool:
        """Wait for a ring since the last wait, or for so long; say whether somebody rang."""
        is_rung = bool(select.select([self._handle], [], [], longest_s)[0])
        if is_rung:
            with contextlib.suppress(BlockingIOError):  # another one has heard it
                os.read(self._handle, MOST_RINGS)
        return is_rung

    def close(self) -> None:
        """Take the bell down."""
        os.close(self._handle)


class AsyncWakePipe:
    """The waiting end, in one event loop."""

    def __init__(self, path: Path) -> None:
        """Hang the bell up.

        Raises:
            OSError: The folder takes no FIFO.
        """
        hang(path)
        self._handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        self._rung = asyncio.Event()
        asyncio.get_running_loop().add_reader(self._handle, self._hear)

    @property
    def is_rung(self) -> bool:
        """Say whether somebody has rung since the last wait."""
        return self._rung.is_set()

    async def wait(self, longest_s: float) -> None:
        """Wait for a ring since the last wait, or for so long."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(longest_s):
                await self._rung.wait()
        self._rung.clear()

    def close(self) -> None:
        """Take the bell down."""
        asyncio.get_running_loop().remove_reader(self._handle)
        os.close(self._handle)

    def _hear(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._handle, MOST_RINGS)
        self._rung.set()
