"""Functions that perform the commands of `aerodb.cli.exchange`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import xarray as xr

import flightmech
from aerodb.edit.ground_effect import with_height_table
from aerodb.edit.term_edits import replace_terms
from aerodb.exchange.daveml.airframe import import_daveml_aircraft
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.document.reading import read as read_daveml
from aerodb.exchange.formats import find_exporter, find_importer, recognise_format
from aerodb.exchange.jsbsim.aircraft import import_jsbsim_aircraft
from aerodb.exchange.spelling import command_spelling
from aerodb.store.files import open as open_database
from aerodb.store.files import save
from aerodb.store.overview import describe_database, summary
from aerodb.store.schema import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.names import lookup
from flightmech.quantities import finite_number, option_quantity
from flightmech.support.console import print_json, print_remark
from flightmech.terms import power_factor


def reader_options(
    fmt: str,
    without: tuple[str, ...],
    travel: tuple[str, ...],
    sample: float | None,
    grid: tuple[tuple[str, list[float]], ...],
    names: tuple[str, ...] = (),
    **reference: str | None,
) -> dict[str, Any]:
    """Return the options of the reader of a format; those that belong to another format are
    refused.

    `reference` are ``S``, ``cbar`` and ``b``.
    """
    options: dict[str, Any] = {}
    if without:
        options[_only("--without", fmt, {"jsbsim": "leave_out", "daveml": "without"})] = without
    if travel:
        options[_only("--travel", fmt, {"jsbsim": "travel"})] = dict(
            _deflection(text) for text in travel
        )
    if names:
        _only("--names", fmt, {"jsbsim": "names", "daveml": "names"})
        options["names"] = dict(_pair(text, "--names", _NAME[fmt]) for text in names)
    for name, text in reference.items():
        if text is not None:
            key = _only(f"--{name}", fmt, {"daveml": name})
            options[key] = option_quantity(f"--{name}", text, lookup(name).units)
    if sample is not None or grid:
        options |= _sampling(fmt, sample, grid)
    return options


def _sampling(
    fmt: str, sample: float | None, grid: tuple[tuple[str, list[float]], ...]
) -> dict[str, Any]:
    """Return the options of the reader for ``--sample`` and ``--grid``."""
    key = _only("--sample", fmt, {"jsbsim": "box", "daveml": "grid"})
    if sample is None:
        raise click.UsageError(
            "--grid states where functions are sampled; give --sample, the largest "
            "difference allowed, with it"
        )
    for name, points in grid:
        if key == "box" and len(points) != 2:
            raise click.UsageError(
                f"--grid {name} has {len(points)} numbers; for jsbsim give the two ends of a range"
            )
    return {"sample": sample, key: dict(grid)}


def import_with_remarks(fmt: str, file: str, options: Mapping[str, Any]) -> xr.DataTree:
    """Return the database in a file of another program; what the reader warns of is printed as a
    remark.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        with command_spelling():
            tree = find_importer(fmt)(file, **options)
    for warning in caught:
        if issubclass(warning.category, AeromatchWarning):
            print_remark(f"warning: {warning.message}")
    return tree


def print_sampled(tree: xr.DataTree) -> None:
    """Print which terms hold sampled tables, and how far the coefficients are from the file."""

    for name, leaf in terms(tree).items():
        note = str(leaf.attrs.get("sampled", leaf.attrs.get("comment", "")))
        if "sampled on" in note:
            click.echo(f"{name}: {note}")
    for line in str(tree.attrs.get("history", "")).split("\n"):
        if " differs from the file by at most " in line:
            click.echo(line)


_TABLES_ONLY = ("jsbsim", "daveml")
_HIGHEST = "1000 m"  # there a ground effect h^-1.5 has fallen to a thousandth of what it is at 10 m


def export_database(
    file: str,
    fmt: str,
    output: str,
    aircraft: str | None,
    height: str | None,
    count: int | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Perform the command ``export``."""
    taken = {
        "aircraft": _TABLES_ONLY,
        "height": _TABLES_ONLY,
        "count": ("checkcases",),
        "seed": ("checkcases",),
    }
    given: dict[str, Any] = {"aircraft": aircraft, "height": height, "count": count, "seed": seed}
    options = {key: item for key, item in given.items() if item is not None}
    for key in options:
        if fmt not in taken[key]:
            raise click.UsageError(
                f"--{key} belongs to {' and '.join(taken[key])}; leave it out for {fmt}"
            )
    if fmt == "jsbsim" and aircraft is None:
        raise click.UsageError(
            "--to jsbsim needs --aircraft: geometry, mass and engines stand in the same file"
        )
    if aircraft is not None:
        options["aircraft"] = read_aircraft(aircraft)
    tree = open_database(file)
    if fmt in _TABLES_ONLY:
        tree = _with_height_tables(tree, options.pop("height", _HIGHEST))
    find_exporter(fmt)(tree, output, **options)
    print_json({"file": output, "format": fmt}) if as_json else click.echo(f"written: {output}")


def _with_height_tables(db: xr.DataTree, height: str) -> xr.DataTree:
    """Return the database with tables in place of powers of a height; other powers stay."""

    factors = {name: power_factor(leaf) for name, leaf in terms(db).items()}
    closed = [
        name
        for name, factor in factors.items()
        if factor is not None and lookup(factor.variable).units == "m"
    ]
    if not closed:
        return db
    top = option_quantity("--height", height, "m")
    print_remark(
        f"{len(closed)} terms with a formula over the height are written as tables up to {top:g} m"
    )
    leaves = terms(db)
    return replace_terms(
        db,
        {name: with_height_table(leaves[name], top) for name in closed},
        "tables for formulas over the height",
    )


def import_database(
    file: str, output: str, as_json: bool, at: tuple[str, ...], **given: Any
) -> None:
    """Perform the command ``import``."""
    fmt = recognise_format(Path(file))
    options = reader_options(fmt, **given)
    if at:
        options[_only("--at", fmt, {"daveml": "at"})] = _fixed_inputs(at)
    tree = import_with_remarks(fmt, file, options)
    save(tree, output)
    if as_json:
        print_json(
            {
                "file": output,
                "format": fmt,
                "attributes": tree.attrs,
                "terms": describe_database(tree),
            }
        )
    else:
        click.echo(summary(tree))
        print_sampled(tree)
        click.echo(f"\n{fmt}: written {output}")


def _only(option: str, fmt: str, names: dict[str, str]) -> str:
    """Return what the reader of a format calls an option; refuse it for the other formats."""
    if fmt not in names:
        raise click.UsageError(f"{option} belongs to {' and '.join(names)}; leave it out for {fmt}")
    return names[fmt]


def _deflection(text: str) -> tuple[str, float]:
    """Return control and angle [rad] of ``delta_f=40 deg``."""

    name, sign, amount = text.partition("=")
    if not sign:
        raise click.UsageError(
            f"--travel is {text!r}; write a control and its angle, such as 'delta_f=40 deg'"
        )
    return name.strip(), option_quantity(f"--travel {name.strip()}", amount, "rad")


_OF_DAVEML = ("inertia", "propulsion", "at")
_NAME = {"jsbsim": "fcs/posElev_rad=delta_e [rad]", "daveml": "ALPHA_TOT_D=alpha [deg]"}


def import_aircraft(
    file: str,
    output: str,
    inertia: str | None,
    propulsion: str | None,
    at: tuple[str, ...],
    x_ref_mac: float,
    name: str,
    force: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Perform the command ``import-aircraft``."""
    path = Path(output)
    _demand_new(path, force)
    fmt = recognise_format(Path(file))
    if fmt not in ("jsbsim", "daveml"):
        raise click.UsageError(
            f"{file} is a file of the format {fmt}, which holds no aircraft; give a JSBSim "
            f"or DAVE-ML file"
        )
    options = reader_options(fmt, **given)
    daveml = {"inertia": inertia, "propulsion": propulsion, "at": at}
    read = _jsbsim if fmt == "jsbsim" else _daveml
    tree, aircraft = read(file, options, daveml, {"name": name, "x_ref_mac": x_ref_mac})
    sim = flightmech.compile(aircraft, tree)
    save(tree, path)
    written = write_aircraft(aircraft, path.with_suffix(".toml"))
    if as_json:
        print_json(
            {
                "file": output,
                "aircraft": str(written),
                "format": fmt,
                "attributes": tree.attrs,
                "terms": describe_database(tree),
            }
        )
        return
    click.echo(summary(tree))
    print_sampled(tree)
    click.echo(
        f"\n{aircraft.name}: mass {aircraft.mass:.1f} kg, {len(aircraft.engines)} engines, "
        f"{len(sim.terms)} terms compiled"
    )
    click.echo(aircraft.history) if aircraft.history else None
    click.echo(f"{fmt}: written {output}, {written}")


def _demand_new(path: Path, force: bool) -> None:
    """Refuse to write over older files: the database, the aircraft file, its tables."""
    if path.suffix == ".toml":
        raise click.UsageError(
            f"-o {path} is the aircraft file's name; give that of the database, such as "
            f"{path.with_suffix('.nc')}"
        )
    older = [
        file
        for file in (
            path,
            path.with_suffix(".toml"),
            *sorted(path.parent.glob(f"{path.stem}_engine*.nc")),
        )
        if file.exists()
    ]
    if older and not force:
        raise click.UsageError(
            f"{', '.join(map(str, older))}: already there; give another name, or --force to "
            f"overwrite"
        )


def _jsbsim(
    file: str, options: dict[str, Any], daveml: dict[str, Any], own: dict[str, Any]
) -> tuple[xr.DataTree, Aircraft]:

    for key in _OF_DAVEML:
        if daveml[key]:
            raise click.UsageError(f"--{key} belongs to daveml; leave it out for jsbsim")
    return import_with_remarks("jsbsim", file, options), import_jsbsim_aircraft(file, **own)


def _daveml(
    file: str, options: dict[str, Any], daveml: dict[str, Any], own: dict[str, Any]
) -> tuple[xr.DataTree, Aircraft]:

    if daveml["inertia"] is None:
        raise click.UsageError(
            "--inertia is needed: a DAVE-ML file of aerodynamics holds no mass; without an "
            "aircraft use aeromatch db import"
        )
    inputs = _fixed_inputs(daveml["at"])
    # An input that the inertia file does not have belongs to the file of aerodynamics.
    mass_model = read_daveml(daveml["inertia"])
    of_mass = {key: value for key, value in inputs.items() if _has_variable(mass_model, key)}
    fixed = {key: value for key, value in inputs.items() if key not in of_mass}
    tree = import_with_remarks("daveml", file, {**options, "at": fixed})
    return tree, import_daveml_aircraft(
        tree, daveml["inertia"], daveml["propulsion"], of_mass, **own
    )


def _fixed_inputs(texts: tuple[str, ...]) -> dict[str, float]:
    """Return the values of ``--at`` by variable."""
    pairs = [_pair(text, "--at", "CG_PCT_MAC=25") for text in texts]
    return {key: _number(value) for key, value in pairs}


def _has_variable(model: DaveModel, name: str) -> bool:
    try:
        model.find(name)
    except UnknownName:
        return False
    return True


def _pair(text: str, option: str, example: str) -> tuple[str, str]:
    key, sign, value = text.partition("=")
    if not sign or not key.strip() or not value.strip():
        raise click.UsageError(
            f"{option} is {text!r}; write a variable and its value, such as '{example}'"
        )
    return key.strip(), value.strip()


def _number(text: str) -> float:
    try:
        return finite_number(text)
    except ValueError:
        raise click.UsageError(
            f"--at has {text!r}; write a finite number in the unit of the file, such as "
            "CG_PCT_MAC=25"
        ) from None
