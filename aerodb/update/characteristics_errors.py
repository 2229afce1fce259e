"""Standard errors of flying qualities and performance: the characteristics of databases drawn from the joint covariance of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, SchemaError

from .posterior import draw, drawn

if TYPE_CHECKING:
    from flightmech import Aircraft
    from flightmech.flying_qualities.evaluation import Characteristics

_LEAST = 10  # draws: a standard deviation of fewer is uncertain by more than a quarter
_MODE = ("omega_n", "damping_ratio")


def with_standard_errors(
    found: Characteristics, aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, float], count: int = 50, seed: int = 1
) -> Characteristics:
    """Return characteristics with the standard errors that follow from those of the database.

    Parameters
    ----------
    found : Characteristics
        Of the database itself, from `flightmech.characteristics`.
    aircraft, db, condition
        As there; mass, c.g., inertia and thrust count as known.
    count : int
        Databases to draw, 10 or more; each takes as long as one call of `flightmech.characteristics`.
    seed : int
        Of the random numbers.

    Returns
    -------
    Characteristics
        ``table`` with the column ``stderr``, ``modes`` with ``omega_n_stderr`` and ``damping_ratio_stderr``: standard deviations over the
        draws in which a quantity exists; NaN when these are fewer than 10.

    Raises
    ------
    SchemaError
        Fewer than 10 draws, or draws that cannot be trimmed and leave fewer.
    """
    if count < _LEAST:
        raise SchemaError("samples", [f"{count} draws; give {_LEAST} or more"])
    from flightmech import characteristics

    values = draw(db, count, seed)
    tables, modes, failures = [], [], []
    for k in range(count):
        try:
            one = characteristics(aircraft, drawn(db, {name: nodes[k] for name, nodes in values.items()}), condition)
        except AeromatchError as error:
            failures.append(str(error))
            continue
        tables.append(one.table["value"])
        modes.append(one.modes.drop_duplicates("mode").set_index("mode")[list(_MODE)])
    if len(tables) < _LEAST:
        raise SchemaError("samples", [f"{len(failures)} of {count} draws cannot be evaluated; the first: {failures[0]}"])
    spread = pd.concat(tables, axis=1).apply(_deviation, axis=1)
    of_modes = {name: pd.concat([one[name] for one in modes], axis=1).apply(_deviation, axis=1) for name in _MODE}
    errors = {f"{name}_stderr": found.modes["mode"].map(deviations) for name, deviations in of_modes.items()}
    return replace(found, table=found.table.assign(stderr=spread.reindex(found.table.index)), modes=found.modes.assign(**errors))


def _deviation(values: pd.Series) -> float:
    known = values.to_numpy(float)
    known = known[np.isfinite(known)]
    return float(known.std(ddof=1)) if len(known) >= _LEAST else float("nan")
