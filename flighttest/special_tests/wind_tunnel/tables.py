"""Table of the points of a balance at set points, with the column map that states what it is.

`aeromatch db from-estimate` makes a database of the table. Points near a set point are averaged,
because a database has one value there; the error of the average angle is that of the slope over a
quarter of a step at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.atomic_write import folder_written_atomically
from flightmech.units import DEGREE
from flighttest.special_tests.wind_tunnel.balance import BalanceSetup

_COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
_DEFLECTIONS = ("delta_e", "delta_a", "delta_r", "delta_f")
_NEAR = 0.25  # of the step: greatest distance of a point from its set point
TABLE, COLUMNS = "points.csv", "columns.toml"
"""Names of the files in the folder."""


def average_at_set_points(data: Sequence[xr.Dataset], step: float) -> pd.DataFrame:
    """Return the coefficients at multiples of a step of the angles.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        As from `balance_coefficients`.
    step : float
        Distance of the set points of alpha, beta and the deflections. [rad]

    Returns
    -------
    DataFrame
        ``mach`` if the points have it, ``alpha_deg``, ``beta_deg``, ``delta_e_deg`` etc., the
        coefficients that all records have (CL, CD in stability axes, the others in body axes), and
        ``count``, the number of points of the average.

    Raises
    ------
    IdentificationError
        No point is near a set point, or the records have no coefficient in common.
    """
    recorded = [set(map(str, points.variables)) for points in data]
    in_all, in_any = set.intersection(*recorded), set.union(*recorded)
    names = [name for name in _COEFFICIENTS if name in in_all]
    angles = ["alpha", "beta", *(name for name in _DEFLECTIONS if name in in_any)]
    if not names:
        raise IdentificationError("the records of the balance have no coefficient in common")
    frames = []
    for points in data:
        columns = {}
        for name in (*angles, "mach"):
            if name in points:
                columns[name] = np.asarray(points[name].values, float)
            elif name != "mach":
                columns[name] = np.zeros(points.sizes["time"])
        columns |= {name: points[name].values for name in names}
        frames.append(pd.DataFrame(columns))
    table = pd.concat(frames, ignore_index=True)
    is_near = np.ones(len(table), bool)
    for name in angles:
        number = (table[name] / step).round()
        is_near &= (table[name] - step * number).abs() <= _NEAR * step
        # In degrees with few digits: equal set points are equal to the bit.
        table[f"{name}_deg"] = (step / DEGREE * number).round(6) + 0.0
    keys = [f"{name}_deg" for name in angles]
    if "mach" in table and table["mach"].notna().all():
        table["mach"] = table["mach"].round(2)
        keys.insert(0, "mach")
    if not is_near.any():
        raise IdentificationError(
            f"none of {len(table)} points lies within {_NEAR * step / DEGREE:g} deg of a multiple "
            f"of {step / DEGREE:g} deg in all angles; give the step of the sweeps"
        )
    groups = table[is_near].groupby(keys)
    averages = groups[names].mean()
    averages["count"] = groups.size()
    return averages.reset_index()


def write_balance_table(
    data: Sequence[xr.Dataset],
    setup: BalanceSetup,
    folder: str | Path,
    *,
    step: float,
    x: float,
    z: float = 0.0,
) -> int:
    """Write the averages at set points and their column map; return the number of set points.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        As from `balance_coefficients`.
    setup : BalanceSetup
        Its reference quantities are those of the coefficients.
    folder : str or Path
        New folder for ``points.csv`` and ``columns.toml``.
    step : float
        Distance of the set points. [rad]
    x, z : float
        Moment reference point of the coefficients, aft of the origin of the aircraft's drawing and
        up, because the setup does not state it. [m]
    """
    table = average_at_set_points(data, step)
    columns = {}
    for name in table:
        if str(name).endswith("_deg"):
            columns[name] = f"{str(name).removesuffix('_deg')} [deg]"
        elif name != "count":
            columns[name] = str(name)
    reference = setup.reference
    lines = [
        'program = "wind tunnel"',
        'layout = "runs"',
        'force_axes = "stability"',
        'moment_axes = "body"',
        "",
        "[reference]",
        f'S = "{reference.S!r} m2"',
        f'cbar = "{reference.c!r} m"',
        f'b = "{reference.b!r} m"',
        f'x = "{x!r} m"',
        f'z = "{z!r} m"',
        "",
        "[columns]",
        *(f'{name} = "{meaning}"' for name, meaning in columns.items()),
    ]
    with folder_written_atomically(folder, {TABLE, COLUMNS}.__contains__) as target:
        (target / TABLE).write_text(table.to_csv(index=False), encoding="utf-8")
        (target / COLUMNS).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return len(table)
