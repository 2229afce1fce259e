"""Evidence of an identification for the figures of LR-743: samples, local estimates, submodels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.overview import FREE_AIR
from aeromatch.workflow.submodels import Submodels, thin_samples
from aeromatch.workflow.windows import Spans, select_spans
from flightmech.aircraft.controls import ICE
from flightmech.names import VOCABULARY
from flightmech.names import quantity_attributes as attributes
from flighttest.submodels.ground_effect.tables import ONE_FACTOR, SEPARATE
from pom.report.submodels.sections import make_sections

# Samples per second of the stored data. Loops of lift over angle of attack stay round.
_RATE = 10.0
# Time before the input of a manoeuvre that gives its steady condition. [s]
_STEADY = 0.5
_CONDITIONS = ("alpha", "beta", "mach", "h", "h_agl", "phi", "phat", "qhat", "rhat", "mass")
_DEFLECTIONS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake")
_COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
_STORED = (*_CONDITIONS, *_DEFLECTIONS, ICE, *_COEFFICIENTS)
# Values of a record without the quantity: devices at rest, free air, and an unknown mass.
_AT_REST = {"delta_f": 0.0, "gear": 0.0, "speedbrake": 0.0, "h_agl": FREE_AIR, "mass": np.nan}


def flown_tree(
    name: str,
    data: Mapping[str, xr.Dataset],
    taken: Sequence[Spans],
    tables: Mapping[str, pd.DataFrame],
    fits: Sequence[Any],
    submodels: Submodels,
) -> xr.DataTree:
    """Return the data that a project was identified from, for `aerodb.figures.read_flown`.

    Parameters
    ----------
    name : str
        Name of the aircraft.
    data : mapping of str to Dataset (time,)
        Coefficients by record.
    taken : sequence of dict
        Start and end by record of the windows of each fit and of the ground effect. [s]
    tables : mapping of str to DataFrame
        Manoeuvres by record, which give the names.
    fits : sequence of Fit
    submodels : Submodels

    Returns
    -------
    DataTree
        ``samples`` at 10 Hz, ``manoeuvres`` with the means over their first half second,
        ``estimates`` of the local models with the means of their samples, ``submodels`` ([LR743]
        table 1) and ``ground`` (table 2). [SI]
    """
    manoeuvres: list[dict[str, Any]] = []
    samples: list[pd.DataFrame] = []
    at_rest = dict(_AT_REST)
    if any(ICE in coefficients for coefficients in data.values()):
        # a record without the setting is clean, next to others with ice
        at_rest[ICE] = 0.0
    for record, spans in _merge_windows(taken).items():
        parts = select_spans(_fill_absent_quantities(data[record], at_rest), spans)
        for span, part in zip(spans, parts, strict=True):
            # One sample has no time step.
            if part.sizes["time"] < 2:
                continue
            samples.append(_thin_samples(part).assign(manoeuvre=len(manoeuvres)))
            manoeuvres.append(_manoeuvre_row(record, span, part=part, table=tables[record]))
    estimates: list[dict[str, Any]] = []
    for fit in fits:
        estimates += _estimate_rows(fit, at_rest)
    groups = {
        "samples": pd.concat(samples, ignore_index=True),
        "manoeuvres": pd.DataFrame(manoeuvres),
        "estimates": pd.DataFrame(estimates),
        "submodels": pd.DataFrame(_technique_rows(fits, submodels)),
    }
    if submodels.ground_effect is not None:
        groups["ground"] = pd.DataFrame(_ground_rows(submodels.ground_effect))
    nodes = {name: _to_dataset(table, name) for name, table in groups.items()}
    tree = xr.DataTree.from_dict(nodes)
    tree.attrs = {"title": f"{name}: what the databases were identified from"}
    return tree


def _merge_windows(windows: Sequence[Spans]) -> dict[str, list[tuple[float, float]]]:
    """Return the windows by record, each window once, in the order of time."""
    merged: dict[str, set[tuple[float, float]]] = {}
    for spans_by_record in windows:
        for record, spans in spans_by_record.items():
            merged.setdefault(record, set()).update(spans)
    return {record: sorted(spans) for record, spans in merged.items()}


def _fill_absent_quantities(data: xr.Dataset, at_rest: Mapping[str, float]) -> xr.Dataset:
    """Return the stored quantities, with devices at rest in free air for a record without them."""
    absent = {}
    for name, value in at_rest.items():
        if name not in data:
            absent[name] = ("time", np.full(data.sizes["time"], value))
    return data[[name for name in _STORED if name in data]].assign(absent)


def _mean_values(data: xr.Dataset) -> dict[str, float]:
    """Return the mean of every stored quantity over its values; NaN without a value."""
    means: dict[str, float] = {}
    for name in _STORED:
        if name in data:
            values = data.variables[name].values
            values = values[~np.isnan(values)]
            means[name] = float(values.mean()) if values.size else np.nan
    return means


def _manoeuvre_row(
    record: str, span: tuple[float, float], part: xr.Dataset, table: pd.DataFrame
) -> dict[str, Any]:
    """Return name, window and steady condition of a manoeuvre, or of a window without a name."""
    rows = table[np.isclose(table["start"], span[0]) & np.isclose(table["end"], span[1])]
    label = "window"
    if len(rows):
        texts = rows[["manoeuvre", "control"]].fillna("").astype(str).agg(" ".join, axis=1)
        label = texts.str.strip().iloc[0]
    start = float(part["time"][0])
    steady = part.sel(time=slice(None, start + _STEADY))
    return {
        "record": record,
        "label": label,
        "start": start,
        "end": float(part["time"][-1]),
        **_mean_values(steady),
    }


def _thin_samples(part: xr.Dataset) -> pd.DataFrame:
    """Return the stored quantities at about `_RATE` samples per second."""
    thinned = thin_samples(part, _RATE)
    columns = {}
    for name in ("time", *_STORED):
        if name in thinned:
            columns[name] = thinned[name].values.astype(np.float32)
    return pd.DataFrame(columns)


def _estimate_rows(fit: Any, at_rest: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the estimates of a local model with its mean condition."""
    means = _mean_values(fit.data)
    # A record without a device has the value of the device at rest.
    means = {name: value for name, value in at_rest.items() if name not in means} | means
    table = fit.estimates
    columns = (table[name].values for name in ("term", "estimate", "stderr", "stderr_systematic"))
    rows = []
    for term, estimate, stderr, systematic in zip(*columns):
        row = {
            "fit": fit.name,
            "coefficient": fit.model.coefficient,
            "term": str(term),
            "estimate": float(estimate),
            "stderr": float(np.hypot(stderr, systematic)),
        }
        rows.append(row | means)
    return rows


def _ground_rows(ground_effect: Any) -> list[dict[str, Any]]:
    """Return table 2 of [LR743]: k and s of every identified term, and a note for the others.

    The law is a column: s is the exponent of a power law, and h0 [m] of another law.
    """
    values = ("y_inf", "k", "k_stderr", "s", "s_stderr", "correlation")
    rows: list[dict[str, Any]] = []
    for name, identified in ground_effect.coefficients.items():
        taken = f"form taken: {identified.form}"
        if identified.form in (ONE_FACTOR, SEPARATE):
            # The row is a law, and a table flies.
            taken += "; the row is the best law, which is not taken"
        note = "; ".join([taken, *identified.warnings])
        for row in identified.rows():
            rows.append({"coefficient": name, **row._asdict(), "note": note})
        for term, reason in identified.not_identified.items():
            row = {"coefficient": name, "term": term, **dict.fromkeys(values, np.nan)}
            rows.append({**row, "law": "", "note": reason})
    return rows


def _technique_rows(fits: Sequence[Any], submodels: Submodels) -> list[dict[str, str]]:
    """Return table 1 of [LR743], the estimation technique of each submodel.

    Type 1 adjusts a model until its output agrees with the flight; type 2 is explicit.
    """
    records = dict.fromkeys(fit.name.partition(":")[0] for fit in fits)
    local_models = f"{len(fits)} local models of {len(records)} records"
    paths = "flight paths of all records together"
    rows: list[tuple[str, ...]] = [
        ("state trajectory", paths, "type 1, batch least squares", ""),
        ("aerodynamic forces and moments", local_models, "type 2, equation error", ""),
    ]
    sections = make_sections(submodels.found, submodels.free_motion, submodels.driven_motion)
    for section in sections:
        for technique in section.techniques:
            rows.append((section.name, *technique))
    return [dict(zip(("submodel", "part", "technique", "residual"), row)) for row in rows]


def _to_dataset(table: pd.DataFrame, name: str) -> xr.Dataset:
    """Return a table as a dataset over rows, with units of the canonical names."""
    columns = {}
    for column in table:
        values = table[column].to_numpy()
        if values.dtype == object:
            values = values.astype(str)
        # `part` or `residual` of the techniques are texts and not quantities of the vocabulary.
        is_quantity = column in VOCABULARY and name != "submodels"
        columns[str(column)] = (name, values, attributes(str(column)) if is_quantity else {})
    return xr.Dataset(columns)
