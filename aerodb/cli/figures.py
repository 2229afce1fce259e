"""The verb ``figures`` of ``aeromatch db``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from flightmech.support.console import InputFile, document, json_option, progress, table

if TYPE_CHECKING:
    import pandas as pd

_FIGURE_FILE = InputFile(path_type=Path)
_OWN = ("datcom", "final")  # databases of the folder that `aeromatch match` writes


@click.command()
@click.argument("places", metavar="FOLDER | DB [DB]", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--lr743", "set_of_it", is_flag=True, help="Figures 1 to 4 and 9 to 17, tables 1 and 2, and drag polars.")
@click.option("--aircraft", type=_FIGURE_FILE, help="Aircraft file (TOML) of all databases, for stall and trimmed polars.")
@click.option(
    "--flown", "flown_file", type=_FIGURE_FILE, help="File flown.nc as `aeromatch match` writes it: test points, sweeps, local estimates."
)
@click.option("--buffet", type=_FIGURE_FILE, help="Buffet boundary, clean: CSV with the columns mach and CL.")
@click.option(
    "--format", "kind", type=click.Choice(["svg", "png", "pdf"]), default="svg", show_default=True, help="File format of the figures."
)
@click.option("-o", "--output", required=True, type=click.Path(file_okay=False, path_type=Path), help="New folder for the set.")
@json_option
def figures(
    places: tuple[Path, ...],
    set_of_it: bool,
    aircraft: Path | None,
    flown_file: Path | None,
    buffet: Path | None,
    kind: str,
    output: Path,
    as_json: bool,
) -> None:
    """Write the figures and tables of LR-743 from data, and state of each that cannot be made what is missing.

    FOLDER is one that `aeromatch match` or `aeromatch demo` wrote: its a-priori and final database, their aircraft and flown.nc are
    taken. Or give one DB, or the a-priori and the final one.
    """
    if not set_of_it:
        raise click.UsageError("no set of figures; give --lr743")
    from flightmech import read_aircraft

    from ..figures import read_flown, write_lr743
    from ..store.files import open

    files, crafts, flown_file = _inputs(places, aircraft, flown_file)
    databases = {name: open(file) for name, file in files.items()}
    sources = ", ".join(str(file) for file in [*files.values(), *([flown_file] if flown_file else [])])
    with progress("draw the figures"):
        made = write_lr743(
            databases,
            output,
            kind,
            aircraft={name: read_aircraft(file) for name, file in crafts.items()},
            flown=read_flown(flown_file) if flown_file else None,
            buffet=None if buffet is None else _boundary(buffet),
            sources=sources,
        )
    if as_json:
        document({"folder": str(output), "figures": [{**one._asdict(), "file": one.file and str(one.file)} for one in made]})
        return
    table(["", "shows", "file"], [(one.number, one.title, one.file.name if one.file else "-") for one in made])
    for one in made:
        if one.missing:
            click.echo(f"{one.number or one.title} cannot be drawn: {one.missing}")
    click.echo(f"written: {sum(one.file is not None for one in made)} of {len(made)} in {output}")


def _inputs(places: tuple[Path, ...], aircraft: Path | None, flown: Path | None) -> tuple[dict[str, Path], dict[str, Path], Path | None]:
    """Return databases and aircraft by name, and the file of what was flown."""
    from ..figures.lr743_set.flown import FLOWN

    if len(places) == 1 and places[0].is_dir():
        folder = places[0]
        files = {name: folder / f"{name}.nc" for name in _OWN}
        lacking = [file.name for file in files.values() if not file.is_file()]
        if lacking:
            raise click.UsageError(
                f"{folder} holds no {' and no '.join(lacking)}; name a folder that `aeromatch match` wrote, or databases"
            )
        crafts = {name: aircraft or folder / f"{name}.toml" for name in _OWN}
        return files, crafts, flown or next((file for file in (folder / FLOWN,) if file.is_file()), None)
    if len(places) > 2 or any(place.is_dir() for place in places):
        raise click.UsageError("give one folder that `aeromatch match` wrote, one database, or the a-priori and the final database")
    names = [place.stem for place in places]
    names = names if len(set(names)) == len(names) else [str(place.with_suffix("")) for place in places]
    files = dict(zip(names, places))
    return files, dict.fromkeys(files, aircraft) if aircraft else {}, flown


def _boundary(path: Path) -> pd.DataFrame:
    """Return Mach number and lift coefficient of the buffet boundary."""
    import pandas as pd

    from flightmech.errors import ParseError

    try:
        found = pd.read_csv(path, comment="#")
        found = found.rename(columns=lambda name: str(name).strip())[["mach", "CL"]].astype(float)
    except (KeyError, ValueError) as error:
        raise ParseError(str(path), 1, str(error), "a table with the columns mach and CL, numbers separated by commas") from None
    if found.isna().any(axis=None) or len(found) < 2:
        raise ParseError(str(path), 1, "missing numbers, or fewer than two points", "two or more rows with a number for mach and for CL")
    return found.sort_values("mach", ignore_index=True)
