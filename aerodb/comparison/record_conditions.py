"""Conditions along a flight record, with what the record lacks."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.evaluation import contributions
from aerodb.store.overview import FREE_AIR, display_text
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.aircraft.controls import ICE
from flightmech.build_up import COEFFICIENTS
from flightmech.errors import ParseError, UnknownName
from flightmech.names import quantity_attributes
from flightmech.support.hdf5_seal import demand_self_contained

_THRUST = re.compile(r"engine\d+\.thrust")
_LEAST_QBAR = 1.0  # of a thrust coefficient [Pa]

# Values of devices that a record may lack. [SI]
AT_REST = {
    "gear": 0.0,
    "speedbrake": 0.0,
    "delta_f": 0.0,
    "delta_t": 0.0,
    "delta_ta": 0.0,
    "delta_tr": 0.0,
    "delta_s": 0.0,
    "delta_d": 0.0,
    ICE: 0.0,
}


def read_conditions(
    path: str | os.PathLike[str], *databases: xr.DataTree
) -> tuple[xr.Dataset, list[str]]:
    """Return the conditions that databases need from a file with one time axis.

    Parameters
    ----------
    path : path
        netCDF-4: a path from ``aeromatch flight reconstruct`` (group ``states``), or a manoeuvre of
        ``aeromatch flight cut``.
    *databases : DataTree
        Their variables must be in the file, with four exceptions.  Devices that are not recorded
        are neutral.  A record without `h_agl` is in free air.  `dnz` follows from `nz`.  `CT`
        follows from the thrust of the engines, `qbar` and the reference area of the first database;
        a path of an aircraft with propellers holds it.

    Returns
    -------
    conditions : Dataset
        All variables of the databases. [SI]
    notes : list of str
        Assumptions, one line each.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ParseError
        The file is not of one of these kinds.
    UnknownName
        A variable that a table needs is not in the file.
    """
    return fill_missing_devices(_read_states(Path(path)), *databases)


def fill_missing_devices(
    conditions: xr.Dataset, *databases: xr.DataTree
) -> tuple[xr.Dataset, list[str]]:
    """Return conditions with the missing devices of a record at rest, and the assumptions.

    See `read_conditions`.
    """
    needed: set[tuple[str, str]] = set()
    for db in databases:
        for term, leaf in terms(db).items():
            needed.update((term, name) for name in _terms.list_model_variables(leaf))
    added: dict[str, Any] = {}
    notes: list[str] = []
    # Coefficients that a term depends on, with the first such term.
    coefficients: dict[str, str] = {}
    thrust = _thrust_coefficient(conditions, databases)
    for term, name in sorted(needed):
        if name in conditions or name in added:
            continue
        if name == "dnz" and "nz" in conditions:
            added[name] = (conditions["nz"] - 1.0).assign_attrs(quantity_attributes(name))
        elif name == "CT" and thrust is not None:
            added[name] = thrust
        elif name in AT_REST:
            added[name] = ((), AT_REST[name], quantity_attributes(name))
            value = display_text(name, AT_REST[name])
            notes.append(f"{name} is not in the record; taken as {value}")
        elif name == "h_agl":
            added[name] = ((), FREE_AIR, quantity_attributes(name))
            notes.append(f"{name} is not in the record; taken in free air")
        elif name in COEFFICIENTS:
            coefficients.setdefault(name, term)
        else:
            hint = f"{term} needs it and the record does not hold it"
            if name == "CT":
                hint += (
                    ", nor qbar and the thrust of its engines; `aeromatch flight reconstruct` "
                    "writes it where speed and power of the propellers are recorded"
                )
            raise UnknownName(name, map(str, conditions.variables), "condition", hint)
    with_devices = conditions.assign(added)
    sums = {}
    for name, term in coefficients.items():
        sums[name] = _sum_coefficient(with_devices, name, term, databases)
        notes.append(f"{name} is not in the record; taken from the terms of the first database")
    return with_devices.assign(sums), notes


def _thrust_coefficient(
    conditions: xr.Dataset, databases: Iterable[xr.DataTree]
) -> xr.DataArray | None:
    """Return CT from the thrust of the engines of a record; None without thrust or qbar."""
    engines = [name for name in map(str, conditions.data_vars) if _THRUST.fullmatch(name)]
    areas = [float(db.attrs["S"]) for db in databases if "S" in db.attrs]
    if not engines or "qbar" not in conditions or not areas:
        return None
    # CT = net thrust of all engines / (qbar S)
    thrust = sum(conditions[name] for name in engines)
    qbar = conditions["qbar"].clip(min=_LEAST_QBAR)
    CT: xr.DataArray = thrust / (qbar * areas[0])
    return CT.assign_attrs(quantity_attributes("CT"))


def _sum_coefficient(
    conditions: xr.Dataset, name: str, term: str, databases: Iterable[xr.DataTree]
) -> xr.DataArray:
    """Return a coefficient from the first database that has terms of it."""
    with_terms = [db for db in databases if name in db.children]
    if not with_terms:
        hint = f"{term} needs it and neither record nor database holds it"
        raise UnknownName(name, map(str, conditions.variables), "condition", hint)
    variables = {str(variable): conditions[variable] for variable in conditions}
    # Beyond a table the rule of the leaf applies, as in the simulation.
    parts = contributions(with_terms[0], name, variables, "clamp")
    dims = tuple(conditions.dims)
    if "time" in conditions.dims:
        dims = ("time",)
    shape = tuple(conditions.sizes[dim] for dim in dims)
    value = np.broadcast_to(sum(parts.values()), shape).copy()
    return xr.DataArray(value, dims=dims, attrs=quantity_attributes(name))


def _read_states(path: Path) -> xr.Dataset:
    """Return the states of a path, or a manoeuvre, from a file."""
    if not path.exists():
        raise FileNotFoundError(
            f"{path}: no such file; `aeromatch flight reconstruct` writes a path"
        )
    demand_self_contained(path)
    try:
        with xr.open_datatree(
            path, engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as file:
            tree = file.load()
    except Exception as error:
        # A damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError and others.
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 file ({type(error).__name__}: {error})",
            "a path of `aeromatch flight reconstruct`",
        ) from error
    # A manoeuvre has its variables at the root.
    data = tree
    if "states" in tree.children:
        data = tree.children["states"]
    if "alpha" not in data.data_vars:
        contents = ", ".join(map(str, [*data.data_vars, *data.children])) or "nothing"
        expected = (
            "states over one clock: a path of `aeromatch flight reconstruct`, or a "
            "manoeuvre that holds alpha and mach"
        )
        raise ParseError(str(path), 0, contents[:200], expected)
    return data.to_dataset()
