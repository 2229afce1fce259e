"""``aeromatch view PROJECT``: the workbench in the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from flightmech.support.console import InputFile


@click.command()
@click.argument("project", type=InputFile(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Working folder: reconstructed records, fits, match, log of the actions.  [default: workbench, next to the project file]",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port on 127.0.0.1.  [default: a free one]")
@click.option("--no-browser", is_flag=True, help="Print the address only.")
def view(project: Path, output: Path | None, port: int, no_browser: bool) -> None:
    """Open the workbench of a PROJECT in the browser: records, identification, database, match.

    It is served on this machine alone, to who has the printed address. What changes a file is a verb of this command line; the log
    actions.jsonl in the working folder is replayed by aeromatch match --actions.
    """
    from flightmech.errors import AeromatchError

    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as missing:
        raise AeromatchError("the workbench needs starlette and uvicorn: pip install 'aeromatch[view]'") from missing
    from ..project import read_project
    from .opened import Opened
    from .server import Workbench

    read_project(project)  # faults of the project are reported here
    bench = Workbench(Opened(project, output or project.resolve().parent / "workbench"), port)
    click.echo(f"workbench: {bench.address}")
    click.echo("end with Ctrl-C")
    if not no_browser:
        webbrowser.open(bench.address)
    bench.serve()
