"""The other end of HTTP, for the drivers: a server that answers by a function."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

Answer = Callable[[str, str, Mapping[str, str], bytes], tuple[int, bytes] | None]
"""From method, path, headers and body to status and body; None hangs up."""


@contextmanager
def serving(answer: Answer) -> Iterator[int]:
    """Serve on a free port until the block ends."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            length = int(self.headers.get("Content-Length") or 0)
            body = self.rfile.read(length)
            told = answer(self.command, self.path, dict(self.headers), body)
            if told is None:
                return
            self.send_response(told[0])
            self.end_headers()
            self.wfile.write(told[1])

        do_POST = do_GET  # noqa: N815 - as the library names it
        do_DELETE = do_GET  # noqa: N815 - as the library names it

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as web:
        thread = threading.Thread(target=web.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield web.server_port
        finally:
            web.shutdown()
            thread.join(5)
