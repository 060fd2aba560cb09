"""The server of ``algdiff designer``: one page on this machine, for who knows its address."""

from __future__ import annotations

import hmac
import json
import secrets
import socketserver
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

from algdiff._designer import page
from algdiff._designer.answers import EXPORTS, Answers
from algdiff._designer.query import RefusedError

if TYPE_CHECKING:
    from algdiff._designer.recording import Recording

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")
"""What the page's machine may be called: anything else is a name that somebody has pointed at this machine."""
TARGET = 2048
"""Characters of a request's path and query, at most."""
FIELDS = 32
"""Parameters of a request, at most."""
PATIENCE = 10.0
"""Seconds within which a request must come."""
PAGES = 64
"""Pages of which the newest question is known, at most."""
HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'nonce-{nonce}'",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)


class FailureError(Exception):
    """What a request is told instead of an answer.

    Parameters
    ----------
    status : HTTPStatus
        The code.
    message : str
        What is said.
    control : str
        The control of the page that it is about, or "".
    """

    def __init__(self, status: HTTPStatus, message: str, control: str = "") -> None:
        super().__init__(message)
        self.status, self.message, self.control = status, message, control


class Server(ThreadingHTTPServer):
    """Answers one page about one recording.

    Parameters
    ----------
    recording : Recording
        What the page differentiates.
    port : int
        Where to listen; 0 for a free one.

    Attributes
    ----------
    token : str
        The secret part of the address.
    url : str
        The address of the page.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, recording: Recording, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(24)
        self.answers = Answers(recording)
        self.under_way = 0
        self._counting = threading.Condition()
        self._turn = threading.Lock()
        self._newest: dict[str, int] = {}
        super().__init__((ADDRESS, port), Handler)

    def server_bind(self) -> None:
        """Take the port, without asking a name server what this machine is called."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = ADDRESS, self.server_address[1]

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{ADDRESS}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that has gone before its answer."""

    @contextmanager
    def turn(self, given: dict[str, str]) -> Iterator[None]:
        """Wait until nothing else is computed; raise FailureError if the page has asked something newer meanwhile."""
        name, number = given.pop("page", ""), given.pop("n", "0")
        own = int(number) if number.isdecimal() and len(number) < 16 else 0
        with self._counting:
            if len(self._newest) > PAGES:
                self._newest.clear()
            self._newest[name] = max(own, self._newest.get(name, 0))
            self.under_way += 1
        try:
            with self._turn:
                if own < self._newest.get(name, 0):
                    raise FailureError(HTTPStatus.CONFLICT, "the page has asked something newer")
                yield
        finally:
            with self._counting:
                self.under_way -= 1
                self._counting.notify_all()

    def idle(self, seconds: float) -> bool:
        """Wait until nothing is computed, but not longer than some seconds; return whether that is so."""
        with self._counting:
            return self._counting.wait_for(lambda: not self.under_way, seconds)


class Handler(BaseHTTPRequestHandler):
    """One request: who asks is checked before what is asked."""

    server: Server
    server_version, sys_version = "algdiff", ""
    timeout = PATIENCE

    def do_GET(self) -> None:
        """Answer, or say why not."""
        try:
            self._respond()
        except FailureError as failure:
            self._fail(failure)
        except RefusedError as refusal:
            self._fail(FailureError(HTTPStatus.BAD_REQUEST, str(refusal), refusal.control))
        except ConnectionError:
            raise
        except Exception as error:
            self._fail(FailureError(HTTPStatus.INTERNAL_SERVER_ERROR, f"{type(error).__name__}: {error}"))

    do_HEAD = do_POST = do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_TRACE = do_CONNECT = do_GET  # noqa: N815

    def _respond(self) -> None:
        self._check_sender()
        target, _, query = self.path.partition("?")
        token, slash, path = target.removeprefix("/").partition("/")
        if not target.startswith("/") or not hmac.compare_digest(token.encode(), self.server.token.encode()):
            raise FailureError(
                HTTPStatus.FORBIDDEN, "the address lacks its token: open the one that algdiff designer printed"
            )
        if self.command != "GET":
            raise FailureError(HTTPStatus.METHOD_NOT_ALLOWED, f"only GET is answered, got {self.command}")
        if len(self.path) > TARGET:
            raise FailureError(HTTPStatus.REQUEST_URI_TOO_LONG, f"an address must be at most {TARGET} characters")
        if self.headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in self.headers:
            raise FailureError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "a request must have no body")
        if path == "" and slash:
            self._send_page()
        elif path in ("answer", "suggestion"):
            given = _parameters(query)
            with self.server.turn(given):
                found = getattr(self.server.answers, path)(given)
            self._send_json(HTTPStatus.OK, found)
        elif path.startswith("export/") and path.removeprefix("export/") in EXPORTS:
            given = _parameters(query)
            with self.server.turn(given):
                name, media, content = self.server.answers.export(path.removeprefix("export/"), given)
            self._send(HTTPStatus.OK, media, content, {"Content-Disposition": f'attachment; filename="{name}"'})
        else:
            raise FailureError(HTTPStatus.NOT_FOUND, "there is nothing at this address")

    def _check_sender(self) -> None:
        """Raise FailureError unless the request names this machine and, if a page has sent it, that page is ours."""
        places = [f"{name}:{self.server.server_port}" for name in NAMES]
        hosts = self.headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0] not in places:
            raise FailureError(HTTPStatus.FORBIDDEN, f"Host must be {places[0]}")
        origins = self.headers.get_all("Origin", [])
        if any(origin not in [f"http://{place}" for place in places] for origin in origins):
            raise FailureError(HTTPStatus.FORBIDDEN, "a page of another site has sent this")

    def _send_page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        given: dict[str, str] = {}
        with self.server.turn(given):
            start = self.server.answers.start
        text = page.document(self.server.answers.recording, start, nonce)
        policy = {"Content-Security-Policy": POLICY.format(nonce=nonce)}
        self._send(HTTPStatus.OK, "text/html; charset=utf-8", text.encode("utf-8", "replace"), policy)

    def _fail(self, failure: FailureError) -> None:
        more = {"Allow": "GET"} if failure.status is HTTPStatus.METHOD_NOT_ALLOWED else {}
        self._send_json(failure.status, {"error": failure.message, "control": failure.control}, more)

    def _send_json(self, status: HTTPStatus, value: object, more: Mapping[str, str] | None = None) -> None:
        self._send(status, "application/json", json.dumps(value, allow_nan=False).encode(), more or {})

    def _send(self, status: HTTPStatus, media: str, content: bytes, more: Mapping[str, str]) -> None:
        self.send_response(status)
        headers = {"Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'", **HEADERS, **more}
        for name, value in {"Content-Type": media, "Content-Length": str(len(content)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Say what is wrong with a request that cannot be read, as with one that can."""
        del explain
        status = HTTPStatus.METHOD_NOT_ALLOWED if code == HTTPStatus.NOT_IMPLEMENTED else HTTPStatus(code)
        self.close_connection = True
        self._fail(FailureError(status, message or status.phrase))

    def log_message(self, *_: object) -> None:
        """Keep quiet: the terminal shows the address."""


def _parameters(query: str) -> dict[str, str]:
    """Return the parameters of a request, each of which is given once."""
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query), max_num_fields=FIELDS)
    except ValueError:
        raise FailureError(
            HTTPStatus.BAD_REQUEST, f"the query must be at most {FIELDS} parameters name=value"
        ) from None
    given = dict(pairs)
    if len(given) < len(pairs):
        raise FailureError(HTTPStatus.BAD_REQUEST, "a parameter must be given once")
    return given
