"""Who may speak to the server: whoever changed its one-time token for a cookie, and only from the page itself.

A server on this machine can be reached by every page that is open in a browser. Against pages of other sites whose
names are led to 127.0.0.1 (DNS rebinding) the Host header is checked; against requests that they make in the browser's
name, the Origin header and a cookie that is only sent along from the page itself (SameSite); against scripts that find
a way into the page, its Content-Security-Policy.
"""

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
READING = ("GET", "HEAD")

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


@dataclass(frozen=True)
class AdmissionModel:
    """How many are let in."""

    most_sessions: int = 8  # browsers that a server lets in, in all
    token_bytes: int = 32


MODEL = AdmissionModel()


class Admission:
    """Tokens, each of which is good for one browser, and the cookies that they were changed for.

    Attributes:
        token: the one that the next browser is let in by; None where there are no more.
    """

    def __init__(self, on_entry: Callable[[], None] = lambda: None, model: AdmissionModel = MODEL) -> None:
        """Args: on_entry: called after a token was used; the next one is there then."""
        self._on_entry, self._model = on_entry, model
        self._sessions: list[str] = []
        self._name = f"ar-studio-{secrets.token_hex(4)}"  # servers on several ports share a browser's cookies
        self.token: str | None = secrets.token_urlsafe(model.token_bytes)

    def enter(self, token: str) -> str | None:
        """Changes the token for a cookie's header; None where it is another, or used already."""
        if self.token is None or not secrets.compare_digest(token.encode(), self.token.encode()):
            return None
        session = secrets.token_urlsafe(self._model.token_bytes)
        self._sessions.append(session)
        is_full = len(self._sessions) >= self._model.most_sessions
        self.token = None if is_full else secrets.token_urlsafe(self._model.token_bytes)
        self._on_entry()
        return f"{self._name}={session}; Path=/; HttpOnly; SameSite=Strict"

    def knows(self, cookies: str) -> bool:
        """Whether a Cookie header has one of the cookies."""
        try:
            morsel = SimpleCookie(cookies).get(self._name)
        except CookieError:
            return False
        value = b"" if morsel is None else morsel.value.encode()
        return any(secrets.compare_digest(value, session.encode()) for session in self._sessions)


class Gate:
    """Lets requests through to an application, or refuses them; an ASGI middleware."""

    def __init__(self, app: ASGIApp, admission: Admission) -> None:
        self._app, self._admission = app, admission

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: the handshake gets a 403
        else:
            await refusal(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        """The answer in place of the application's; None where the request is let through."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name_of(host) not in LOOPBACK:
            return PlainTextResponse("This server is only for this computer.", 403)
        reads = scope["type"] == "http" and scope["method"] in READING
        if not reads and headers.get("origin") != f"http://{host}":
            return JSONResponse({"error": "only Studio's own page may do this: open it anew"}, 403)
        if scope["type"] == "http" and scope["path"] == "/" and (token := _token(scope)) is not None:
            cookie = self._admission.enter(token)
            if cookie is not None:
                return RedirectResponse("/", 303, {"set-cookie": cookie})
        if not self._admission.knows(headers.get("cookie", "")):
            told = "this address was used already, or is incomplete: take the one that ar-studio printed last"
            return JSONResponse({"error": told}, 401)
        return None


def _name_of(host: str) -> str:
    """A Host header's name, without the port: it may be another at the near end of a tunnel."""
    name, colon, port = host.rpartition(":")
    return (name if colon and (not port or port.isdecimal()) else host).lower()


def _token(scope: Scope) -> str | None:
    values = parse_qs(scope["query_string"].decode("latin-1")).get("token")
    return values[0] if values else None


def _with_headers(send: Send) -> Send:
    """Adds to each answer what browsers have to keep to."""

    async def add(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers[name] = value
            headers.setdefault("cache-control", "no-store")
        await send(message)

    return add
