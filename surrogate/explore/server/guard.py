"""Who may talk to the explorer: whom `catalogs.web.access` lets in."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from catalogs.web.access import Access

PAGE = Path(__file__).parent.parent / "page"
LONGEST_PATH = 255  # characters; file systems fail at longer names, and nothing here has one


def _own_scripts() -> str:
    """The scripts that stand in the page itself, as a content security policy names them."""
    scripts = re.findall(
        r'<script(?: type="importmap")?>(.*?)</script>', (PAGE / "index.html").read_text(encoding="utf-8"), re.DOTALL
    )
    return " ".join(f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in scripts)


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


async def _response(access: Access, request: web.Request, handler: Handler) -> web.StreamResponse:
    hosts = request.headers.get("Host", ""), request.host  # the second is that of the request line, if it has one
    brought = request.query.get("token")
    reason = access.refusal(hosts, request.headers.get("Origin"), (brought, request.cookies.get(access.cookie)))
    if reason:
        return web.Response(status=403, text=f"{reason}\n")
    if len(request.rel_url.raw_path) > LONGEST_PATH:
        return web.Response(status=404, text="not found\n")
    if not (access.token and access.is_token(brought)):
        return await handler(request)
    # The same path: "./" would lead astray from below a proxy's `/proxy/PORT`, to which the page adds the slash that it lacks.
    exchanged = web.Response(status=303, headers={"Location": "?"})
    # Lax: whoever follows the printed address from another page, such as a terminal's, must come in at once.
    # An empty path: browsers then send it to this server alone, also below the path of a proxy.
    exchanged.set_cookie(access.cookie, access.token, path="", httponly=True, samesite="Lax")
    return exchanged
