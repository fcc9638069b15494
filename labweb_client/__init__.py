"""Talk to a labweb server from a program: typed calls, runs to wait for, news to follow."""

from labweb_client.client import AsyncLabClient, LabClient
from labweb_client.errors import CallRefusedError, CallUnansweredError, LabwebError
from labweb_client.live import News

__all__ = [
    "AsyncLabClient",
    "CallRefusedError",
    "CallUnansweredError",
    "LabClient",
    "LabwebError",
    "News",
]
