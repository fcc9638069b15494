"""Talk to a labweb server from a program: typed calls, runs to wait for, news to follow."""

from labweb_client.client import AsyncClient, Client
from labweb_client.errors import LabwebError, RefusedError, UnansweredError
from labweb_client.live import News

__all__ = ["AsyncClient", "Client", "LabwebError", "News", "RefusedError", "UnansweredError"]
