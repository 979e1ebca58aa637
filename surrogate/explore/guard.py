"""Who may talk to the explorer: this machine's own pages, or whoever brings the token.

A page of any web site may try to reach a server on 127.0.0.1: by a host name of its own that resolves to it (DNS rebinding),
or by opening a WebSocket, which browsers don't stop.  So requests must name this server as their host, and what a browser
says comes from a page must come from one of ours.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from urllib.parse import urlsplit

from aiohttp import web

LOCAL_HOSTS = frozenset({"127.0.0.1", "localhost", "::1"})
COOKIE = "gs-surrogate-token"
LONGEST_PATH = 255  # of what is served here none has as many characters; file systems fail at more
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    # Vue compiles its templates in the page, and pictures are decoded from memory.
    "Content-Security-Policy": (
        "default-src 'self'; script-src 'self' 'unsafe-eval' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' blob: data:; connect-src 'self' ws: wss:; base-uri 'self'; form-action 'self'; object-src 'none'"
    ),
}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Guard:
    """What a server on `host` answers.

    Attributes
    ----------
    host : the address that it listens on.
    token : what others than this machine must bring, once in the address and then as a cookie; "" where only this machine can
        reach it.
    """

    host: str
    token: str

    @classmethod
    def of(cls, host: str) -> Guard:
        """A guard with a new random token unless only this machine can reach `host`."""
        return cls(host, "" if host in LOCAL_HOSTS else secrets.token_urlsafe(24))

    @property
    def cookie(self) -> str:
        """Name of the cookie that holds the token: one of its own, as browsers send cookies to all ports of a host."""
        return f"{COOKIE}-{hashlib.sha256(self.token.encode()).hexdigest()[:8]}"

    def refusal(self, request: web.Request) -> str:
        """Why the request is not answered; "" where it is."""
        named = request.headers.get("Host", "").lower()
        if not self.token and _host_name(named) not in LOCAL_HOSTS:
            return "this server answers to its own address only"
        origin = request.headers.get("Origin")
        if origin is not None and origin.lower().partition("://")[2] != named:
            return "pages of other sites may not talk to this server"
        if self.token and not (
            self._brought(request.query.get("token")) or self._brought(request.cookies.get(self.cookie))
        ):
            return "the address lacks its token: take the whole of what the command printed"
        return ""

    def _brought(self, token: str | None) -> bool:
        return token is not None and hmac.compare_digest(token.encode(), self.token.encode())

    def middleware(self) -> Callable[[web.Request, Handler], Awaitable[web.StreamResponse]]:
        """For aiohttp: refuses, and puts the headers on whatever is answered."""

        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            reason = self.refusal(request)
            if reason:
                return web.Response(status=403, text=f"{reason}\n", headers=HEADERS)
            if len(request.rel_url.raw_path) > LONGEST_PATH:
                return web.Response(status=404, text="nothing here has so long a name\n", headers=HEADERS)
            try:
                response = await handler(request)
            except ConnectionResetError:  # a tab was closed while its picture was on the way
                return web.Response(status=400)
            except web.HTTPException as answer:
                answer.headers.update(HEADERS)
                raise
            if not response.prepared:
                response.headers.update(HEADERS)
                if self.token and self._brought(request.query.get("token")):
                    response.set_cookie(self.cookie, self.token, httponly=True, samesite="Strict")
            return response

        return guarded


def _host_name(named: str) -> str:
    """Of "name:port", "name" or "[address]:port"; "" for what is none."""
    try:
        return urlsplit(f"//{named}").hostname or ""
    except ValueError:
        return ""
