"""Who may use a server of this project: pages of this machine, or whoever brings a token.

A page of any web site may try to reach a server on 127.0.0.1.  It may use a host name of its own that resolves to it (DNS
rebinding), or a WebSocket.  So a request must name the server by one of its own names, and come from no other
site.  A server that others can reach wants a random token as well.  The printed address holds it; it is exchanged for a cookie, so
that the page's address can be passed on.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from urllib.parse import urlsplit

LOCAL = "127.0.0.1"


@dataclass(frozen=True)
class Access:
    """Access to a server that listens on `host`.

    Attributes
    ----------
    host : the address that it listens on.
    token : what must be brought; "" where only this machine reaches the server.
    base_url : that of a Jupyter server whose proxy passes requests on, whatever name they call it by; "" without.
    """

    host: str
    token: str = field(repr=False)
    base_url: str = ""

    @classmethod
    def of(cls, host: str, base_url: str = "") -> Access:
        """Access to `host`, with a new random token unless only this machine can reach it, and through no proxy."""
        return cls(host, "" if is_local(host) and not base_url else secrets.token_urlsafe(24), base_url)

    @property
    def cookie(self) -> str:
        """Name of the cookie that holds the token: one of its own, as browsers send cookies to all ports of a host."""
        return f"gs-surrogate-{hashlib.sha256(self.token.encode()).hexdigest()[:8]}"

    def address(self, port: int) -> str:
        """The address to open, with the token where one is needed; behind a proxy it is a path, below that of Jupyter."""
        brought = f"?token={self.token}" if self.token else ""
        if self.base_url:
            return f"{'/'.join(['', *filter(None, self.base_url.split('/'))])}/proxy/{port}/{brought}"
        name = socket.gethostname() if is_any(self.host) else self.host
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{port}/{brought}"

    def is_named_by(self, header: str) -> bool:
        """True if a request's Host header names this server.

        Plain addresses need no such care where there is a token; without one only loopback ones are answered.  Behind a proxy
        the name is that of the proxy, and the token alone counts.
        """
        try:
            named = urlsplit(f"//{header}").hostname or ""
        except ValueError:
            named = ""
        if self.base_url or named in self._names():
            return True
        address = _address(named)
        return address is not None and (address.is_loopback or bool(self.token))

    def refusal(self, hosts: Sequence[str], origin: str | None, tokens: Sequence[str | None]) -> str:
        """Why a request is refused; "" where it is answered.

        `hosts` are the names by which it calls the server, its Host header first.  `origin` is its Origin header, and `tokens` are
        those that it brings; None for what it lacks.
        """
        if not all(map(self.is_named_by, hosts)):
            return "this server answers to its own address only"
        if origin is not None and origin.lower().partition("://")[2] != hosts[0].lower():
            return "pages of other sites may not talk to this server"
        if self.token and not any(map(self.is_token, tokens)):
            return "the address lacks its token: take the whole of what the program printed"
        return ""

    def is_token(self, said: str | None) -> bool:
        """True if this is the token; the time that it takes is independent of it."""
        return said is not None and hmac.compare_digest(said.encode(errors="replace"), self.token.encode())

    def _names(self) -> set[str]:
        """The names, beside plain addresses, by which the server may be asked."""
        if is_local(self.host):
            return {"localhost"}
        machine = {socket.gethostname(), socket.getfqdn()} if is_any(self.host) else {self.host}
        return {name.lower() for name in {"localhost", *machine}}


def is_local(host: str) -> bool:
    """True if only this machine reaches a server that listens there."""
    address = _address(host)
    return host == "localhost" or (address is not None and address.is_loopback)


def is_any(host: str) -> bool:
    """True if the host stands for all of the machine's addresses."""
    address = _address(host)
    return host == "" or (address is not None and address.is_unspecified)


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The host where it is a plain address; None where it is a name."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None
