"""The verb ``aeromatch fmu trim``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from ..support.console import InputFile, json_option, progress

if TYPE_CHECKING:
    import xarray as xr

    from ..simulation.compiler import SimModel

_FILE = InputFile()
_DIGITS = 9  # behind the point: less than that is rounding
_SHOWN = ("V", "V_cas", "mach", "h", "alpha", "beta", "theta", "phi", "gamma", "hdot", "p", "q", "r", "nz", "ax", "ay")


class Pair(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return name and text of the value."""
        name, sign, text = str(value).partition("=")
        if not (name.strip() and sign and text.strip()):
            self.fail(f"{value!r} is not NAME=VALUE, such as V='175 kt'", param, ctx)
        return name.strip(), text.strip()


@click.command()
@click.argument("aircraft", type=_FILE)
@click.argument("database", type=_FILE)
@click.option(
    "--kind",
    default="level",
    show_default=True,
    help="Kind of the steady flight: level, climb, turn, sideslip, pull_up, engine_out or ground.",
)
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    type=Pair(),
    help="Fixed quantity as NAME=VALUE, such as V='175 kt', h='5000 ft', phi='30 deg' or engine1.failed=1; may be repeated.",
)
@click.option("--free", "unknowns", multiple=True, help="Unknowns to solve for instead of those of the kind, one name each.")
@json_option
@click.pass_context
def trim(ctx: click.Context, aircraft: str, database: str, kind: str, fixed: tuple, unknowns: tuple[str, ...], as_json: bool) -> None:
    """Find a steady flight of AIRCRAFT (TOML) with DATABASE (netCDF); exit code 1 when there is none inside the limits."""
    from ..simulation.model_files import compile_files
    from ..support.console import document
    from ..trimming.search import start_of
    from ..trimming.search import trim as search

    with progress("compile the model, search the steady flight"):
        sim = compile_files(aircraft, database)
        units = _units(sim)
        found = search(sim, {}, kind, unknowns or None, {name: si_value(name, text, units) for name, text in fixed})
    if as_json:
        outputs = {str(name): float(item) for name, item in found.items() if not item.dims}
        parts = {name: found[name].to_series().to_dict() for name in ("found", "left")}
        document({**found.attrs, **parts, "outputs": outputs, "start": start_of(found)})
    else:
        _print(sim, found)
    ctx.exit(0 if found.attrs["converged"] else 1)


def _units(sim: SimModel) -> dict[str, str]:
    """Return the units of every name that can be held, plain start values and inputs of all engines among them."""
    from ..simulation.kernel import INPUT, OUTPUT, PARAMETER

    rows = [row for kind in (OUTPUT, INPUT, PARAMETER) for row in sim.entries(kind)]
    plain = {row.name.removeprefix("init."): row.units for row in rows if row.name.startswith("init.")}
    engines = {row.name.removeprefix("engine1."): row.units for row in rows if row.name.startswith("engine1.")}
    return engines | plain | {row.name: row.units for row in rows}


def si_value(name: str, text: str, units: Mapping[str, str]) -> float:
    """Return the SI value of ``name=text``; a bare number is SI, and its name is judged by who takes it.

    Raises
    ------
    UnknownName
        A value with a unit for a name that has none.
    UnitError
        With the name.
    """
    from ..errors import UnitError, UnknownName
    from ..units import quantity

    try:
        return float(text)
    except ValueError:
        if name not in units:
            raise UnknownName(name, units, "name") from None
    try:
        return quantity(text, units[name])
    except UnitError as error:
        raise UnitError(f"{name}={text}: {error}") from error


def _print(sim: SimModel, found: xr.Dataset) -> None:
    from ..simulation.kernel import INPUT, OUTPUT, PARAMETER
    from ..support.console import table
    from ..units import from_si

    display = {row.name: row.display_units for kind in (PARAMETER, INPUT, OUTPUT) for row in sim.entries(kind)}

    def line(name: str, value: float, units: str) -> tuple[str, str, str]:
        unit = display.get(name) or display.get(f"init.{name}") or display.get(f"engine1.{name}", units)
        return name, f"{round(from_si(value, unit), _DIGITS) + 0.0:.6g}", unit

    unknowns = zip(found["unknown"].values, found["found"].values, found["unknown_units"].values, found["limit"].values, strict=True)
    rows = [
        (*line(str(name), float(value), str(units)), {-1: "at its lower limit", 0: "", 1: "at its upper limit"}[int(side)])
        for name, value, units, side in unknowns
    ]
    table(
        ("unknown", "value", "unit", "limit"),
        rows,
        title=f"{found.attrs['title']}, {found.attrs['kind']}: {found.attrs['verdict']}",
        right=("value",),
    )
    if found.attrs["advice"]:
        click.echo(found.attrs["advice"])
    click.echo()
    names = [*_SHOWN, *(name for name in sim.outputs if name.startswith("engine") and name.endswith(".thrust"))]
    table(("state", "value", "unit"), [line(name, float(found[name]), str(found[name].attrs["units"])) for name in names], right=("value",))
