"""Server of the workbench on 127.0.0.1: pages, data, actions and jobs."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import math
import mimetypes
import socket
import threading
import traceback
from collections.abc import Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from aeromatch.workbench import actions, databases, identification, matching, records
from aeromatch.workbench.allowed_actions import ActionError, demand_allowed, is_writable_text
from aeromatch.workbench.new_project import aircraft_data, column_edits, draft, recorded_columns
from aeromatch.workbench.new_project.dropped_files import receive_file
from aeromatch.workbench.opened import MATCH, OpenProject
from aeromatch.workbench.processes import Jobs, WorkbenchJob
from aeromatch.workbench.requests.guard import REPORTS, Guard, is_same_secret, kept_token
from aeromatch.workbench.requests.request_body import read_body, stream_body
from flightmech.errors import AeromatchError
from flightmech.support.console import to_json_types
from flightmech.support.input_files import load_json
from pom.report.writer import PARTS

# Function of a route: project, query and body to plain data or bytes.
DataFunction = Callable[[OpenProject, Mapping[str, str], Any], Any]

STATIC = Path(__file__).parent / "static"
_UPLOT = Path(__file__).parents[2] / "pom" / "report" / "static" / "uplot"
UPLOAD = "/api/new/file"
"""Path of requests whose body is a dropped file."""
NEW_PROJECT_ROUTES = {
    **draft.ROUTES,
    **column_edits.ROUTES,
    **aircraft_data.ROUTES,
    **recorded_columns.ROUTES,
}
# Greatest time that a request waits for the end of its job. [s]
_MOST_WAIT = 60.0
# Greatest number of digits of the number of a job.
_MOST_DIGITS = 9


class Workbench:
    """The workbench of a project: its data, its actions, its server.

    Parameters
    ----------
    opened : OpenProject
    port : int
        Port of the server; 0 for a free port.
    """

    def __init__(self, opened: OpenProject, port: int = 0) -> None:
        self.opened = opened
        opened.work.mkdir(parents=True, exist_ok=True)
        self.token = kept_token(opened.work / "token")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(("127.0.0.1", port))
        self.port = self.socket.getsockname()[1]
        # Digests of the files of a running job, by its number.
        self._digests: dict[int, dict[str, str]] = {}
        self._log_lock = threading.Lock()
        self.jobs = Jobs(
            opened.work / "jobs",
            opened.places.project,
            real=opened.places.real,
            before=self._before_job,
            after=self._after_job,
        )
        opened.run = self.jobs.run
        self.ticket = hmac.new(self.token.encode(), b"report", hashlib.sha256).hexdigest()

    @property
    def address(self) -> str:
        """Address of the page.  Browsers do not send the part after ``#`` to a server."""
        return f"http://127.0.0.1:{self.port}/#token={self.token}"

    def app(self) -> Any:
        """Return the ASGI application."""

        @asynccontextmanager
        async def lifespan(app: Starlette):
            yield
            self.jobs.stop()

        functions = {
            **records.ROUTES,
            **identification.ROUTES,
            **databases.ROUTES,
            **matching.ROUTES,
            **NEW_PROJECT_ROUTES,
            ("POST", "/api/act"): self._act,
            ("GET", "/api/jobs"): self._jobs,
            ("POST", "/api/cancel"): self._cancel,
            ("GET", "/api/output"): self._output,
            ("GET", "/api/actions"): self._actions,
        }
        routes = []
        for (method, path), function in functions.items():
            routes.append(Route(path, self._make_endpoint(function), methods=[method]))
        routes.append(Route(UPLOAD, self._upload, methods=["POST"]))
        # The last route has any name, so its order matters.
        routes += [
            Route(REPORTS + "{ticket}/{name:path}", self._report, methods=["GET"]),
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
        """Read the first record while the browser starts, and import the packages for it."""
        # The page reports the errors of a record.
        with contextlib.suppress(AeromatchError, OSError):
            self.opened.record(next(iter(self.opened.project.flights), ""))

    def _make_endpoint(self, function: DataFunction) -> Callable[[Request], Any]:
        """Return the endpoint of a function, with its errors as responses."""

        async def respond(request: Request) -> Response:
            body = None
            if request.method == "POST":
                try:
                    body = _parse_body(await read_body(request))
                except ClientDisconnect:
                    # nobody reads the response
                    return _refuse_request("the body is not complete", 400)
                except AeromatchError as error:
                    return _describe_error(error)
                except (ValueError, RecursionError) as error:
                    return _refuse_request(f"the body is not a JSON of the page: {error}", 400)
            query = dict(request.query_params)
            if not all(map(is_writable_text, (*query, *query.values()))):
                return _refuse_request("a zero byte in the query", 400)
            try:
                content = await run_in_threadpool(function, self.opened, query, body)
                if isinstance(content, bytes):
                    return Response(content, media_type="application/octet-stream")
                return AsciiJson(to_json_types(content))
            except (AeromatchError, OSError) as error:
                return _describe_error(error)
            # Values of another type than the page sends, in places that no check names.
            except Exception as error:
                traceback.print_exc()
                reason = f"the request cannot be answered ({type(error).__name__}: {error})"
                return _refuse_request(f"{reason}; the terminal of the server has details", 422)

        return respond

    def _act(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        """Queue a command of the page, and wait for its end on request."""
        words = body.get("words") if isinstance(body, dict) else None
        if not isinstance(words, list):
            words = []
        wait = _parse_wait(body)
        demand_allowed(words, opened.places)
        job = self.jobs.add(words)
        if wait > 0.0:
            job = self.jobs.wait(job.number, min(wait, _MOST_WAIT))
        return self._describe_job(job)

    def _describe_job(self, job: WorkbenchJob) -> dict[str, Any]:
        return {**job.about(), "command": job.title or self.opened.places.command(job.words)}

    def _jobs(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        """Return all jobs, and the address of the report."""
        rows = [self._describe_job(job) for job in self.jobs.list_all()]
        return {"jobs": rows, "report": self._report_address()}

    def _cancel(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        """Cancel a job."""
        job = self._find_job(body.get("number") if isinstance(body, dict) else None)
        self.jobs.cancel(job.number)
        return self._describe_job(job)

    def _output(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        """Return a job with its output."""
        number = query.get("number", "")
        is_number = number.isdecimal() and len(number) <= _MOST_DIGITS
        job = self._find_job(int(number) if is_number else None)
        return {
            **self._describe_job(job),
            "out": actions.read_command_output(job.out),
            "err": actions.read_command_output(job.err),
        }

    def _find_job(self, number: Any) -> WorkbenchJob:
        # True is an int of Python
        if type(number) is not int or number not in self.jobs.jobs:
            raise ActionError(f"no job {number}; there are {len(self.jobs.jobs)}")
        return self.jobs.jobs[number]

    def _actions(self, opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
        """Return the log of the actions."""
        entries = actions.read_action_log(opened.log) if opened.log.exists() else []
        rows = []
        for entry in entries:
            command = opened.places.command(entry.words)
            rows.append({"number": entry.number, "command": command, "files": list(entry.files)})
        return {"log": opened.places.named(opened.log), "actions": rows}

    def _before_job(self, job: WorkbenchJob) -> None:
        actions.make_folders(job.words, self.opened.places)
        self._digests[job.number] = actions.hash_named_files(job.words, self.opened.places)

    def _after_job(self, job: WorkbenchJob) -> None:
        """Log a command that has changed files."""
        before = self._digests.pop(job.number)
        after = actions.hash_named_files(job.words, self.opened.places)
        files = actions.changed_files(before, after)
        if files:
            with self._log_lock:
                actions.append_action(self.opened.log, job.words, job.code or 0, files)
        if job.words[0] == "init":
            draft.keep_draft(self.opened, actions.read_command_output(job.out))

    async def _upload(self, request: Request) -> Response:
        """Write a dropped file into the folder of the project."""
        name = request.query_params.get("name", "")
        length = request.headers.get("content-length")
        try:
            result = await receive_file(self.opened, name, length, stream_body(request))
        except (AeromatchError, OSError) as error:
            return _describe_error(error)
        except ClientDisconnect:
            # nobody reads the response, and the file is not written
            return _refuse_request("the file is not complete", 400)
        return AsciiJson(result)

    def _report_address(self) -> str | None:
        """Return the address of the report of the match; None without any report."""
        folders = [self.opened.work / MATCH / "report"]
        folders += (self.opened.work / matching.RUNS).glob("*")
        if not any((folder / "report.html").exists() for folder in folders):
            return None
        return f"{REPORTS}{self.ticket}/{MATCH}/report/report.html"

    async def _report(self, request: Request) -> Response:
        if not is_same_secret(request.path_params["ticket"], self.ticket):
            return Response("wrong ticket", 403)
        return self._send_report_file(request.path_params["name"])

    def _send_report_file(self, name: str) -> Response:
        """Return a file of the report of the match or of a trial; no other file is served.

        The working folder also has the token and the log.
        """
        for place in (f"{MATCH}/report", f"{matching.RUNS}/*"):
            parts = name.split("/")
            folder, inner = parts[:2], parts[2:]
            if not inner or not PurePosixPath(*folder).match(place) or inner[0] not in PARTS:
                continue
            return _send_file(self.opened.work.joinpath(*folder), "/".join(inner))
        return Response("not found", 404)

    async def _static(self, request: Request) -> Response:
        name = request.path_params.get("name", "") or "index.html"
        if name.startswith("uplot/"):
            return _send_file(_UPLOT, name.removeprefix("uplot/"))
        return _send_file(STATIC, name)


class AsciiJson(JSONResponse):
    """A JSON whose other characters are escaped: a file name may have half a surrogate pair."""

    def render(self, content: Any) -> bytes:
        """Return the bytes of a content."""
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode("ascii")


def _parse_body(text: bytes) -> Any:
    """Return the content of a body; raise ValueError for texts that a file cannot have."""
    body = load_json(text or b"null")
    # the texts of a JSON, without their escape sequences
    if not is_writable_text(json.dumps(body, ensure_ascii=False).replace("\\u0000", "\0")):
        raise ValueError("a text with a zero byte or half a surrogate pair")
    return body


def _parse_wait(body: Any) -> float:
    """Return the time that a request waits for the end of its job. [s]"""
    wait = body.get("wait", 0.0) if isinstance(body, dict) else 0.0
    if isinstance(wait, bool) or not isinstance(wait, int | float) or not 0.0 <= wait < math.inf:
        raise ActionError(f"wait is {wait!r}; it is a time of 0 s or more")
    return float(min(wait, _MOST_WAIT))


def _refuse_request(text: str, status: int) -> Response:
    return AsciiJson({"error": "request", "text": text}, status)


def _describe_error(error: Exception) -> Response:
    """Return an error with all its problems as a response."""
    problems = list(getattr(error, "problems", ()))
    content = {"error": type(error).__name__, "text": str(error), "problems": problems}
    return AsciiJson(content, getattr(error, "status", 400))


def _send_file(folder: Path, name: str) -> Response:
    """Return a file of a folder as a response; files outside of the folder are not found."""
    try:
        file = (folder / name).resolve()
        if not file.is_relative_to(folder.resolve()) or not file.is_file():
            return Response("not found", 404)
        content = file.read_bytes()
    # a zero byte, a name that is too long, a circle of links, a file without permission
    except (OSError, ValueError, RuntimeError):
        return Response("not found", 404)
    media_type = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    return Response(content, media_type=media_type)
