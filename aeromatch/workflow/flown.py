"""What was flown, kept next to the databases of a project: samples, local estimates, submodels, for
the figures of LR-743.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.overview import FREE_AIR
from aeromatch.workflow.submodels import Spans, Submodels, select_spans
from flightmech.names import VOCABULARY
from flightmech.names import quantity_attributes as attributes
from pom.report.submodels.sections import make_sections

_RATE = 10.0  # samples per second that are kept: loops of lift over angle of attack stay round
_STEADY = 0.5  # of a manoeuvre before its input, from which the steady condition is taken [s]
_KEPT = (
    *("alpha", "beta", "mach", "h", "h_agl", "phi", "phat", "qhat", "rhat", "mass"),
    *(
        "delta_e",
        "delta_a",
        "delta_r",
        "delta_f",
        "gear",
        "speedbrake",
        "CL",
        "CD",
        "CY",
        "Cl",
        "Cm",
        "Cn",
    ),
)
_AT_REST = {"delta_f": 0.0, "gear": 0.0, "speedbrake": 0.0, "h_agl": FREE_AIR, "mass": np.nan}


def flown_tree(
    title: str,
    data: Mapping[str, xr.Dataset],
    taken: Sequence[Spans],
    tables: Mapping[str, pd.DataFrame],
    fits: Sequence[Any],
    submodels: Submodels,
) -> xr.DataTree:
    """Return what a project was identified from, for `aerodb.figures.read_flown`.

    Parameters
    ----------
    title : str
        Of the project.
    data : mapping of str to Dataset (time,)
        Coefficients by record.
    taken : sequence of dict
        Start and end by record of what each fit and the ground effect took. [s]
    tables : mapping of str to DataFrame
        Manoeuvres by record, whose names are taken.
    fits : sequence of Fit
    submodels : Submodels

    Returns
    -------
    DataTree
        ``samples`` at 10 Hz, ``manoeuvres`` with the means over their first half second,
        ``estimates`` of the local models with the means of their samples, ``submodels`` ([LR743]
        table 1) and ``ground`` (table 2). [SI]
    """
    rows, parts = [], []
    for record, spans in _once(taken).items():
        for span, part in zip(spans, select_spans(_completed(data[record]), spans), strict=True):
            if part.sizes["time"] < 2:
                continue
            rows.append(_manoeuvre(record, span, part, tables[record]))
            parts.append(_thinned(part).assign(manoeuvre=len(rows) - 1))
    groups = {
        "samples": pd.concat(parts, ignore_index=True),
        "manoeuvres": pd.DataFrame(rows),
        "estimates": pd.DataFrame([row for fit in fits for row in _estimates(fit)]),
        "submodels": pd.DataFrame(_techniques(fits, submodels)),
    }
    if submodels.ground_effect is not None:
        groups["ground"] = pd.DataFrame(_ground(submodels.ground_effect))
    nodes = {name: _dataset(table, name) for name, table in groups.items()}
    tree = xr.DataTree.from_dict(nodes)
    tree.attrs = {"title": f"{title}: what the databases were identified from"}
    return tree


def _once(taken: Sequence[Spans]) -> dict[str, list[tuple[float, float]]]:
    """Return the windows by record, each once, in the order of time."""
    found: dict[str, set[tuple[float, float]]] = {}
    for spans in taken:
        for record, own in spans.items():
            found.setdefault(record, set()).update(own)
    return {record: sorted(own) for record, own in found.items()}


def _completed(data: xr.Dataset) -> xr.Dataset:
    """Return what is kept of coefficients, with devices at rest and free air where a record has
    none of them.
    """
    missing = {
        name: ("time", np.full(data.sizes["time"], value))
        for name, value in _AT_REST.items()
        if name not in data
    }
    return data[[name for name in _KEPT if name in data]].assign(missing)


def _means(data: xr.Dataset) -> dict[str, float]:
    """Return the mean of every variable that is kept over its values, NaN without any."""
    columns = {name: data.variables[name].values for name in _KEPT if name in data}
    known = {name: values[~np.isnan(values)] for name, values in columns.items()}
    return {name: float(values.mean()) if values.size else np.nan for name, values in known.items()}


def _manoeuvre(
    record: str, span: tuple[float, float], part: xr.Dataset, table: pd.DataFrame
) -> dict[str, Any]:
    same = table[np.isclose(table["start"], span[0]) & np.isclose(table["end"], span[1])]
    words = (
        same[["manoeuvre", "control"]].fillna("").astype(str).agg(" ".join, axis=1).str.strip()
        if len(same)
        else pd.Series(["window"])
    )
    steady = part.sel(time=slice(None, float(part["time"][0]) + _STEADY))
    return {
        "record": record,
        "label": words.iloc[0],
        "start": float(part["time"][0]),
        "end": float(part["time"][-1]),
        **_means(steady),
    }


def _thinned(part: xr.Dataset) -> pd.DataFrame:
    step = float(np.median(np.diff(part["time"].values)))
    kept = part.isel(time=slice(None, None, max(1, round(1.0 / (_RATE * step)))))
    return pd.DataFrame(
        {name: kept[name].values.astype(np.float32) for name in ("time", *_KEPT) if name in kept}
    )


def _estimates(fit: Any) -> list[dict[str, Any]]:
    means = _means(fit.data)
    means = {name: value for name, value in _AT_REST.items() if name not in means} | means
    table = fit.estimates
    columns = (table[name].values for name in ("term", "estimate", "stderr", "stderr_systematic"))
    return [
        {
            "fit": fit.name,
            "coefficient": fit.model.coefficient,
            "term": str(term),
            "estimate": float(estimate),
            "stderr": float(np.hypot(stderr, systematic)),
            **means,
        }
        for term, estimate, stderr, systematic in zip(*columns)
    ]


def _ground(found: Any) -> list[dict[str, Any]]:
    """Return table 2 of [LR743]: k and s of every identified term, and why the others are not."""
    rows = []
    for name, one in found.coefficients.items():
        common = one.form == "k h^s, one s"
        rows += [
            {
                "coefficient": name,
                **one.row(term, common)._asdict(),
                "note": f"form taken: {one.form}",
            }
            for term in one.ground
        ]
        empty = dict.fromkeys(("y_inf", "k", "k_stderr", "s", "s_stderr", "correlation"), np.nan)
        rows += [
            {"coefficient": name, "term": term, **empty, "note": why}
            for term, why in one.not_identified.items()
        ]
    return rows


def _techniques(fits: Sequence[Any], submodels: Submodels) -> list[dict[str, str]]:
    """Return table 1 of [LR743]: type 1 adjusts a model until its output is that of the flight,
    type 2 is explicit.
    """
    records = list(dict.fromkeys(fit.name.partition(":")[0] for fit in fits))
    local = f"{len(fits)} local models of {len(records)} records"
    rows = [
        (
            "state trajectory",
            "flight paths of all records together",
            "type 1, batch least squares",
            "",
        ),
        ("aerodynamic forces and moments", local, "type 2, equation error", ""),
    ]
    found = make_sections(submodels.found, submodels.free_motion, submodels.driven_motion)
    rows += [(section.name, *technique) for section in found for technique in section.techniques]
    return [dict(zip(("submodel", "part", "technique", "residual"), row)) for row in rows]


def _dataset(table: pd.DataFrame, name: str) -> xr.Dataset:
    columns = {}
    for column in table:
        values = table[column].to_numpy()
        known = column in VOCABULARY and name != "submodels"
        columns[str(column)] = (
            name,
            values.astype(str) if values.dtype == object else values,
            attributes(str(column)) if known else {},
        )
    return xr.Dataset(columns)
