"""Page of the identification: windows of reconstructed records, a model, and its fit."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import xarray as xr

import aerodb
import flighttest
from aeromatch.workbench.coefficients import form_windows
from aeromatch.workbench.fit_curves import (
    added_variable_residuals,
    lines_along_windows,
    power_spectral_densities,
)
from aeromatch.workbench.fit_request import (
    FitRequest,
    RecordWindow,
    order_fit_windows,
    records_of_request,
    validate_request,
)
from aeromatch.workbench.models.board import named_windows, saved_models
from aeromatch.workbench.models.kept_paths import (
    has_newer_paths,
    list_kept_paths,
    list_older_paths,
)
from aeromatch.workbench.models.routes import ROUTES as MODEL_ROUTES
from aeromatch.workbench.models.selection import error_words, window_words
from aeromatch.workbench.opened import MATCH, Levels, OpenProject, decimate_channels
from aeromatch.workbench.records import manoeuvres_of
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.quantities import time_text
from flighttest.maximum_likelihood.validating.used_windows import state_windows
from flighttest.maximum_likelihood.validating.validation import validate_models
from flighttest.regression.combining.mixed_estimation import prior_of
from flighttest.regression.equation_error.model import MEASURED
from flighttest.remarks import remarks_to_json

DATABASES = "databases"
# Greatest number of points of a screen.
_MOST_POINTS = 4000
# Greatest number of points of a drawn partial regression.
_SCATTER = 1500


def list_fit_choices(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the choices: reconstructed records, fits of the project, priors, and saved fits."""
    project = opened.project
    kept = list_kept_paths(opened)
    fits = []
    for fit in project.fit:
        entry = {
            "name": fit.name,
            "records": fit.records,
            "manoeuvres": fit.manoeuvres,
            "windows": fit.window,
            "models": fit.models,
        }
        fits.append(entry)
    return {
        "file": opened.places.named(opened.file),
        "records": [name for name in project.flights if opened.path_file(name).exists()],
        "fits": fits,
        "coefficients": MEASURED,
        "cutoff": project.cutoff,
        "priors": list(_prior_files(opened)),
        "saved": list(saved_models(opened)),
        "kept": kept,
        "take": has_newer_paths(opened, kept),
        "matched": (opened.work / MATCH / "final.nc").exists(),
        "project": opened.places.named(opened.file),
        "older": list_older_paths(opened),
    }


def list_record_manoeuvres(
    opened: OpenProject, query: Mapping[str, str], body: Any
) -> dict[str, Any]:
    """Return the manoeuvres of the record ``name``, and their source."""
    name = query.get("name", "")
    source, rows = _manoeuvre_rows(opened, name)
    return {"name": name, "source": source, "rows": rows}


def show_fit(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the fit that the body describes.

    The result has estimates, tests, remarks, prior, correlation, and the spectrum of the residual.
    """
    request = validate_request(body)
    start = time.perf_counter()
    form_windows(opened, request)
    prepared = time.perf_counter()
    fit = _fit(opened, request)
    end = time.perf_counter()
    estimates = fit.estimates
    prior, without_prior = _prior_by_term(opened, request, fit)
    return {
        "model": str(fit.model),
        "coefficient": fit.model.coefficient,
        "attributes": dict(estimates.attrs),
        "tests": flighttest.regression.equation_error.fit.slope_test_lines(estimates.attrs),
        "terms": _term_rows(estimates, prior),
        "correlation": estimates["correlation"].values,
        "remarks": remarks_to_json(fit.remarks),
        "without_prior": without_prior,
        "spectrum": power_spectral_densities(fit),
        "command": fit_command_words(opened, request),
        "seconds": {"coefficients": prepared - start, "fit": end - prepared},
    }


def _term_rows(
    estimates: xr.Dataset, prior: Mapping[str, Mapping[str, float]]
) -> list[dict[str, Any]]:
    """Return a row for each term: its columns, its total standard error, and its prior."""
    columns = [str(name) for name, item in estimates.data_vars.items() if item.dims == ("term",)]
    rows = []
    for k, term in enumerate(map(str, estimates["term"].values)):
        row: dict[str, Any] = {"term": term}
        for name in columns:
            row[name] = float(estimates[name].values[k])
        row["total"] = float(np.hypot(row["stderr"], row["stderr_systematic"]))
        rows.append(row | dict(prior.get(term, {})))
    return rows


def validate_fit(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the figures of the fit in the body (``fit``) on other ``windows``."""
    content = body if isinstance(body, dict) else {}
    request = validate_request(content.get("fit"))
    windows = {"windows": content.get("windows"), "model": request.model, "cutoff": request.cutoff}
    other = validate_request(windows)
    fit = state_windows(_fit(opened, request), named_windows(opened, request))
    return validate_models({"this fit": fit}, named_windows(opened, other)).as_dict()


def show_fit_samples(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return measured and fitted coefficient and residual along the windows, for a screen.

    The body has the fit (``fit``), and may have ``start``, ``stop`` [s along the windows] and
    ``points``.
    """
    body = body if isinstance(body, dict) else {}
    request = validate_request(body.get("fit"))
    along, edges, lines = lines_along_windows(_fit(opened, request))
    points = _number(body, "points", 2000.0)
    times, values = decimate_channels(
        along,
        {name: Levels(line) for name, line in lines.items()},
        start=_number(body, "start", -np.inf),
        stop=_number(body, "stop", np.inf),
        points=int(min(max(points, 1.0), _MOST_POINTS)),
    )
    windows = []
    for window, (first, last) in zip(order_fit_windows(request), edges, strict=True):
        label = _label(opened, window)
        windows.append({**window.model_dump(), "label": label, "from": first, "to": last})
    span = [float(along[0]), float(along[-1])]
    return {"time": times, **values, "windows": windows, "whole": span}


def show_partial_regression(
    opened: OpenProject, query: Mapping[str, str], body: Any
) -> dict[str, Any]:
    """Return the partial regression of the ``term`` in the body.

    It has the residuals of coefficient and regressor on the other terms. The slope of their
    least-squares line is the estimate of the term ([Belsley1980]_).

    References
    ----------
    .. [Belsley1980] Belsley, Kuh, Welsch, Regression Diagnostics, Wiley 1980, section 2.1.
    """
    body = body if isinstance(body, dict) else {}
    request = validate_request(body.get("fit"))
    fit = _fit(opened, request)
    x, y = added_variable_residuals(fit, str(body.get("term", "")), request.band)
    # The quotient is rounded up, so that there are at most `_SCATTER` points.
    step = -(-len(x) // _SCATTER)
    slope = float(x @ y / (x @ x))
    return {
        "term": body.get("term"),
        "x": x[::step],
        "y": y[::step],
        "slope": slope,
        "samples": len(x),
    }


def leave_one_out(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the estimates without each window, and then without each term but the constant."""
    request = validate_request(body)
    rows = []
    windows = order_fit_windows(request)
    if len(windows) > 1:
        for k, window in enumerate(windows):
            others = (*windows[:k], *windows[k + 1 :])
            outcome = _outcome(opened, request.model_copy(update={"windows": others}))
            name = f"{window.record}: {_label(opened, window)}"
            rows.append({"left_out": "window", "name": name, **outcome})
    model = flighttest.RegressionModel.parse(request.model)
    if len(model.terms) > 1:
        for term in model.terms:
            if term == "1":
                continue
            other_terms = [name for name in model.terms if name != term]
            reduced = flighttest.RegressionModel(model.coefficient, other_terms)
            outcome = _outcome(opened, request.model_copy(update={"model": str(reduced)}))
            rows.append({"left_out": "term", "name": term, **outcome})
    return {"rows": rows}


def show_fit_entries(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the fit in the body (``fit``, ``name``) as TOML entries ``[[fit]]`` of the project.

    The match fits each record alone. Records with the same manoeuvres share an entry.
    """
    body = body if isinstance(body, dict) else {}
    request = validate_request(body.get("fit"))
    name = str(body.get("name", "")).strip()
    if not name:
        raise SchemaError("fit", ["name: empty; give the fit a name"])
    return {"entries": make_fit_entries(opened, request, name)}


def make_fit_entries(opened: OpenProject, request: FitRequest, name: str) -> list[str]:
    """Return the entries of `show_fit_entries`.

    Windows are written in seconds, unless they are all manoeuvres of some kinds.
    """
    groups: dict[tuple[str, tuple[Any, ...]], list[str]] = {}
    windows = order_fit_windows(request)
    for record in records_of_request(request):
        spans = [(window.start, window.end) for window in windows if window.record == record]
        groups.setdefault(_selection(opened, record, spans), []).append(record)
    model = str(flighttest.RegressionModel.parse(request.model))
    entries = []
    for number, ((key, values), records) in enumerate(groups.items(), start=1):
        entry = tomlkit.inline_table()
        entry["name"] = name if len(groups) == 1 else f"{name} {number}"
        entry["records"] = records
        # A window is a tuple, and TOML has lists.
        entry[key] = [value if isinstance(value, str) else list(value) for value in values]
        entry["models"] = [model]
        entries.append(entry.as_string())
    return entries


def _selection(
    opened: OpenProject, record: str, spans: list[tuple[float, float]]
) -> tuple[str, tuple[Any, ...]]:
    """Return key and value of an entry that select these windows of a record."""
    _, rows = _manoeuvre_rows(opened, record)
    labels: dict[str, None] = {}
    for row in rows:
        if (row["start"], row["end"]) in spans:
            labels[row["label"]] = None
    # The labels select all manoeuvres of their kinds, which may be more than these windows.
    selected = [(row["start"], row["end"]) for row in rows if row["label"] in labels]
    if sorted(selected) == sorted(spans):
        return "manoeuvres", tuple(labels)
    return "window", tuple(spans)


def fit_command_words(opened: OpenProject, request: FitRequest) -> list[str]:
    """Return the words of ``flight identify`` for the same fit, without ``-o`` and its file."""
    paths = [
        opened.places.named(opened.path_file(record)) for record in records_of_request(request)
    ]
    words = ["flight", "identify", *paths]
    words += ["--aircraft", opened.places.named(opened.project.aircraft)]
    words += ["--model", str(flighttest.RegressionModel.parse(request.model))]
    words += window_words(request)
    if request.cutoff is not None:
        words += ["--cutoff", repr(request.cutoff)]
    words += error_words(opened.project.errors)
    # Defaults of the command are left out.
    if request.intercepts != "common":
        words += ["--intercepts", request.intercepts]
    if request.weights != "equal":
        words += ["--weights", request.weights]
    if request.ridge:
        words += ["--ridge", str(request.ridge)]
    if request.band is not None:
        words += ["--band", *map(repr, request.band)]
    return words


def _fit(opened: OpenProject, request: FitRequest) -> flighttest.Fit:
    """Return the fit of a request, computed once while its files are unchanged."""
    files = [opened.path_file(record) for record in records_of_request(request)]
    # The prior does not change the fit.
    without_prior = request.model_copy(update={"prior": None})
    key = ("fit", without_prior, tuple(opened.project.errors.items()))
    model = flighttest.RegressionModel.parse(request.model)

    def make() -> flighttest.Fit:
        parts = form_windows(opened, request)
        if request.band is not None:
            return flighttest.equation_error.regress_frequency(
                model,
                parts,
                request.band,
                intercepts=request.intercepts,
                ridge=request.ridge,
            )
        return flighttest.regress(
            model,
            parts,
            intercepts=request.intercepts,
            weights=request.weights,
            ridge=request.ridge,
        )

    return opened.kept(key, [*files, *opened.aircraft_files], make)


def _outcome(opened: OpenProject, request: FitRequest) -> dict[str, Any]:
    """Return estimates and quality of a fit, or the reason why it is not possible."""
    try:
        fit = _fit(opened, request)
    except AeromatchError as error:
        return {"refused": str(error)}
    terms, values = fit.estimates["term"].values, fit.estimates["estimate"].values
    attributes = fit.estimates.attrs
    return {
        "R2": attributes["R2"],
        "residual_rms": attributes["residual_rms"],
        "estimates": dict(zip(map(str, terms), map(float, values), strict=True)),
    }


def _prior_files(opened: OpenProject) -> dict[str, Path]:
    """Return the databases that may be a prior, by place; the database of DATCOM is first."""
    files = []
    for name in opened.project.own_models:
        file = opened.work / MATCH / f"{name}.nc"
        if file.exists():
            files.append(file)
    files += sorted((opened.work / DATABASES).glob("*.nc"))
    return {opened.places.named(file): file for file in files}


def _prior_by_term(
    opened: OpenProject, request: FitRequest, fit: flighttest.Fit
) -> tuple[dict[str, dict[str, float]], str]:
    """Return prior and standard error by term, and the reason if there is no prior."""
    if request.prior is None:
        return {}, ""
    files = _prior_files(opened)
    if request.prior not in files:
        raise UnknownName(request.prior, files, "database")
    file = files[request.prior]
    try:
        prior = prior_of(fit, opened.kept(("database",), [file], lambda: aerodb.open(file)))
    except AeromatchError as error:
        return {}, str(error)
    by_term: dict[str, dict[str, float]] = {}
    columns = (prior[name].values for name in ("term", "estimate", "stderr"))
    for term, value, sigma in zip(*columns, strict=True):
        by_term[str(term)] = {"prior": float(value), "prior_stderr": float(sigma)}
    return by_term, ""


def _manoeuvre_rows(opened: OpenProject, name: str) -> tuple[str, list[dict[str, Any]]]:
    """Return the manoeuvres of a record with their labels, and their source."""
    source, table = manoeuvres_of(opened, name)
    rows = []
    for row in table.to_dict("records"):
        words = (row["manoeuvre"], row["control"])
        # A manoeuvre without a control has NaN there.
        label = " ".join(word for word in words if isinstance(word, str) and word)
        entry = {
            "manoeuvre": str(row["manoeuvre"]),
            "label": label,
            "start": float(row["start"]),
            "end": float(row["end"]),
        }
        rows.append(entry)
    return source, rows


def _label(opened: OpenProject, window: RecordWindow) -> str:
    """Return the manoeuvre of a window, or its start and end."""
    _, rows = _manoeuvre_rows(opened, window.record)
    for row in rows:
        if (row["start"], row["end"]) == (window.start, window.end):
            if row["label"]:
                return row["label"]
            break
    return f"{time_text(window.start)} to {time_text(window.end)} s"


def _number(body: Mapping[str, Any], key: str, default: float) -> float:
    """Return a finite number of the body, or a default."""
    number = body.get(key)
    if number is None:
        return default
    # True and False are integers in Python.
    if isinstance(number, bool) or not isinstance(number, int | float) or not np.isfinite(number):
        raise SchemaError("fit", [f"{key} {number!r}; give a number"])
    return float(number)


ROUTES = {
    ("GET", "/api/identification"): list_fit_choices,
    ("GET", "/api/windows"): list_record_manoeuvres,
    ("POST", "/api/fit"): show_fit,
    ("POST", "/api/fit/samples"): show_fit_samples,
    ("POST", "/api/fit/partial"): show_partial_regression,
    ("POST", "/api/fit/without"): leave_one_out,
    ("POST", "/api/fit/entry"): show_fit_entries,
    ("POST", "/api/fit/validation"): validate_fit,
    **MODEL_ROUTES,
}
"""Requests of the page of the identification, in the form of `records.ROUTES`."""
