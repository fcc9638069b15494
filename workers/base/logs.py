"""Logs on a disk that may be full: no line of a log ends what it tells of."""

from __future__ import annotations

import logging

FORMAT = "%(asctime)s %(levelname)s %(name)s %(message)s"


class LossyLogStream(logging.StreamHandler):  # type: ignore[type-arg] # generic in the stubs alone
    """Writes to the log of its process; what is lost is counted, and told before the next line."""

    def __init__(self) -> None:
        super().__init__()
        self._lost_count = 0
        self._why = ""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless the disk refuses it."""
        try:
            text = self.format(record)
            if self._lost_count:
                text = f"{self._lost_count} lines of this log were lost: {self._why}\n{text}"
            self.stream.write(text + self.terminator)
            self.flush()
        except OSError as error:
            self._lost_count, self._why = self._lost_count + 1, str(error)
        except Exception:  # noqa: BLE001 - a message that cannot be put together, as logging does
            self.handleError(record)
        else:
            self._lost_count = 0


def set_up(level: str) -> None:
    """Let this process log to its standard error from a level on."""
    logging.basicConfig(level=level, format=FORMAT, handlers=[LossyLogStream()])
