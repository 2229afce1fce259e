"""Functions that perform the commands of `aerodb.cli.estimates`."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass
from typing import Any

import click
import numpy as np
import xarray as xr

from aerodb.estimators.build import from_estimate
from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference
from aerodb.estimators.column_map import ColumnMap, read_column_map
from aerodb.estimators.reading import read_estimates
from aerodb.estimators.vortex_lattice.estimate import from_decks
from aerodb.store.files import save
from aerodb.store.overview import describe_database, summary
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchWarning
from flightmech.quantities import finite_number, option_quantity, parse_quantity
from flightmech.support.atomic_write import write_text
from flightmech.support.console import collect_options, print_json, print_remark, print_table
from flightmech.units import DEGREE


def print_coefficients(
    files: tuple[str, ...], columns: str | None, output: str | None, as_json: bool
) -> None:
    """Perform the command ``coefficients``."""
    one = read_estimates(files, _read_map(columns))
    if output:
        write_text(output, one.numbers.to_csv(index=False))
    if as_json:
        print_json(
            {
                "program": one.program,
                "files": list(one.files),
                "reference": None if one.reference is None else asdict(one.reference),
                "controls": list(one.controls),
                "force_axes": one.force_axes,
                "moment_axes": one.moment_axes,
                "control_axes": one.control_axes,
                "numbers": one.numbers.to_dict("records"),
                "remarks": list(one.remarks),
                "cautions": list(one.cautions),
            }
        )
        return
    _print_set(one)
    if output:
        click.echo(f"written: {output}")


def _print_set(one: CoefficientSet) -> None:
    """Print reference quantities and one row per condition, coefficient by coefficient."""
    click.echo(f"{one.program}: {', '.join(one.files)}")
    if one.reference is None:
        click.echo("no reference quantities in the files")
    else:
        r = one.reference
        unit = "in m" if one.unit_stated else "in the unit of the files"
        click.echo(
            f"S {r.S:g}, cbar {r.cbar:g}, b {r.b:g}, moment centre {r.x:g} aft, {r.z:g} up, {unit}"
        )
    click.echo(
        f"forces in {one.force_axes} axes, moments and rates in {one.moment_axes} axes, controls "
        f"{' '.join(one.controls) or 'none'}"
    )
    # One row per condition and coefficient: the total, then its derivatives by variable.
    numbers = one.numbers
    variables = [name for name in numbers["variable"].unique() if name]
    rows = []
    keys = ["mach", "alpha", "beta", *one.controls, "coefficient"]
    groups: Any = numbers.groupby(keys, sort=False, dropna=False)
    for place, group in groups:
        mach, alpha, beta, *deflections, coefficient = place
        angles = [np.round(angle / DEGREE, 6) for angle in (alpha, beta, *deflections)]
        cells = ["" if np.isnan(mach) else f"{mach:g}", *(f"{angle:g}" for angle in angles)]
        values = dict(zip(group["variable"], group["value"]))
        numbers_of_row = [
            f"{values[name]:.6g}" if name in values else "" for name in ("", *variables)
        ]
        rows.append([*cells, coefficient, *numbers_of_row])
    head = ["mach", "alpha", "beta", *one.controls, "coefficient", "total"]
    head += [f"per {name}" for name in variables]
    print_table(head, rows, "angles in deg, derivatives per rad", right=head)
    for caution in one.cautions:
        print_remark(f"warning: {caution}")
    for remark in one.remarks:
        print_remark(f"note: {remark}")


@dataclass(frozen=True)
class FileMeaning:
    """Options that state what the files of another program do not state.

    Attributes
    ----------
    length_unit : str or None
        Unit of the lengths.
    controls : tuple of str
        ``NAME=SIGN CONTROL`` of each control of the program.
    columns : str or None
        Column map.
    mach : float or None
        Mach number [1].
    CD0 : float or None
        Friction drag to add [1].
    """

    length_unit: str | None
    controls: tuple[str, ...]
    columns: str | None
    mach: float | None
    CD0: float | None

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of `from_estimate`."""
        controls = {}
        for text in self.controls:
            name, equals, meaning = text.partition("=")
            if not equals or not name:
                raise click.UsageError(
                    f"--control {text!r}: expected NAME=SIGN CONTROL such as elevator=+delta_e"
                )
            controls[name.strip()] = meaning.strip()
        unit = None
        if self.length_unit is not None:
            unit = parse_quantity(f"1 {self.length_unit}", "m")
        return {
            "length_unit": unit,
            "controls": controls,
            "columns": _read_map(self.columns),
            "mach": self.mach,
            "CD0": self.CD0,
        }


@dataclass(frozen=True)
class ReferenceOptions:
    """Options of the reference quantities, each a number with its unit; all of them or none."""

    S: str | None
    cbar: str | None
    b: str | None
    x_ref: str | None

    def read(self) -> EstimateReference | None:
        """Return the reference quantities in SI; None without any option."""
        texts = {"S": self.S, "cbar": self.cbar, "b": self.b, "x-ref": self.x_ref}
        missing = [f"--{name}" for name, text in texts.items() if text is None]
        if len(missing) == len(texts):
            return None
        if missing:
            raise click.UsageError(
                f"--S, --cbar, --b and --x-ref go together; {missing[0]} is missing"
            )
        area = option_quantity("--S", str(self.S), "m2")
        chord = option_quantity("--cbar", str(self.cbar), "m")
        span = option_quantity("--b", str(self.b), "m")
        x = option_quantity("--x-ref", str(self.x_ref), "m")
        return EstimateReference(area, chord, span, x)


@collect_options(meaning=FileMeaning, reference=ReferenceOptions)
def run_from_estimate(
    aircraft: str,
    files: tuple[str, ...],
    meaning: FileMeaning,
    reference: ReferenceOptions,
    move_reference: bool,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``from-estimate``."""
    keywords = meaning.keywords()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        tree = from_estimate(
            read_aircraft(aircraft),
            files,
            reference=reference.read(),
            move_reference=move_reference,
            **keywords,
        )
    _save_and_show(tree, caught, output, as_json)


def run_estimate(
    aircraft: str,
    decks: tuple[str, ...],
    rudder: str | None,
    body: bool,
    CD0: float | None,
    move_reference: bool,
    errors: str,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``estimate``."""
    given, known = (aircraft, *decks), None
    if aircraft.lower().endswith(".toml"):
        given, known = decks, read_aircraft(aircraft)
        if not decks:
            raise click.UsageError(f"give the decks (.inp) of {aircraft} after it")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        tree = from_decks(
            given,
            known,
            rudder=_read_rudder(rudder),
            with_body=body,
            CD0=CD0,
            move_reference=move_reference,
            errors=errors,
        )
    _save_and_show(tree, caught, output, as_json)


def _read_rudder(text: str | None) -> tuple[float, float, float] | None:
    """Return share of the chord, start and end of a rudder; None without one."""
    if text is None:
        return None
    try:
        numbers = [finite_number(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 1:
        return numbers[0], 0.0, 1.0
    if len(numbers) != 3:
        raise click.UsageError(f"--rudder {text!r}: expected CHORD or CHORD,FROM,TO: 0.35,0,0.9")
    return numbers[0], numbers[1], numbers[2]


def _save_and_show(
    tree: xr.DataTree, caught: list[warnings.WarningMessage], output: str, as_json: bool
) -> None:
    """Save a database, and print it with its warnings and notes."""
    messages = []
    for warning in caught:
        if issubclass(warning.category, AeromatchWarning):
            messages.append(str(warning.message))
    save(tree, output)
    for text in messages:
        print_remark(f"warning: {text}")
    for text in str(tree.attrs["comment"]).split("; "):
        print_remark(f"note: {text}")
    if as_json:
        terms = describe_database(tree)
        print_json({"file": output, "attributes": tree.attrs, "terms": terms, "warnings": messages})
        return
    click.echo(summary(tree))
    click.echo(f"\nwritten: {output}")


def _read_map(path: str | None) -> ColumnMap | None:
    return None if path is None else read_column_map(path)
