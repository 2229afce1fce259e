"""The verbs ``compare`` and ``plot`` of ``aeromatch db``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress, remark, table

if TYPE_CHECKING:
    import pandas as pd

_FILE = InputFile()
_ALONG = "netCDF-4 with states over time, as `aeromatch flight reconstruct` writes it."


@click.command()
@click.argument("first", metavar="A", type=_FILE)
@click.argument("second", metavar="B", type=_FILE)
@click.option("--along", type=_FILE, help=f"Compare along a flight instead of a grid: {_ALONG}")
@click.option("--coefficient", "wanted", multiple=True, help="Only this coefficient and its terms, such as CL; may be repeated.")
@click.option("--figures", type=click.Path(file_okay=False), help="New folder for figures of all shared terms and coefficients.")
@click.option(
    "--format", "kind", type=click.Choice(["svg", "png", "pdf"]), default="svg", show_default=True, help="File format of the figures."
)
@json_option
def compare(first: str, second: str, along: str | None, wanted: tuple[str, ...], figures: str | None, kind: str, as_json: bool) -> None:
    """Compare two databases, B less A, by coefficient and by term: largest and rms difference, where, in standard errors."""
    from flightmech.errors import UnknownName

    from ..comparison.comparison import compare as compared
    from ..store.files import open

    databases = {label: open(path) for label, path in _labels(first, second).items()}
    a, b = databases.values()
    conditions, notes = None, list[str]()
    if along is not None:
        from ..comparison.along_record import read_conditions

        conditions, notes = read_conditions(along, a, b)
    with progress("compare the databases"):
        frame = compared(a, b, conditions)
    known = list(dict.fromkeys(name.split("/")[0] for name in frame.index))
    for name in wanted:
        if name not in known:
            raise UnknownName(name, known, "coefficient")
    frame = frame[[not wanted or name.split("/")[0] in wanted for name in frame.index]]
    frame.attrs["grid"] = {name: words for name, words in frame.attrs["grid"].items() if not wanted or name in wanted}
    written: list[str] = []
    if figures is not None:
        from ..figures.figure_folder import write_comparison

        with progress("draw the figures of shared terms and coefficients"):
            written = [str(path) for path in write_comparison(databases, figures, kind, coefficients=wanted, support=conditions)]
    for text in notes:
        remark(text)
    if as_json:
        document({"a": first, "b": second, "along": along, "grid": frame.attrs["grid"], "rows": frame, "figures": written})
        return
    click.echo(f"a = {first}, b = {second}; differences are b - a")
    _print(frame)
    if written:
        click.echo(f"\nwritten: {len(written)} figures in {figures}")


@click.command()
@click.argument("file", type=_FILE)
@click.option("--term", required=True, help="Such as CL/basic; a coefficient, CL, will do as well.")
@click.option("--family", help="Variable that distinguishes the curves, such as mach or delta_f.")
@click.option("--over", help="The abscissa; alpha unless given, where the term has it.")
@click.option("--at", "held", multiple=True, metavar="NAME=VALUE", help="Value of another variable: delta_f='40 deg', mach=0.3 and so on.")
@click.option("--along", type=_FILE, help=f"Mark where flight samples lie: {_ALONG}")
@click.option("-o", "--output", required=True, type=NewFile(), help="The figure: .svg, .png or .pdf.")
def plot(file: str, term: str, family: str | None, over: str | None, held: tuple[str, ...], along: str | None, output: str) -> None:
    """Draw a term of a database: a family of curves with standard errors and the sources of its nodes."""
    from ..comparison.along_record import read_conditions
    from ..figures.drawing import save_figure
    from ..figures.figures import plot_comparison
    from ..store.files import open

    tree = open(file)
    support = None if along is None else read_conditions(along, tree)[0]
    (label,) = _labels(file)
    with progress("draw the figure"):
        figure = plot_comparison({label: tree}, term, family, over=over, at=dict(_held(text) for text in held), support=support)
        save_figure(figure, output)
    click.echo(f"written: {output}")


def _labels(*paths: str) -> dict[str, str]:
    """Return short names of files, with as much of their folders as distinguishes them."""
    from pathlib import Path

    for parts in range(1, max(len(Path(path).resolve().parts) for path in paths)):
        found = {"/".join(Path(path).resolve().with_suffix("").parts[-parts:]): path for path in paths}
        if len(found) == len(paths):
            return found
    return dict(zip("ab", paths))


def _held(text: str) -> tuple[str, float]:
    from flightmech.errors import SchemaError
    from flightmech.names import lookup
    from flightmech.units import quantity

    name, sign, value = (part.strip() for part in text.partition("="))
    if not (name and sign and value):
        raise SchemaError("--at", [f"found {text!r}; give NAME=VALUE, such as delta_f='40 deg'"])
    try:
        number: float | str = float(value)
    except ValueError:
        number = value
    return name, quantity(number, lookup(name).units)


def _print(frame: pd.DataFrame) -> None:
    """Print coefficients, terms that differ, and in a line each what is equal or on one side only."""
    along = "share" in frame
    is_term = frame.index.str.contains("/")
    same = is_term & (frame["max_difference"] == 0.0) & (frame["found_in"] == "both")
    for part, head in ((frame[~is_term], "coefficient"), (frame[is_term & ~same], "term")):
        columns = [head, "in", "largest", "a", "b", "rms", "/ s.e. a", "/ s.e. b", "/ s.e. b-a"]
        more = ["share", "rms left"] if along and head == "term" else []
        rows = [_cells(name, row, bool(more)) for name, row in part.iterrows()]
        click.echo()
        table([*columns, *more, "where", "note"], rows, right=[*columns[2:], *more])
    for words, names in (
        ("only in a", frame.index[is_term & (frame["found_in"] == "a")]),
        ("only in b", frame.index[is_term & (frame["found_in"] == "b")]),
        ("no difference", frame.index[same]),
    ):
        if len(names):
            click.echo(f"\n{words}: {' '.join(names)}")
    for text in dict.fromkeys(f"{name}: {words}" if not along else words for name, words in frame.attrs["grid"].items()):
        click.echo(f"\ncompared over {text}" if along else f"\ngrid of {text}")


def _cells(name: Any, row: pd.Series, shares: bool) -> list[str]:
    numbers = ("max_difference", "value_a", "value_b", "rms_difference")
    ratios = ("max_in_stderr", "max_in_stderr_b", "max_in_stderr_difference")
    cells = [name, row["found_in"], *(_number(row[key], 4) for key in numbers), *(_number(row[key], 3) for key in ratios)]
    if shares:
        cells += ["" if row["share"] != row["share"] else f"{round(100 * row['share'], 1) + 0.0:.1f} %", _number(row["rms_left"], 4)]
    return [*cells, row["location"], row["note"]]


def _number(value: float, digits: int) -> str:
    return "" if value != value else f"{value:.{digits}g}"
