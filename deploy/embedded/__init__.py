"""Run a whole lab on one machine: database, broker and every process, under one supervisor.

Nothing here imports labweb. The programs come from two wheels and from this checkout,
and are reached by their command lines and their environment alone.
"""

from deploy.embedded.database_and_broker import services
from deploy.embedded.errors import EmbeddedError

__all__ = ["EmbeddedError", "services"]
