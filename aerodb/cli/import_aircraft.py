"""The verb ``aeromatch db import-aircraft``: a database and its aircraft from files of another program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import InputFile, NewFile, document, json_option

from .exchange import imported, print_sampled, reader_options, reading_options

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft import Aircraft

_OF_DAVEML = ("inertia", "propulsion", "at", "names")


@click.command("import-aircraft")
@click.argument("file", type=InputFile())
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, NAME.nc; the aircraft file is NAME.toml next to it.")
@click.option("--names", multiple=True, help="Quantity of a variable of a daveml file, such as 'ALPHA_TOT_D=alpha [deg]'.")
@click.option("--inertia", type=InputFile(), help="File of mass properties, which a daveml file needs.")
@click.option("--propulsion", type=InputFile(), help="File of the thrust of a daveml aircraft.")
@click.option("--at", multiple=True, help="Input of the daveml inertia file in its units, such as CG_PCT_MAC=25.")
@reading_options
@click.option("--x-ref-mac", type=float, default=0.25, show_default=True, help="Moment reference behind the leading edge, in chords.")
@click.option("--name", default="", help="Name of the aircraft; that of the file unless given.")
@click.option("--force", is_flag=True, help="Overwrite older files.")
@json_option
def import_aircraft(
    file: str,
    output: str,
    without: tuple[str, ...],
    travel: tuple[str, ...],
    sample: float | None,
    grid: tuple[tuple[str, list[float]], ...],
    x_ref_mac: float,
    name: str,
    force: bool,
    as_json: bool,
    **daveml: Any,
) -> None:
    """Read database and aircraft from FILE, a JSBSim aircraft or a DAVE-ML aerodynamic model; the two are compiled before they are written.

    Of JSBSim come geometry, mass, inertia and c.g. with point masses and fuel; of DAVE-ML those of the inertia file, and static thrust.
    """
    import flightmech
    from flightmech.aircraft.writing import write_aircraft

    from ..exchange.recognition import recognized
    from ..store.files import save
    from ..store.overview import describe, summary

    path = Path(output)
    _demand_new(path, force)
    fmt = recognized(Path(file))
    if fmt not in ("jsbsim", "daveml"):
        raise click.UsageError(f"{file} is a file of the format {fmt}, which holds no aircraft; give a JSBSim or DAVE-ML file")
    options = reader_options(fmt, without, travel, sample, grid)
    read = _jsbsim if fmt == "jsbsim" else _daveml
    tree, aircraft = read(file, options, daveml, {"name": name, "x_ref_mac": x_ref_mac})
    sim = flightmech.compile(aircraft, tree)
    save(tree, path)
    written = write_aircraft(aircraft, path.with_suffix(".toml"))
    if as_json:
        document({"file": output, "aircraft": str(written), "format": fmt, "attributes": tree.attrs, "terms": describe(tree)})
        return
    click.echo(summary(tree))
    print_sampled(tree)
    click.echo(f"\n{aircraft.name}: mass {aircraft.mass:.1f} kg, {len(aircraft.engines)} engines, {len(sim.terms)} terms compiled")
    click.echo(aircraft.history) if aircraft.history else None
    click.echo(f"{fmt}: written {output}, {written}")


def _demand_new(path: Path, force: bool) -> None:
    """Refuse to write over older files: the database, the aircraft file, its tables."""
    if path.suffix == ".toml":
        raise click.UsageError(f"-o {path} is the aircraft file's name; give that of the database, such as {path.with_suffix('.nc')}")
    older = [file for file in (path, path.with_suffix(".toml"), *sorted(path.parent.glob(f"{path.stem}_engine*.nc"))) if file.exists()]
    if older and not force:
        raise click.UsageError(f"{', '.join(map(str, older))}: already there; give another name, or --force to overwrite")


def _jsbsim(file: str, options: dict, daveml: dict, own: dict) -> tuple[xr.DataTree, Aircraft]:
    from ..exchange.jsbsim.mass_properties import import_jsbsim_aircraft

    for key in _OF_DAVEML:
        if daveml[key]:
            raise click.UsageError(f"--{key} belongs to daveml; leave it out for jsbsim")
    return imported("jsbsim", file, options), import_jsbsim_aircraft(file, **own)


def _daveml(file: str, options: dict, daveml: dict, own: dict) -> tuple[xr.DataTree, Aircraft]:
    from ..exchange.daveml.to_database.airframe import import_daveml_aircraft

    if daveml["inertia"] is None:
        raise click.UsageError(
            "--inertia is needed: a DAVE-ML file of aerodynamics holds no mass; without an aircraft use aeromatch db import"
        )
    names = dict(_pair(text, "--names", "ALPHA_TOT_D=alpha [deg]") for text in daveml["names"])
    inputs = {key: _number(value) for key, value in (_pair(text, "--at", "CG_PCT_MAC=25") for text in daveml["at"])}
    tree = imported("daveml", file, {**options, "names": names})
    return tree, import_daveml_aircraft(tree, daveml["inertia"], daveml["propulsion"], inputs, **own)


def _pair(text: str, option: str, example: str) -> tuple[str, str]:
    key, sign, value = text.partition("=")
    if not sign or not key.strip() or not value.strip():
        raise click.UsageError(f"{option} is {text!r}; write a variable and its value, such as '{example}'")
    return key.strip(), value.strip()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise click.UsageError(f"--at has {text!r}; write a number in the unit of the file, such as CG_PCT_MAC=25") from None
