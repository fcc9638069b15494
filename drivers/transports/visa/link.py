"""One VISA session, by pyvisa.

A library's errors become `OSError` here, which the transport turns into what may have happened.
"""

from __future__ import annotations

from contextlib import suppress
from typing import cast

import pyvisa
from pyvisa.constants import StatusCode
from pyvisa.errors import Error, VisaIOError
from pyvisa.resources import MessageBasedResource

MS_PER_S = 1000
MOST_BYTES = 4096
LATE = StatusCode.error_timeout


class VisaLink:
    """A session with one instrument; one request at a time, from one thread at a time."""

    def __init__(self, resource: str, library: str, timeout_s: float) -> None:
        """Open the session.

        Args:
            resource: VISA name of the instrument.
            library: As pyvisa names it: `@py`.
            timeout_s: Longest wait for the bus, and for each message that goes out.

        Raises:
            OSError: It cannot be opened.
        """
        self._timeout_ms = int(timeout_s * MS_PER_S)
        try:
            manager = pyvisa.ResourceManager(library)
            opened = manager.open_resource(resource, open_timeout=self._timeout_ms)
        except (Error, ValueError, ImportError, AttributeError) as error:
            raise OSError(f"{resource}: {error}") from error
        if not opened.session:  # VI_NULL, where a library says no more
            raise OSError(f"{resource}: there is no such resource")
        self._device = cast("MessageBasedResource", opened)

    def close(self) -> None:
        """End the session."""
        with suppress(Error):
            self._device.close()

    def send(self, data: bytes) -> None:
        """Send a message.

        Raises:
            OSError: It did not go out whole.
        """
        try:
            self._device.timeout = self._timeout_ms
            self._device.write_raw(data)
        except Error as error:
            raise OSError(str(error)) from error

    def receive(self, timeout_s: float) -> bytes:
        """Return a part of the answer, b"" where none comes in time.

        Raises:
            OSError: The session broke.
        """
        try:
            self._device.timeout = max(1, int(timeout_s * MS_PER_S))
            data, _ = self._device.visalib.read(self._device.session, MOST_BYTES)
        except VisaIOError as error:
            if error.error_code == LATE:
                return b""
            raise OSError(str(error)) from error
        except Error as error:
            raise OSError(str(error)) from error
        return bytes(data)

    def clear(self) -> bool:
        """Make the instrument forget what it still has to say; False: this library cannot.

        Raises:
            OSError: The session broke.
        """
        try:
            self._device.clear()
        except NotImplementedError:
            return False
        except VisaIOError as error:
            if error.error_code == StatusCode.error_nonsupported_operation:
                return False
            raise OSError(str(error)) from error
        except Error as error:
            raise OSError(str(error)) from error
        return True
