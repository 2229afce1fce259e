"""Derivatives of the light aircraft from DATCOM, from AVL, from VSPAERO where its output is given,
and from their blend, next to published values, as a table in Markdown.

    python benchmarks/blended_prior.py [c182.stab]

Mach 0.2, alpha 2 deg, body axes, per radian, rates on p b/2V and q cbar/2V.  Published are the
values of Roskam, Airplane Flight Dynamics, Appendix B, airplane A (a Cessna 182 at 5000 ft and 220
ft/s), in stability axes; the turn by the 2 deg of the comparison changes none of them by 6 %, but
the cross derivatives.  The sign of the aileron is that of this package.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import flightmech
from aerodb.prior import assign_roles, by_role
from datcom_io.reading.reader import listings_in, read
from flightmech.units import DEGREE, FOOT

DATA = Path(__file__).parents[1] / "data"
MACH, ALPHA = 0.2, 2.0 * DEGREE
STEP = 5.0 * DEGREE  # deflection of the slope of a table over deflections
CONTROLS = {"elevator": "+delta_e", "aileron": "+delta_a", "rudder": "-delta_r"}
GROUPS = {"Elevator": "+delta_e", "Aileron": "+delta_a", "Rudder": "-delta_r"}
PUBLISHED = {
    "CL/basic": 4.41,
    "Cm/basic": -0.613,
    "CL/qhat": 3.9,
    "Cm/qhat": -12.4,
    "CY/beta": -0.393,
    "Cl/beta": -0.0923,
    "Cn/beta": 0.0587,
    "Cl/phat": -0.484,
    "Cn/phat": -0.0278,
    "Cl/rhat": 0.0798,
    "Cn/rhat": -0.0937,
    "Cl/aileron": -0.178,
    "CY/rudder": 0.187,
    "Cl/rudder": 0.0147,
}
_AXES = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}


def sources(stab: Path | None) -> dict[str, xr.DataTree]:
    """Return the database of each source."""
    aircraft = flightmech.read_aircraft(DATA / "c182" / "aircraft.toml")
    cases = by_role(assign_roles([read(path) for path in listings_in(DATA / "c182" / "datcom")]))
    found = {"DATCOM": aerodb.from_datcom(aircraft, **cases)}
    prints = sorted((DATA / "avl").glob("*.st"))
    found["AVL"] = aerodb.from_estimate(
        aircraft, prints, length_unit=FOOT, controls=CONTROLS, CD0=0.027
    )
    if stab is not None:
        found["VSPAERO"] = aerodb.from_estimate(
            aircraft, [stab], length_unit=FOOT, controls=GROUPS, CD0=0.027
        )
    found["blend"] = aerodb.edit.blend_sources(list(found.values()), aircraft).database
    return found


def derivative(db: xr.DataTree, name: str) -> tuple[float, float] | None:
    """Return a derivative and its standard error, NaN for the slope of a basic term."""
    if name not in aerodb.terms(db):
        return None
    leaf = aerodb.terms(db)[name][["value", "stderr"]]
    _, _, contribution = name.partition("/")
    if contribution == "basic":
        pair = [_node(leaf, ALPHA + sign * 2.0 * DEGREE)[0] for sign in (1, -1)]
        return (pair[0] - pair[1]) / (4.0 * DEGREE), np.nan
    axis = _AXES.get(contribution, "")
    if axis in leaf["value"].dims:
        (high, error), (low, _) = (_node(leaf, ALPHA, **{axis: s * STEP}) for s in (1, -1))
        return (high - low) / (2.0 * STEP), error / STEP
    return _node(leaf, ALPHA)


def print_errors(found: Mapping[str, xr.DataTree]) -> None:
    """Print how many published values are within two standard errors, and how errors correlate."""
    errors: dict[str, list[float]] = {label: [] for label in found}
    for name, published in PUBLISHED.items():
        pairs = [derivative(db, name) for db in found.values()]
        if any(pair is None or not np.isfinite(pair[1]) for pair in pairs):
            continue
        for label, pair in zip(found, pairs):
            errors[label].append((pair[0] - published) / pair[1])
    for label, row in errors.items():
        within = sum(abs(error) < 2.0 for error in row)
        print(f"{label}: {within} of {len(row)} within two standard errors")
    first, second = (np.array(errors[label]) for label in ("DATCOM", "AVL"))
    correlation = first @ second / np.sqrt((first @ first) * (second @ second))
    print(f"correlation of the errors of DATCOM and AVL: {correlation:.2f}")


def _node(leaf: xr.Dataset, alpha: float, **more: float) -> tuple[float, float]:
    where = {"mach": MACH, "alpha": alpha, **more}
    at = leaf.interp({axis: x for axis, x in where.items() if axis in leaf["value"].dims})
    return float(at["value"]), float(at["stderr"])


def main(arguments: list[str]) -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    found = sources(Path(arguments[0]) if arguments else None)
    print(f"| derivative | published | {' | '.join(found)} |")
    print("|---" * (len(found) + 2) + "|")
    for name, published in PUBLISHED.items():
        cells = []
        for db in found.values():
            pair = derivative(db, name)
            text = "" if pair is None else f"{pair[0]:.3g}"
            if pair is not None and np.isfinite(pair[1]):
                text = f"{text} +- {pair[1]:.2g}"
            cells.append(text)
        print(f"| {name} | {published} | {' | '.join(cells)} |")
    print_errors(found)


if __name__ == "__main__":
    main(sys.argv[1:])
