"""Who may talk to the explorer: pages of this machine, or whoever brings the token.

To the checks of `catalogs.browse.access` it adds that of the origin, because browsers let pages of any site open a WebSocket
to any server.
"""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from catalogs.browse.access import Access

PAGE = files("surrogate.explore").joinpath("page")
LONGEST_PATH = 255  # characters; file systems fail at longer names, and nothing here has one


def _own_scripts() -> str:
    """The scripts that stand in the page itself, as a content security policy names them."""
    found = re.findall(r"<script>(.*?)</script>", PAGE.joinpath("index.html").read_text(encoding="utf-8"), re.DOTALL)
    return " ".join(f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in found)


HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    "Content-Security-Policy": (
        f"default-src 'self'; script-src 'self' {_own_scripts()}; img-src 'self' blob: data:; connect-src 'self' ws: wss:; "
        "base-uri 'self'; form-action 'self'; object-src 'none'"
    ),
}


def guard(access: Access) -> Middleware:
    """The middleware that refuses whoever has no access, and puts `HEADERS` on every answer."""

    @web.middleware
    async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            response = await _response(access, request, handler)
        except web.HTTPException as answer:
            answer.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    return guarded


def refusal(access: Access, request: web.Request) -> str:
    """Why the request is not answered; "" where it is."""
    named = request.headers.get("Host", "").lower()
    if not all(map(access.is_named_by, (named, request.host))):  # the second is that of the request line, if it has one
        return "this server answers to its own address only"
    origin = request.headers.get("Origin")
    if origin is not None and origin.lower().partition("://")[2] != named:
        return "pages of other sites may not talk to this server"
    if access.token and not (_brings_token(access, request) or access.is_token(request.cookies.get(access.cookie))):
        return "the address lacks its token: take the whole of what the program printed"
    return ""


async def _response(access: Access, request: web.Request, handler: Handler) -> web.StreamResponse:
    reason = refusal(access, request)
    if reason:
        return web.Response(status=403, text=f"{reason}\n")
    if len(request.rel_url.raw_path) > LONGEST_PATH:
        return web.Response(status=404, text="nothing here has so long a name\n")
    if not _brings_token(access, request):
        return await handler(request)
    # The same path: "./" would lead astray from below a proxy's `/proxy/PORT`, to which the page adds the slash that it lacks.
    exchanged = web.Response(status=303, headers={"Location": "?"})
    # Lax: whoever follows the printed address from another page, such as a terminal's, must come in at once.
    # An empty path: browsers then send it to this server alone, also below the path of a proxy.
    exchanged.set_cookie(access.cookie, access.token, path="", httponly=True, samesite="Lax")
    return exchanged


def _brings_token(access: Access, request: web.Request) -> bool:
    return bool(access.token) and access.is_token(request.query.get("token"))
