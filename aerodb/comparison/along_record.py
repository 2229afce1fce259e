"""Conditions from a flight record: the samples at which databases are compared."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.build_up import COEFFICIENTS
from flightmech.errors import OutOfRange, ParseError, UnknownName
from flightmech.names import attrs

from ..store.number_text import FREE_AIR, readable
from .common_grid import Conditions, axes_of

# what a record need not hold: devices at rest, the ground far away [SI]
AT_REST = {"gear": 0.0, "speedbrake": 0.0, "delta_f": 0.0, "delta_t": 0.0, "delta_ta": 0.0, "delta_tr": 0.0, "delta_s": 0.0, "delta_d": 0.0}


def read_conditions(path: str | os.PathLike, *databases: xr.DataTree) -> tuple[xr.Dataset, list[str]]:
    """Return the conditions that databases need from a file of one clock.

    Parameters
    ----------
    path : path
        netCDF-4: a path as ``aeromatch flight reconstruct`` writes it (group ``states``), or a manoeuvre of ``aeromatch flight cut``.
    *databases : DataTree
        Their variables must be in the file, with these exceptions: devices that were not recorded are at rest, a record without
        `h_agl` is free air, `dnz` follows from `nz`.

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
    return completed(_read(Path(path)), *databases)


def completed(conditions: xr.Dataset, *databases: xr.DataTree) -> tuple[xr.Dataset, list[str]]:
    """Return conditions with the devices that a record lacks at rest, and what was assumed; see `read_conditions`."""
    from ..store.schema import terms

    needed = {(name, v) for db in databases for name, leaf in terms(db).items() for v in _terms.variables(leaf)}
    added: dict[str, Any] = {}
    notes: list[str] = []
    summed: dict[str, str] = {}
    for term, name in sorted(needed):
        if name in conditions or name in added:
            continue
        if name == "dnz" and "nz" in conditions:
            added[name] = (conditions["nz"] - 1.0).assign_attrs(attrs(name))
        elif name in AT_REST or name == "h_agl":
            added[name] = ((), AT_REST.get(name, FREE_AIR), attrs(name))
            taken = f"as {readable(name, AT_REST[name])}" if name in AT_REST else "in free air"
            notes.append(f"{name} is not in the record; taken {taken}")
        elif name in COEFFICIENTS:
            summed.setdefault(name, term)
        else:
            raise UnknownName(name, map(str, conditions.variables), "condition", f"{term} needs it and the record does not hold it")
    whole = conditions.assign(added)
    found = {name: _summed(whole, name, term, databases) for name, term in summed.items()}
    notes += [f"{name} is not in the record; taken from the terms of the first database" for name in found]
    whole = whole.assign(found)
    return whole, notes


def _summed(conditions: xr.Dataset, name: str, term: str, databases: Iterable[xr.DataTree]) -> xr.DataArray:
    """Return a coefficient that the record does not hold as the first database with terms of it gives it."""
    from ..store.evaluation import contributions

    given = {str(variable): conditions[variable] for variable in conditions}
    parts = next((contributions(db, name, given, "clamp") for db in databases if name in db.children), None)
    if parts is None:
        raise UnknownName(name, map(str, conditions.variables), "condition", f"{term} needs it and neither record nor database holds it")
    dims = ("time",) if "time" in conditions.dims else tuple(conditions.dims)
    shape = tuple(conditions.sizes[dim] for dim in dims)
    return xr.DataArray(np.broadcast_to(sum(parts.values()), shape).copy(), dims=dims, attrs=attrs(name))


def flat(conditions: Conditions, leaves: Iterable[xr.Dataset]) -> tuple[dict[str, np.ndarray], int, Callable[[int], str], int]:
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
    wanted = sorted({name for leaf in leaves for name in _terms.variables(leaf)})
    for name in wanted:
        if name not in conditions:
            raise UnknownName(name, map(str, conditions), "condition", "a term needs it; pass it with the conditions")
    names = [*wanted, *(["time"] if "time" in conditions else [])]
    given = [conditions[name] for name in names]
    if isinstance(conditions, xr.Dataset):
        given = list(xr.broadcast(*given))
    columns = dict(zip(names, (np.ravel(x).astype(float) for x in np.broadcast_arrays(*given)))) if names else {}
    size = len(columns[names[0]]) if names else 1
    whole = np.ones(size, bool)
    for name in wanted:
        whole &= np.isfinite(columns[name])
    if not whole.any():
        raise OutOfRange(f"no sample of {size} has a number in all of {', '.join(wanted)}; give conditions without NaN", ~whole)
    kept, numbers, time = {name: columns[name][whole] for name in wanted}, np.flatnonzero(whole), columns.get("time")

    def called(i: int) -> str:
        return f"sample {numbers[i]}" if time is None else f"time {readable('time', time[numbers[i]])}"

    return kept, int(whole.sum()), called, int((~whole).sum())


def beyond(pair: Iterable[xr.Dataset | None], samples: Mapping[str, np.ndarray]) -> str:
    """Return a text that counts the samples beyond the tables of a term in `a` and `b`, empty when all lie inside."""
    texts = []
    for side, leaf in zip("ab", pair):
        outside: Any = np.zeros(1, bool)
        for axis, points in axes_of(leaf).items() if leaf is not None else ():
            outside = outside | (samples[axis] < points[0]) | (samples[axis] > points[-1])
        if outside.any():
            texts.append(f"{int(outside.sum())} of {len(outside)} samples beyond the table of {side}")
    return "; ".join(texts)


def _read(path: Path) -> xr.Dataset:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; `aeromatch flight reconstruct` writes a path")
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            found = tree.load()
    except Exception as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(
            str(path), 0, f"no netCDF-4 file ({type(error).__name__}: {error})", "a path of `aeromatch flight reconstruct`"
        ) from error
    data = found["states"] if "states" in found.children else found
    if "alpha" not in data.data_vars:
        names = ", ".join(map(str, [*data.data_vars, *data.children])) or "nothing"
        wanted = "states over one clock: a path of `aeromatch flight reconstruct`, or a manoeuvre that holds alpha and mach"
        raise ParseError(str(path), 0, names[:200], wanted)
    return data.to_dataset()
