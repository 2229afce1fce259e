"""Token, origin and content policy of the server of the workbench."""

from __future__ import annotations

import hmac
import secrets
from pathlib import Path

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from flightmech.support.atomic_write import written_atomically

TOKEN_HEADER = "x-aeromatch-token"
_SOURCES = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src "
    "'self'; connect-src 'self'; frame-src 'none'"
)
PAGE_POLICY = f"{_SOURCES}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Content policy of the page: no other host, no script in the page, no frame around or in it."""
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'self' 'unsafe-inline' data: "
    "blob:; frame-ancestors 'none'"
)
"""Content policy of a report in a tab of its own.

The report may run its scripts.  It has no access to the page that opened it or to the data of the
server.
"""
REPORTS = "/report/"
# Least status of a response that refuses a request.
_FIRST_REFUSAL = 400
# Characters of a token of 32 random bytes in base64.
_TOKEN_LENGTH = 43


def kept_token(file: Path) -> str:
    """Return the token of a working folder, made at the first call.

    An open page has the token, so it works with a restarted server too.

    Parameters
    ----------
    file : path
        File of the token, readable by its owner only.
    """
    try:
        token = file.read_text(encoding="ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        token = ""
    if len(token) >= _TOKEN_LENGTH:
        return token
    token = secrets.token_urlsafe(32)
    file.unlink(missing_ok=True)
    with written_atomically(file) as part:
        # The mode is set before the file has a content.
        part.touch(mode=0o600)
        part.write_text(token + "\n", encoding="ascii")
    return token


def is_same_secret(given: str, secret: str) -> bool:
    """Return whether a text is a secret, after the same time for every wrong text."""
    # Of texts, `hmac` compares ASCII only; another page may send any character.
    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), secret.encode())


class Guard:
    """ASGI middleware that refuses requests of other pages and sets the security headers.

    Parameters
    ----------
    app : ASGI application
    token : str
        Every request of data has it in the header ``x-aeromatch-token``.  No other page can send
        this header, since the server does not allow CORS.  Pages and scripts have no data of the
        project and need no token.  The path of a report has a ticket that only the page knows.
    hosts : set of str
        Allowed ``Host`` headers, with port.  The name of another host that resolves to this
        machine (DNS rebinding) is refused.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: set[str]) -> None:
        self.app, self.token, self.hosts = app, token, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or refuse it with 403."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        headers = {}
        for name, value in scope["headers"]:
            headers[name.decode("latin-1").lower()] = value.decode("latin-1")
        path = scope["path"]
        is_posted = scope["method"] == "POST"

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                added = _security_headers("/" if refusal else path)
                # The server would otherwise read the rest of a body that nobody wants.
                if _has_body(headers) and not (is_posted and message["status"] < _FIRST_REFUSAL):
                    added.append((b"connection", b"close"))
                message["headers"] = [*message.get("headers", []), *added]
            await send(message)

        refusal = self.refusal(path, headers)
        if refusal:
            await PlainTextResponse(refusal, 403)(scope, receive, send_guarded)
            return

        await self.app(scope, receive, send_guarded)

    def refusal(self, path: str, headers: dict[str, str]) -> str:
        """Return why a request is refused; empty if it is allowed."""
        if headers.get("host", "") not in self.hosts:
            return "this server answers under 127.0.0.1 only"
        if not self._is_same_site(path, headers):
            return "requests of other pages are refused"
        token = headers.get(TOKEN_HEADER, "")
        if path.startswith("/api/") and not is_same_secret(token, self.token):
            return "wrong token; open the address that aeromatch view printed"
        return ""

    def _is_same_site(self, path: str, headers: dict[str, str]) -> bool:
        """Return whether a request comes from the page, from a report, or from no page."""
        is_report = path.startswith(REPORTS)
        origins = {f"http://{host}" for host in self.hosts}
        if is_report:
            # The origin of a sandboxed report is "null".
            origins.add("null")
        origin = headers.get("origin")
        if origin is not None and origin not in origins:
            return False
        site = headers.get("sec-fetch-site", "none")
        return is_report or site in ("same-origin", "none")


def _has_body(headers: dict[str, str]) -> bool:
    """Return whether the headers of a request state a body."""
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers


def _security_headers(path: str) -> list[tuple[bytes, bytes]]:
    """Return the security headers of the response at a path."""
    policy, resource_policy = PAGE_POLICY, "same-origin"
    if path.startswith(REPORTS):
        # A sandboxed page does not have the origin of the server.
        policy, resource_policy = REPORT_POLICY, "cross-origin"
    headers = {
        "content-security-policy": policy,
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cross-origin-resource-policy": resource_policy,
        "cross-origin-opener-policy": "same-origin",
        "cache-control": "no-store",
    }
    return [(name.encode(), value.encode()) for name, value in headers.items()]
