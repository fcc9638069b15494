"""Version of what server and host say to each other."""

from __future__ import annotations

PROTOCOL_VERSION = 2
