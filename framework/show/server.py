"""Serve a page on this machine's own address, and reply to its sliders.

The server is bound to 127.0.0.1, on a port that the system chooses. It refuses requests that name another
host or come from a page of another origin, so that a web site open in the same browser gets nothing.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from framework.errors import InvalidInput, NoAnswer
from framework.numerics.interruption import interruptible
from framework.numerics.output import Document

MAX_REQUEST_BYTES = 65536

Answer = Callable[[Document], Document]


class PageServer(ThreadingHTTPServer):
    """A server of one page, which replies at /api/move by one function."""

    daemon_threads = True

    def __init__(self, page: str, answer: Answer | None = None) -> None:
        """Listen on a free port; `answer` replies to the messages of the page."""
        super().__init__(("127.0.0.1", 0), _Handler)
        self.page = page.encode("utf-8")
        self.answer = answer
        self.one_at_a_time = threading.Lock()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/"

    def serve_until_interrupted(self) -> None:
        """Serve until Ctrl-C or SIGTERM, then close."""
        with self, interruptible(), suppress(KeyboardInterrupt):
            self.serve_forever(poll_interval=0.1)


class _Handler(BaseHTTPRequestHandler):
    """Replies to the requests of one page."""

    server: PageServer
    timeout = 10.0  # [s] for a request to arrive

    def do_GET(self) -> None:
        """Send the page at /."""
        if not self._is_allowed():
            self._send(403, "text/plain", b"only for this machine\n")
        elif self.path.split("?")[0] == "/":
            self._send(200, "text/html; charset=utf-8", self.server.page)
        else:
            self._send(404, "text/plain", b"no such page\n")

    def do_POST(self) -> None:
        """Reply to a message of the page at /api/move."""
        if not self._is_allowed():
            self._send_json(403, {"error": "only for this machine"})
        elif self.path != "/api/move" or self.server.answer is None:
            self._send_json(404, {"error": "no such service"})
        else:
            self._answer(self.server.answer)

    def _answer(self, answer: Answer) -> None:
        """Read one JSON object; send the reply, or the error with status 400."""
        try:
            size = int(self.headers.get("Content-Length", ""))
            if not 0 <= size <= MAX_REQUEST_BYTES:
                raise InvalidInput(f"a request has at most {MAX_REQUEST_BYTES} bytes")
            message = json.loads(self.rfile.read(size))
            if not isinstance(message, dict):
                raise InvalidInput("a request is one JSON object")
            with self.server.one_at_a_time:
                reply = answer(message)
        except (ValueError, RecursionError, NoAnswer) as error:  # InvalidInput is a ValueError
            self._send_json(400, {"error": str(error)})
        else:
            self._send_json(200, reply)

    def _is_allowed(self) -> bool:
        """Return whether a request comes from this machine, and from no other site."""
        hosts = [f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")]
        origins = [None, *(f"http://{host}" for host in hosts)]  # None: typed into the browser
        return self.headers.get("Host") in hosts and self.headers.get("Origin") in origins

    def _send_json(self, status: int, document: Document) -> None:
        """Send a JSON document."""
        self._send(status, "application/json", json.dumps(document, allow_nan=False).encode())

    def _send(self, status: int, kind: str, content: bytes) -> None:
        """Send one reply, which no cache may store."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        try:
            self.wfile.write(content)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # the reader closed the page meanwhile

    def log_message(self, format: str, *args: object) -> None:
        """Write no log: the terminal is the command's."""
