"""The server of the workbench: pages, data, actions, jobs; on 127.0.0.1 only."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import mimetypes
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from aeromatch.workbench import actions, databases, identification, matching, records
from aeromatch.workbench.opened import MATCH, OpenProject
from aeromatch.workbench.processes import Jobs, WorkbenchJob
from flightmech.errors import AeromatchError
from flightmech.support.console import to_json_types

TOKEN_HEADER = "x-aeromatch-token"
_OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src "
    "'self'; connect-src 'self'; frame-src 'self'"
)
PAGE_POLICY = f"{_OWN}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Of the page: nothing from another host, no script inside the page, no frame around it."""
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'self' 'unsafe-inline' data: "
    "blob:; frame-ancestors 'self'"
)
"""Of a report shown inside the page: it draws itself, and has no access to the page around it or to the server's answers."""


def kept_token(file: Path) -> str:
    """Return the token of a working folder, made at the first call: a page that is open survives a
    restart of the server.

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
    """ASGI middleware: refuses whatever does not come from the page itself, and sets the headers
    that keep it so.

    Parameters
    ----------
    app : ASGI application
    token : str
        Every request of data carries it in the header ``x-aeromatch-token``, which no other page
        can send: there is no CORS. Pages and scripts hold nothing of the project and need none; a
        report is under a path that only the token's owner was given.
    hosts : set of str
        Allowed ``Host`` headers, with port: a name of another host that resolves to this machine
        (DNS rebinding) is refused.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: set[str]) -> None:
        self.app, self.token, self.hosts = app, token, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it with 403."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1")
            for name, value in scope["headers"]
        }
        refusal = self.refusal(scope["path"], headers)
        if refusal:
            kept = {name.decode(): text.decode() for name, text in _headers(PAGE_POLICY, False)}
            await PlainTextResponse(refusal, 403, kept)(scope, receive, send)
            return
        policy = REPORT_POLICY if scope["path"].startswith("/report/") else PAGE_POLICY

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message.get("headers", []),
                    *_headers(policy, scope["path"].startswith("/report/")),
                ]
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
        if headers.get("sec-fetch-site", "none") not in (
            "same-origin",
            "none",
        ) and not path.startswith("/report/"):
            return "requests of other pages are refused"
        if path.startswith("/api/") and not hmac.compare_digest(
            headers.get(TOKEN_HEADER, ""), self.token
        ):
            return "wrong token; open the address that aeromatch view printed"
        return ""


def _headers(policy: str, sandboxed: bool) -> list[tuple[bytes, bytes]]:
    found: dict[str, Any] = {
        "content-security-policy": policy,
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cross-origin-resource-policy": "cross-origin"
        if sandboxed
        else "same-origin",  # a sandboxed page has no origin to be the same as
        "cross-origin-opener-policy": "same-origin",
        "cache-control": "no-store",
    }
    return [(name.encode(), value.encode()) for name, value in found.items()]


Call = Callable[[OpenProject, Mapping[str, str], Any], Any]

STATIC = Path(__file__).parent / "static"
_UPLOT = Path(__file__).parents[2] / "pom" / "report" / "static" / "uplot"
_MOST_BODY = 1_000_000  # bytes of a request


class Workbench:
    """The workbench of a project: its data, its actions, its server.

    Parameters
    ----------
    opened : Opened
    port : int
        0 takes a free one.
    """

    def __init__(self, opened: OpenProject, port: int = 0) -> None:
        self.opened = opened
        opened.work.mkdir(parents=True, exist_ok=True)
        self.token = kept_token(opened.work / "token")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(("127.0.0.1", port))
        self.port = self.socket.getsockname()[1]
        self._before: dict[int, dict[str, str]] = {}
        self._log_lock = threading.Lock()
        self.jobs = Jobs(
            opened.work / "jobs", opened.places.project, opened.places.real, self._begin, self._end
        )
        opened.run = self.jobs.run
        self.ticket = hmac.new(self.token.encode(), b"report", hashlib.sha256).hexdigest()

    @property
    def address(self) -> str:
        """Address that opens the page; the token stands behind #, which no browser sends to a
        server.
        """
        return f"http://127.0.0.1:{self.port}/#token={self.token}"

    def app(self) -> Any:
        """Return the ASGI application."""

        @asynccontextmanager
        async def lifespan(app: Starlette):
            yield
            self.jobs.stop()

        routes = [
            Route(path, self._data(call), methods=[method])
            for (method, path), call in {
                **records.ROUTES,
                **identification.ROUTES,
                **databases.ROUTES,
                **matching.ROUTES,
            }.items()
        ]
        routes += [
            Route("/api/act", self._data(self._act), methods=["POST"]),
            Route("/api/jobs", self._data(self._jobs), methods=["GET"]),
            Route("/api/cancel", self._data(self._cancel), methods=["POST"]),
            Route("/api/output", self._data(self._output), methods=["GET"]),
            Route("/api/actions", self._data(self._actions), methods=["GET"]),
            Route("/report/{ticket}/{name:path}", self._report, methods=["GET"]),
            Route("/", self._static, methods=["GET"]),
            Route("/{name:path}", self._static, methods=["GET"]),
        ]
        hosts = {f"127.0.0.1:{self.port}", f"localhost:{self.port}"}
        return Guard(Starlette(routes=routes, lifespan=lifespan), self.token, hosts)

    def serve(self) -> None:
        """Serve until interrupted."""
        import uvicorn

        self.socket.listen(128)
        threading.Thread(target=self._warm, daemon=True).start()
        config = uvicorn.Config(
            self.app(),
            log_level="warning",
            access_log=False,
            server_header=False,
            date_header=False,
        )
        uvicorn.Server(config).run(sockets=[self.socket])

    def _warm(self) -> None:
        """Read the first record while the browser starts: the page finds it, and the packages
        behind it, there.
        """
        with contextlib.suppress(AeromatchError, OSError):  # the page reports it
            self.opened.record(next(iter(self.opened.project.flights), ""))

    def _data(self, call: Call) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            body = None
            if request.method == "POST":
                raw = b""
                async for part in request.stream():
                    raw += part
                    if len(raw) > _MOST_BODY:
                        return JSONResponse(
                            {"error": "request", "text": f"more than {_MOST_BODY} bytes"}, 413
                        )
                try:
                    body = json.loads(raw or b"null")
                except ValueError:
                    return JSONResponse({"error": "request", "text": "the body is not a JSON"}, 400)
            try:
                found = await run_in_threadpool(call, self.opened, dict(request.query_params), body)
            except (AeromatchError, OSError) as error:
                problems = list(getattr(error, "problems", ()))
                return JSONResponse(
                    {"error": type(error).__name__, "text": str(error), "problems": problems}, 400
                )
            if isinstance(found, bytes):
                return Response(found, media_type="application/octet-stream")
            return JSONResponse(to_json_types(found))

        return answer

    def _act(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        words = (
            body["words"] if isinstance(body, dict) and isinstance(body.get("words"), list) else []
        )
        actions.demand_allowed(words)
        job = self.jobs.add(words)
        wait = body.get("wait", 0.0)
        if wait:
            job = self.jobs.wait(job.number, min(float(wait), 60.0))
        return self._about(job)

    def _about(self, job: WorkbenchJob) -> dict[str, Any]:
        return {**job.about(), "command": job.title or self.opened.places.command(job.words)}

    def _jobs(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        return {
            "jobs": [self._about(job) for job in self.jobs.jobs.values()],
            "report": self._report_address(),
        }

    def _cancel(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        job = self._job(body.get("number") if isinstance(body, dict) else None)
        self.jobs.cancel(job.number)
        return self._about(job)

    def _output(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        number = query.get("number", "")
        job = self._job(int(number) if number.isdigit() else None)
        return {
            **self._about(job),
            "out": actions.read_command_output(job.out),
            "err": actions.read_command_output(job.err),
        }

    def _job(self, number: Any) -> WorkbenchJob:
        if number not in self.jobs.jobs:
            raise actions.ActionError(f"no job {number}; there are {len(self.jobs.jobs)}")
        return self.jobs.jobs[number]

    def _actions(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        entries = actions.read_action_log(opened.log) if opened.log.exists() else []
        return {
            "log": opened.places.named(opened.log),
            "actions": [
                {
                    "number": entry.number,
                    "command": opened.places.command(entry.words),
                    "files": list(entry.files),
                }
                for entry in entries
            ],
        }

    def _begin(self, job: WorkbenchJob) -> None:
        actions.make_folders(job.words, self.opened.places)
        self._before[job.number] = actions.hash_named_files(job.words, self.opened.places)

    def _end(self, job: WorkbenchJob) -> None:
        before, after = (
            self._before.pop(job.number),
            actions.hash_named_files(job.words, self.opened.places),
        )
        if files := actions.changed_files(before, after):
            with self._log_lock:
                actions.append_action(self.opened.log, job.words, job.code or 0, files)

    def _report_address(self) -> str | None:
        reports = [
            self.opened.work / MATCH / "report",
            *(self.opened.work / matching.RUNS).glob("*"),
        ]
        there = any((folder / "report.html").exists() for folder in reports)
        return f"/report/{self.ticket}/{MATCH}/report/report.html" if there else None

    async def _report(self, request: Request) -> Response:
        if not hmac.compare_digest(request.path_params["ticket"], self.ticket):
            return Response("wrong ticket", 403)
        return _file(self.opened.work, request.path_params["name"])

    async def _static(self, request: Request) -> Response:
        name = request.path_params.get("name", "") or "index.html"
        if name.startswith("uplot/"):
            return _file(_UPLOT, name.removeprefix("uplot/"))
        return _file(STATIC, name)


def _file(folder: Path, name: str) -> Response:
    """Return a file of a folder, and nothing outside of it."""
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()) or not file.is_file():
        return Response("not found", 404)
    kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    return Response(file.read_bytes(), media_type=kind)
