"""Who may talk to the explorer: this machine's own pages, or whoever brings the token; said to aiohttp.

Beside what `catalogs.browse.access` holds every server to: pages of other sites may open a WebSocket, which browsers don't stop, so
what a browser says comes from a page must come from one of ours.
"""

from __future__ import annotations

from dataclasses import dataclass

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from catalogs.browse.access import Access

LONGEST_PATH = 255  # of what is served here none has as many characters; file systems fail at more
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' ws: wss:; "
        "base-uri 'self'; form-action 'self'; object-src 'none'"
    ),
}


@dataclass(frozen=True)
class Guard:
    """Refuses what has no access, and puts headers on whatever is answered."""

    access: Access

    def refusal(self, request: web.Request) -> str:
        """Why the request is not answered; "" where it is."""
        named = request.headers.get("Host", "").lower()
        if not all(
            map(self.access.is_named_by, (named, request.host))
        ):  # the second is that of the request line, if it has one
            return "this server answers to its own address only"
        origin = request.headers.get("Origin")
        if origin is not None and origin.lower().partition("://")[2] != named:
            return "pages of other sites may not talk to this server"
        cookie = request.cookies.get(self.access.cookie)
        if self.access.token and not (self._brings_token(request) or self.access.is_token(cookie)):
            return "the address lacks its token: take the whole of what the program printed"
        return ""

    def _brings_token(self, request: web.Request) -> bool:
        return bool(self.access.token) and self.access.is_token(request.query.get("token"))

    def middleware(self) -> Middleware:
        """For aiohttp: refuses, and puts the headers on whatever is answered."""

        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            try:
                response = await self._response(request, handler)
            except web.HTTPException as answer:
                answer.headers.update(HEADERS)
                raise
            if not response.prepared:
                response.headers.update(HEADERS)
            return response

        return guarded

    async def _response(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        reason = self.refusal(request)
        if reason:
            return web.Response(status=403, text=f"{reason}\n")
        if len(request.rel_url.raw_path) > LONGEST_PATH:
            return web.Response(status=404, text="nothing here has so long a name\n")
        if not self._brings_token(request):
            return await handler(request)
        exchanged = web.Response(status=303, headers={"Location": "./"})
        # Lax: whoever follows the printed address from another page, such as a terminal's, must come in at once.
        # An empty path: browsers then send it to this server alone, also below the path of a proxy.
        exchanged.set_cookie(self.access.cookie, self.access.token, path="", httponly=True, samesite="Lax")
        return exchanged
