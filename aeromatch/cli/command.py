"""The command ``aeromatch``: collects the command groups of the packages, each loaded when it is
called.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from difflib import get_close_matches
from typing import NoReturn, TextIO

import click

from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.support.command_line.parameter_checks import refuse_repeated_options
from flightmech.support.console import LazyGroup, escape_message

# group or verb: (module, one line for --help); nothing heavy is imported to print the
# help
COMMANDS = {
    "datcom": ("datcom_io.cli.group", "Read Digital DATCOM listings."),
    "db": ("aerodb.cli.group", "Build, show and compare aero databases."),
    "flight": ("flighttest.cli.group", "Read flight records, reconstruct states, identify."),
    "fmu": ("flightmech.cli.group", "Write simulation models as FMUs."),
    "pom": ("pom.cli.group", "Replay recorded inputs and judge the match."),
    "init": ("aeromatch.cli.init", "Draft a project folder from listings and recordings."),
    "schema": ("aeromatch.project.schemas", "Write JSON schemas of project files, for editors."),
    "set": ("aeromatch.project.editing", "Change one key of a project's TOML files."),
    "match": ("aeromatch.cli.verbs", "Perform the whole job of a project file."),
    "store": ("aeromatch.cli.store", "Show or clear what match keeps of its stages."),
    "package": ("aeromatch.cli.delivery", "Make, verify and compare data packages."),
    "view": ("aeromatch.cli.delivery", "Open the workbench of a project in the browser."),
    "example": ("aeromatch.cli.verbs", "Copy an example that comes with the product."),
    "demo": ("aeromatch.cli.verbs", "Perform the whole job on the shipped T-37 example."),
}

_COLLECT_AFTER = 50_000
"""New objects before a collection; 700 by default, of which imports alone make hundreds of
thousands.
"""


# American spellings of words in names of verbs, options and their values
_AMERICAN = {"maneuver": "manoeuvre", "license": "licence", "color": "colour", "center": "centre"}


def british_spelling(name: str) -> str:
    """Return a name of the command line in the spelling of the program.

    Examples
    --------
    >>> british_spelling("free-maneuver")
    'free-manoeuvre'
    """
    for american, british in _AMERICAN.items():
        name = name.replace(american, british)
    return name


class RootGroup(LazyGroup):
    """The commands in the order of the work. Their help imports none of them."""

    def resolve_command(self, ctx: click.Context, args: list[str]):
        """Name the near members when the name is unknown; refuse options given twice."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            ctx.fail(f"no command {args[0]!r}; {self._suggest(ctx, args[0])}")
        name, command, others = super().resolve_command(ctx, args)
        if command is not None:
            refuse_repeated_options(ctx, command, others)
        return name, command, others

    def _suggest(self, ctx: click.Context, name: str) -> str:
        """Return the verb of a group that has this name, else the near members."""
        places = []
        for member in COMMANDS:
            group = self.get_command(ctx, member)
            # A name that is not known ends the program, so that the groups may be imported.
            if isinstance(group, click.Group):
                verb = group.get_command(ctx, british_spelling(name))
                if verb is not None:
                    places.append(f"'aeromatch {member} {verb.name}'")
        if places:
            return f"it is {' or '.join(places)}"
        near = get_close_matches(name, COMMANDS, n=1)
        return f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(COMMANDS)}"

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the members without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.command(
    cls=RootGroup,
    package="",
    elsewhere={name: module for name, (module, _) in COMMANDS.items()},
    context_settings={
        "help_option_names": ["-h", "--help"],
        "token_normalize_func": british_spelling,
    },
)
@click.version_option(package_name="aeromatch")
def cli() -> None:
    """Make a proven flight model from Digital DATCOM and flight test.

    Exit codes: 0 done and passed, 1 a failed row or check, 2 usage or bad input, 3 internal fault.
    The verb match ends with 0 when its job is done: failed rows are its result.
    """


def main() -> None:
    """Run the command; errors and warnings of the package become one clear line, errors exit code
    2.
    """
    # most objects of a command live to its end: frequent collections find nothing to free
    gc.set_threshold(_COLLECT_AFTER)
    # the system frees the memory: to search it for cycles at the end would take 0.6 s after a match
    atexit.register(gc.freeze)
    # the matrices of flight records are small: threads of the linear algebra would wait for each
    # other, and sum in an order of their own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported, below
    try:
        _demand_own_packages()
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            _PRINTED.clear()
            # joblib replaces a worker whose memory has grown, and gives its jobs to another
            warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
            code = cli(
                prog_name="aeromatch", standalone_mode=False
            )  # click returns the code of ctx.exit() here
    except click.Abort:
        sys.exit(130)
    except click.ClickException as error:
        if isinstance(error, click.MissingParameter) and isinstance(error.param, click.Option):
            # click names the option alone
            text = f"Give it with its value: {error.param.help}"
            error = click.MissingParameter(text, error.ctx, error.param, error.param_hint)
        error.show()
        _fail("usage", error.format_message(), 2)
    except Exception as error:
        if isinstance(error, AeromatchError | OSError):
            click.echo(f"error: {escape_message(_text(error))}", err=True)
            _fail(type(error).__name__, _text(error), 2, getattr(error, "problems", ()))
        if isinstance(error, MemoryError):
            text = f"not enough memory ({_text(error)}); give less data, or a lower rate"
            click.echo(f"error: {escape_message(text)}", err=True)
            _fail("MemoryError", text, 2)
        traceback.print_exc()
        click.echo(
            "internal fault: please report the lines above with the command and its input", err=True
        )
        _fail("internal fault", f"{type(error).__name__}: {error}", 3)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(kind: str, text: str, code: int, problems: Sequence[str] = ()) -> NoReturn:
    """End with an exit code; with ``--json`` the output is a JSON document as well, ``{"error":
    {kind, text, problems}}``.
    """
    if "--json" in sys.argv[1:]:
        click.echo(
            json.dumps(
                {"error": {"kind": kind, "text": text, "problems": list(problems)}},
                ensure_ascii=False,
            )
        )
    sys.exit(code)


def _demand_own_packages() -> None:
    """Refuse to work with a package of another distribution that hides one of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from flightmech.support.imports import describe_hidden_packages, hidden_packages
    if hidden := hidden_packages():
        raise click.ClickException(describe_hidden_packages(hidden))


def _text(error: Exception) -> str:
    """Return the text of an error; one of the operating system without its number."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


_PRINTED: set[str] = set()


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning of the package as one line for the user, any other as Python does, for the
    developer.

    A sentence is printed once, however often a command reads the same file.
    """
    own = issubclass(category, AeromatchWarning)
    if own and str(message) in _PRINTED:
        return
    _PRINTED.add(str(message))
    text = (
        f"warning: {escape_message(str(message))}"
        if own
        else warnings.formatwarning(message, category, filename, lineno, line).rstrip()
    )
    click.echo(text, err=True)
