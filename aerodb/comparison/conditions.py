"""Conditions from a flight record: the samples at which databases are compared."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.evaluation import contributions
from aerodb.store.overview import FREE_AIR, display_text, plain_number
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.build_up import COEFFICIENTS
from flightmech.errors import OutOfRange, ParseError, UnknownName
from flightmech.names import VOCABULARY, lookup, quantity_attributes
from flightmech.units import DEGREE, from_si

TABLES = ("value", "K1", "K2")
# ends of a variable that multiplies tables and is no axis of any: what brisk manoeuvres of a
# trainer or business jet reach [SI]
REACH: dict[str, tuple[float, ...]] = {
    "alpha": (-5 * DEGREE, 10 * DEGREE),
    "beta": (-10 * DEGREE, 10 * DEGREE),
    "phi": (-30 * DEGREE, 30 * DEGREE),
    "phat": (-0.05, 0.05),
    "qhat": (-0.005, 0.005),
    "rhat": (-0.02, 0.02),
    "alphadothat": (-0.005, 0.005),
    "betadothat": (-0.02, 0.02),
    "dnz": (-1.0, 1.0),
    "CT": (0.0, 0.2),
    "CL": (0.0, 1.5),
    "CD": (0.0, 0.2),
    "CX": (-0.2, 0.2),
    "CZ": (-1.5, 0.0),
    **dict.fromkeys(("CY", "Cl", "Cm", "Cn"), (-0.05, 0.05)),
    "h_agl": (2.0, 5.0, 15.0, FREE_AIR),
    **dict.fromkeys(("gear", "speedbrake"), (0.0, 1.0)),
    **dict.fromkeys(
        ("delta_e", "delta_a", "delta_r", "delta_t", "delta_ta", "delta_tr", "delta_d"),
        (-10 * DEGREE, 10 * DEGREE),
    ),
    **dict.fromkeys(("delta_f", "delta_s"), (0.0, 40 * DEGREE)),
}
_IN_FULL = ("mach", "alpha")

Place = Callable[[int], str]
Conditions = Mapping[str, Any] | xr.Dataset


def leaf_breakpoints(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the axes of all tables of a leaf with their breakpoints. [SI]"""
    return {
        str(axis): leaf[table][axis].values.astype(float)
        for table in TABLES
        if table in leaf
        for axis in leaf[table].dims
    }


def merge_leaf_breakpoints(leaves: Iterable[xr.Dataset]) -> dict[str, np.ndarray]:
    """Return the breakpoints of all axes of several leaves, merged axis by axis. [SI]"""
    points: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis, values in leaf_breakpoints(leaf).items():
            points[axis] = np.union1d(points.get(axis, []), values)
    return points


def mesh_samples(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the product of breakpoints as samples, each (samples,)."""
    return (
        dict(zip(points, (grid.ravel() for grid in np.meshgrid(*points.values(), indexing="ij"))))
        if points
        else {}
    )


def neutral_value(name: str, points: np.ndarray) -> float:
    """Return the value of a variable that is at rest: zero or what is nearest to it in range, the
    highest `h_agl`: free air. [SI]
    """
    return float(points[-1] if name == "h_agl" else np.clip(0.0, points[0], points[-1]))


def coefficient_points(
    ours: Sequence[xr.Dataset], theirs: Sequence[xr.Dataset]
) -> dict[str, np.ndarray]:
    """Return what the grid of a coefficient takes of every variable: the breakpoints of both in the
    range that both cover.

    Returns
    -------
    dict of str to array
        Empty arrays where the ranges do not meet; `REACH` for variables that are no axis of any
        table; 0 for others. [SI]
    """
    of_a, of_b = merge_leaf_breakpoints(ours), merge_leaf_breakpoints(theirs)
    found = {}
    for name in sorted(
        {v for leaf in [*ours, *theirs] for v in _terms.list_model_variables(leaf)},
        key=_place_in_vocabulary,
    ):
        sides = [points[name] for points in (of_a, of_b) if name in points]
        if not sides:
            found[name] = np.array(REACH.get(name, (0.0,)))
            continue
        low, high = max(p[0] for p in sides), min(p[-1] for p in sides)
        both = np.unique(np.concatenate([*sides, [low, high]]))
        found[name] = both[(both >= low) & (both <= high)]
    return found


def coefficient_grid(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the conditions at which a coefficient is compared, each (samples,). [SI]"""
    full = {name: points[name] for name in _IN_FULL if name in points}
    rest = {
        name: neutral_value(name, values) for name, values in points.items() if name not in full
    }
    turns = [rest] + [
        {**rest, name: float(x)}
        for name, at_rest in rest.items()
        for x in points[name]
        if x != at_rest
    ]
    base = mesh_samples(full) or {"": np.zeros(1)}
    count = len(next(iter(base.values())))
    grid = {name: np.tile(values, len(turns)) for name, values in base.items() if name}
    return {
        name: grid[name] if name in grid else np.repeat([turn[name] for turn in turns], count)
        for name in points
    }


def grid_text(points: Mapping[str, np.ndarray]) -> str:
    """Return the grid of a coefficient in words: ranges in display units with the number of points."""
    full = " x ".join(_range(name, points[name]) for name in _IN_FULL if name in points)
    turns = ", ".join(
        _range(name, values)
        for name, values in points.items()
        if name not in _IN_FULL and len(values) > 1
    )
    return " with, in turn, ".join(text for text in (full, turns) if text) or "one condition"


def condition_text(
    samples: Mapping[str, np.ndarray],
    names: Iterable[str],
    prefix: Callable[[int], str] | None = None,
) -> Place:
    """Return a function that gives the condition of one sample in display units."""
    names = list(names)

    def at(i: int) -> str:
        where = ", ".join(f"{name} {display_text(name, samples[name][i])}" for name in names)
        return where if prefix is None else ": ".join(text for text in (prefix(i), where) if text)

    return at


def order_names(names: Iterable[str]) -> list[str]:
    """Return names of variables, mach and alpha first, the others as the vocabulary has them."""
    return sorted(names, key=_place_in_vocabulary)


def _place_in_vocabulary(name: str) -> tuple[int, int]:
    first = _IN_FULL.index(name) if name in _IN_FULL else len(_IN_FULL)
    return first, list(VOCABULARY).index(name) if name in VOCABULARY else len(VOCABULARY)


def _range(name: str, points: np.ndarray) -> str:
    unit = lookup(name).display_units
    low, high = (plain_number(from_si(float(x), unit)) for x in (points[0], points[-1]))
    span = low if len(points) == 1 else f"{low} ... {high}"
    return f"{name} {span}{'' if unit == '1' else f' {unit}'} ({len(points)})"


# what a record need not hold: devices at rest, the ground far away [SI]
AT_REST = {
    "gear": 0.0,
    "speedbrake": 0.0,
    "delta_f": 0.0,
    "delta_t": 0.0,
    "delta_ta": 0.0,
    "delta_tr": 0.0,
    "delta_s": 0.0,
    "delta_d": 0.0,
}


def read_conditions(
    path: str | os.PathLike, *databases: xr.DataTree
) -> tuple[xr.Dataset, list[str]]:
    """Return the conditions that databases need from a file of one clock.

    Parameters
    ----------
    path : path
        netCDF-4: a path as ``aeromatch flight reconstruct`` writes it (group ``states``), or a
        manoeuvre of ``aeromatch flight cut``.
    *databases : DataTree
        Their variables must be in the file, with these exceptions: devices that were not recorded
        are at rest, a record without `h_agl` is free air, `dnz` follows from `nz`.

    Returns
    -------
    conditions : Dataset
        With all variables of the databases. [SI]
    notes : list of str
        What was assumed, for a person to read.

    Raises
    ------
    ParseError
        Not such a file.
    UnknownName
        A variable that a table needs is not in the file.
    """
    return fill_missing_devices(_read(Path(path)), *databases)


def fill_missing_devices(
    conditions: xr.Dataset, *databases: xr.DataTree
) -> tuple[xr.Dataset, list[str]]:
    """Return conditions with the devices that a record lacks at rest, and what was assumed; see
    `read_conditions`.
    """

    needed = {
        (name, v)
        for db in databases
        for name, leaf in terms(db).items()
        for v in _terms.list_model_variables(leaf)
    }
    added: dict[str, Any] = {}
    notes: list[str] = []
    summed: dict[str, str] = {}
    for term, name in sorted(needed):
        if name in conditions or name in added:
            continue
        if name == "dnz" and "nz" in conditions:
            added[name] = (conditions["nz"] - 1.0).assign_attrs(quantity_attributes(name))
        elif name in AT_REST or name == "h_agl":
            added[name] = ((), AT_REST.get(name, FREE_AIR), quantity_attributes(name))
            taken = f"as {display_text(name, AT_REST[name])}" if name in AT_REST else "in free air"
            notes.append(f"{name} is not in the record; taken {taken}")
        elif name in COEFFICIENTS:
            summed.setdefault(name, term)
        else:
            raise UnknownName(
                name,
                map(str, conditions.variables),
                "condition",
                f"{term} needs it and the record does not hold it",
            )
    whole = conditions.assign(added)
    found = {name: _summed(whole, name, term, databases) for name, term in summed.items()}
    notes += [
        f"{name} is not in the record; taken from the terms of the first database" for name in found
    ]
    whole = whole.assign(found)
    return whole, notes


def _summed(
    conditions: xr.Dataset, name: str, term: str, databases: Iterable[xr.DataTree]
) -> xr.DataArray:
    """Return a coefficient that the record does not hold as the first database with terms of it
    gives it.
    """

    given = {str(variable): conditions[variable] for variable in conditions}
    parts = next(
        (contributions(db, name, given, "clamp") for db in databases if name in db.children), None
    )
    if parts is None:
        raise UnknownName(
            name,
            map(str, conditions.variables),
            "condition",
            f"{term} needs it and neither record nor database holds it",
        )
    dims = ("time",) if "time" in conditions.dims else tuple(conditions.dims)
    shape = tuple(conditions.sizes[dim] for dim in dims)
    return xr.DataArray(
        np.broadcast_to(sum(parts.values()), shape).copy(),
        dims=dims,
        attrs=quantity_attributes(name),
    )


def select_covered_samples(
    conditions: Conditions, leaves: Iterable[xr.Dataset]
) -> tuple[dict[str, np.ndarray], int, Callable[[int], str], int]:
    """Return the samples at which all leaves can be evaluated.

    Parameters
    ----------
    conditions : mapping of str to array
        A Dataset, or arrays that broadcast. [SI]
    leaves : iterable of Dataset
        Terms.

    Returns
    -------
    samples : dict of str to array (samples,)
        The variables that the leaves use. [SI]
    count : int
        Number of samples.
    name : callable
        Number of a sample to ``"time 4.12 s"``, or ``"sample 7"`` for conditions without time.
    left_out : int
        Samples with a NaN.

    Raises
    ------
    UnknownName
        A variable is missing.
    OutOfRange
        No sample is left.
    """
    wanted = sorted({name for leaf in leaves for name in _terms.list_model_variables(leaf)})
    for name in wanted:
        if name not in conditions:
            raise UnknownName(
                name,
                map(str, conditions),
                "condition",
                "a term needs it; pass it with the conditions",
            )
    names = [*wanted, *(["time"] if "time" in conditions else [])]
    given = [conditions[name] for name in names]
    if isinstance(conditions, xr.Dataset):
        given = list(xr.broadcast(*given))
    columns = (
        dict(zip(names, (np.ravel(x).astype(float) for x in np.broadcast_arrays(*given))))
        if names
        else {}
    )
    size = len(columns[names[0]]) if names else 1
    whole = np.ones(size, bool)
    for name in wanted:
        whole &= np.isfinite(columns[name])
    if not whole.any():
        raise OutOfRange(
            f"no sample of {size} has a number in all of {', '.join(wanted)}; give "
            f"conditions without NaN",
            ~whole,
        )
    kept, numbers, time = (
        {name: columns[name][whole] for name in wanted},
        np.flatnonzero(whole),
        columns.get("time"),
    )

    def called(i: int) -> str:
        return (
            f"sample {numbers[i]}"
            if time is None
            else f"time {display_text('time', time[numbers[i]])}"
        )

    return kept, int(whole.sum()), called, int((~whole).sum())


def count_samples_beyond(
    pair: Iterable[xr.Dataset | None], samples: Mapping[str, np.ndarray]
) -> str:
    """Return a text that counts the samples beyond the tables of a term in `a` and `b`, empty when
    all lie inside.
    """
    texts = []
    for side, leaf in zip("ab", pair):
        outside: Any = np.zeros(1, bool)
        for axis, points in leaf_breakpoints(leaf).items() if leaf is not None else ():
            outside = outside | (samples[axis] < points[0]) | (samples[axis] > points[-1])
        if outside.any():
            texts.append(
                f"{int(outside.sum())} of {len(outside)} samples beyond the table of {side}"
            )
    return "; ".join(texts)


def _read(path: Path) -> xr.Dataset:
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: no such file; `aeromatch flight reconstruct` writes a path"
        )
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            found = tree.load()
    except (
        Exception
    ) as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 file ({type(error).__name__}: {error})",
            "a path of `aeromatch flight reconstruct`",
        ) from error
    data = found["states"] if "states" in found.children else found
    if "alpha" not in data.data_vars:
        names = ", ".join(map(str, [*data.data_vars, *data.children])) or "nothing"
        wanted = (
            "states over one clock: a path of `aeromatch flight reconstruct`, or a "
            "manoeuvre that holds alpha and mach"
        )
        raise ParseError(str(path), 0, names[:200], wanted)
    return data.to_dataset()
