"""Who may ask: only the page itself, with the token it was opened with; a hostile page in another tab gets nothing."""

from __future__ import annotations

import hmac
import secrets
from pathlib import Path
from typing import Any

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_HEADER = "x-aeromatch-token"
_OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; connect-src 'self'; frame-src 'self'"
)
PAGE_POLICY = f"{_OWN}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Of the page: nothing from another host, no script inside the page, no frame around it."""
REPORT_POLICY = "sandbox allow-scripts allow-downloads; default-src 'self' 'unsafe-inline' data: blob:; frame-ancestors 'self'"
"""Of a report shown inside the page: it draws itself, and has no access to the page around it or to the server's answers."""


def kept_token(file: Path) -> str:
    """Return the token of a working folder, made at the first call: a page that is open survives a restart of the server.

    Parameters
    ----------
    file : path
        Readable by its owner only.
    """
    try:
        kept = file.read_text(encoding="ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        kept = ""
    if len(kept) >= 43:
        return kept
    token = secrets.token_urlsafe(32)
    file.unlink(missing_ok=True)
    file.touch(mode=0o600)
    file.write_text(token + "\n", encoding="ascii")
    return token


class Guard:
    """ASGI middleware: refuses whatever does not come from the page itself, and sets the headers that keep it so.

    Parameters
    ----------
    app : ASGI application
    token : str
        Every request of data carries it in the header ``x-aeromatch-token``, which no other page can send: there is no CORS. Pages
        and scripts hold nothing of the project and need none; a report is under a path that only the token's owner was given.
    hosts : set of str
        Allowed ``Host`` headers, with port: a name of another host that resolves to this machine (DNS rebinding) is refused.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: set[str]) -> None:
        self.app, self.token, self.hosts = app, token, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it with 403."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        refusal = self.refusal(scope["path"], headers)
        if refusal:
            kept = {name.decode(): text.decode() for name, text in _headers(PAGE_POLICY, False)}
            await PlainTextResponse(refusal, 403, kept)(scope, receive, send)
            return
        policy = REPORT_POLICY if scope["path"].startswith("/report/") else PAGE_POLICY

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_headers(policy, scope["path"].startswith("/report/"))]
            await send(message)

        await self.app(scope, receive, guarded)

    def refusal(self, path: str, headers: dict[str, str]) -> str:
        """Return why a request is refused; empty when it is not."""
        if headers.get("host", "") not in self.hosts:
            return "this server answers under 127.0.0.1 only"
        origin = headers.get("origin")
        if (
            origin is not None
            and origin not in {f"http://{host}" for host in self.hosts}
            and not (origin == "null" and path.startswith("/report/"))
        ):
            return "requests of other pages are refused"
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none") and not path.startswith("/report/"):
            return "requests of other pages are refused"
        if path.startswith("/api/") and not hmac.compare_digest(headers.get(TOKEN_HEADER, ""), self.token):
            return "wrong token; open the address that aeromatch view printed"
        return ""


def _headers(policy: str, sandboxed: bool) -> list[tuple[bytes, bytes]]:
    found: dict[str, Any] = {
        "content-security-policy": policy,
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cross-origin-resource-policy": "cross-origin" if sandboxed else "same-origin",  # a sandboxed page has no origin to be the same as
        "cross-origin-opener-policy": "same-origin",
        "cache-control": "no-store",
    }
    return [(name.encode(), value.encode()) for name, value in found.items()]
