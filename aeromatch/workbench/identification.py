"""Page of the identification: windows of reconstructed records, a model, its fit, and what changes
without a term or a manoeuvre.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
import xarray as xr
from pydantic import Field, model_validator
from scipy.signal import welch

import aerodb
import flighttest
from aeromatch.workbench.coefficients import form_missing, window_of
from aeromatch.workbench.opened import FITS, MATCH, Levels, OpenProject, decimate_channels
from aeromatch.workbench.records import manoeuvres_of
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.support.toml_models import Strict, validate_content
from flighttest.regression.combining.mixed_estimation import prior_of
from flighttest.regression.equation_error.least_squares import weight_roots
from flighttest.regression.equation_error.model import MEASURED
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.equation_error.transformed_stretches import (
    select_stretches,
    stack_complex,
    transform_columns,
)
from flighttest.remarks import remarks_to_json

DATABASES = "databases"
_MODELS = ("datcom", "corrected", "final")  # of a match, in the order in which they are made
_MOST_POINTS = 4000
_SCATTER = 1500  # points of a partial regression that are drawn
_SEGMENT = 1024  # longest segment of the spectrum, samples


class RecordWindow(Strict):
    """A stretch of a reconstructed record."""

    record: str
    start: Annotated[float, Field(allow_inf_nan=False)]
    end: Annotated[float, Field(allow_inf_nan=False)]


_Frequency = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class FitRequest(Strict):
    """What is to be fitted to what."""

    windows: Annotated[tuple[RecordWindow, ...], Field(min_length=1)]
    model: str
    intercepts: Literal["common", "separate"] = "common"
    weights: Literal["equal", "manoeuvre", "robust"] = "equal"
    cutoff: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    prior: str | None = None
    ridge: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | Literal["auto"] = 0.0
    band: tuple[_Frequency, _Frequency] | None = None

    @model_validator(mode="after")
    def _in_time_or_in_frequency(self) -> FitRequest:
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ValueError(
                f"band {self.band[0]:g} to {self.band[1]:g} Hz; the upper edge must be the larger"
            )
        if self.band is not None and self.weights != "equal":
            raise ValueError(
                "weights go with a fit in time; a fit in frequency weighs by its spectrum"
            )
        return self


def list_fit_choices(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return what can be chosen: reconstructed records, fits of the project, databases of the
    prior, fits that were saved.
    """
    project = opened.project
    folder = opened.work / FITS
    return {
        "file": opened.places.named(opened.file),
        "records": [name for name in project.flights if opened.path_file(name).exists()],
        "fits": [
            {
                "name": fit.name,
                "records": fit.records,
                "manoeuvres": fit.manoeuvres,
                "windows": fit.window,
                "models": fit.models,
            }
            for fit in project.fit
        ],
        "coefficients": MEASURED,
        "cutoff": project.cutoff,
        "priors": list(_priors(opened)),
        "saved": [opened.places.named(file) for file in sorted(folder.glob("*.nc"))],
    }


def list_record_manoeuvres(
    opened: OpenProject, query: Mapping[str, str], body: Any
) -> dict[str, Any]:
    """Return the manoeuvres of the record ``name``, and where they come from."""
    source, rows = _marks(opened, query.get("name", ""))
    return {"name": query.get("name", ""), "source": source, "rows": rows}


def show_fit(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return estimates, tests, remarks, prior, correlation and the spectrum of the residual of the
    fit that the body describes.
    """
    wanted = validate_content(FitRequest, body if isinstance(body, dict) else {}, "fit")
    begun = time.perf_counter()
    _parts(opened, wanted)
    prepared = time.perf_counter()
    found = _fit(opened, wanted)
    done = time.perf_counter()
    e = found.estimates
    prior, without_prior = _prior(opened, wanted, found)
    columns = [str(name) for name, item in e.data_vars.items() if item.dims == ("term",)]
    rows = []
    for k, term in enumerate(e["term"].values):
        row = {name: float(e[name].values[k]) for name in columns}
        rows.append(
            {
                "term": str(term),
                **row,
                "total": float(np.hypot(row["stderr"], row["stderr_systematic"])),
                **prior.get(str(term), {}),
            }
        )
    return {
        "model": str(found.model),
        "coefficient": found.model.coefficient,
        "attributes": dict(e.attrs),
        "tests": flighttest.regression.equation_error.fit.slope_test_lines(e.attrs),
        "terms": rows,
        "correlation": e["correlation"].values,
        "remarks": remarks_to_json(found.remarks),
        "without_prior": without_prior,
        "spectrum": power_spectral_densities(found),
        "command": fit_command_words(opened, wanted),
        "seconds": {"coefficients": prepared - begun, "fit": done - prepared},
    }


def show_fit_samples(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return measured and fitted coefficient and residual along the windows, one after another, for
    a screen.

    The body has the fit (``fit``), and may have ``start``, ``stop`` [s along the windows] and
    ``points``.
    """
    body = body if isinstance(body, dict) else {}
    wanted = validate_content(
        FitRequest, body.get("fit") if isinstance(body.get("fit"), dict) else {}, "fit"
    )
    found = _fit(opened, wanted)
    along, edges, lines = _along(found)
    start, stop, points = (
        _number(body, key, default)
        for key, default in (("start", -np.inf), ("stop", np.inf), ("points", 2000.0))
    )
    at, values = decimate_channels(
        along,
        {name: Levels(line) for name, line in lines.items()},
        start,
        stop,
        int(min(max(points, 1.0), _MOST_POINTS)),
    )
    spans = [
        {**window.model_dump(), "label": _label(opened, window), "from": first, "to": last}
        for window, (first, last) in zip(_ordered(wanted), edges, strict=True)
    ]
    return {"time": at, **values, "windows": spans, "whole": [float(along[0]), float(along[-1])]}


def show_partial_regression(
    opened: OpenProject, query: Mapping[str, str], body: Any
) -> dict[str, Any]:
    """Return the partial regression of the ``term`` in the body: coefficient and regressor, both
    less what the other terms explain.

    Their least-squares line has the estimate of the term as its slope ([Belsley1980]_).

    References
    ----------
    .. [Belsley1980] Belsley, Kuh, Welsch, Regression Diagnostics, Wiley 1980, section 2.1.
    """
    body = body if isinstance(body, dict) else {}
    wanted = validate_content(
        FitRequest, body.get("fit") if isinstance(body.get("fit"), dict) else {}, "fit"
    )
    found = _fit(opened, wanted)
    x, y = added_variable_residuals(found, str(body.get("term", "")), wanted.band)
    step = -(-len(x) // _SCATTER)
    slope = float(x @ y / (x @ x))
    return {
        "term": body.get("term"),
        "x": x[::step],
        "y": y[::step],
        "slope": slope,
        "samples": len(x),
    }


def added_variable_residuals(
    found: flighttest.Fit, term: str, band: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals of a regressor and of the coefficient on all other regressors, with the
    weights of the fit.

    Parameters
    ----------
    found : Fit
    term : str
    band : (low, high), optional
        Of a fit in frequency. [Hz]

    Returns
    -------
    regressor, coefficient : ndarray (sample,)
        Of a fit in frequency (equation,): real and imaginary parts of the transforms at its
        frequencies.

    Raises
    ------
    UnknownName
        A term that the fit does not have, or the constant of a fit in frequency, which is found in
        time.
    """
    terms = [str(name) for name in found.estimates["term"].values]
    X, z = found.regressors.values, found.data[found.model.coefficient].values
    if band is not None:
        slopes = [j for j, name in enumerate(terms) if name != "1" and not name.startswith("1[")]
        terms, (X, z) = [terms[j] for j in slopes], in_frequency(found, band, X[:, slopes], z)
    else:
        root = weight_roots(found.estimates.attrs["weights"], X, z, found.data)
        X, z = X * root[:, None], z * root
    if term not in terms:
        raise UnknownName(term, terms, "term")
    j = terms.index(term)
    Q, _ = np.linalg.qr(np.delete(X, j, axis=1))
    return X[:, j] - Q @ (Q.T @ X[:, j]), z - Q @ (Q.T @ z)


def in_frequency(
    found: flighttest.Fit, band: tuple[float, float], X: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations of a fit in frequency, (equation, terms) and (equation,): transforms of
    regressors and coefficient in a band.
    """
    window, moment = found.data["manoeuvre"].values, found.data["time"].values
    steps = [
        float(np.median(np.diff(moment[window == k])))
        for k in range(found.estimates.attrs["manoeuvres"])
    ]
    parts = select_stretches(RegressionSamples(found.data, steps), band)
    return stack_complex(transform_columns(X, parts)), stack_complex(
        transform_columns(z[:, None], parts)
    )[:, 0]


def leave_one_out(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the estimates with each window, and then each term but the constant, left out in turn."""
    wanted = validate_content(FitRequest, body if isinstance(body, dict) else {}, "fit")
    model = flighttest.RegressionModel.parse(wanted.model)
    ordered = _ordered(wanted)
    rows = []
    if len(ordered) > 1:
        for k, window in enumerate(ordered):
            rest = wanted.model_copy(update={"windows": (*ordered[:k], *ordered[k + 1 :])})
            rows.append(
                {
                    "left_out": "window",
                    "name": f"{window.record}: {_label(opened, window)}",
                    **_outcome(opened, rest),
                }
            )
    for term in [one for one in model.terms if one != "1"] if len(model.terms) > 1 else []:
        rest_of = flighttest.RegressionModel(
            model.coefficient, [one for one in model.terms if one != term]
        )
        rows.append(
            {
                "left_out": "term",
                "name": term,
                **_outcome(opened, wanted.model_copy(update={"model": str(rest_of)})),
            }
        )
    return {"rows": rows}


def show_fit_entries(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the fit in the body (``fit``, ``name``) as entries ``[[fit]]`` of the project file, in
    TOML.

    A fit of the project is made for each of its records by itself; records with the same manoeuvres
    share an entry.
    """
    body = body if isinstance(body, dict) else {}
    wanted = validate_content(
        FitRequest, body.get("fit") if isinstance(body.get("fit"), dict) else {}, "fit"
    )
    name = str(body.get("name", "")).strip()
    if not name:
        raise SchemaError("fit", ["name: empty; give the fit a name"])
    return {"entries": make_fit_entries(opened, wanted, name)}


def make_fit_entries(opened: OpenProject, wanted: FitRequest, name: str) -> list[str]:
    """Return the entries of `show_fit_entries`; windows that are not all manoeuvres of some kinds are written
    in seconds.
    """

    model = str(flighttest.RegressionModel.parse(wanted.model))
    groups: dict[tuple[str, tuple[Any, ...]], list[str]] = {}
    ordered = _ordered(wanted)
    for record in dict.fromkeys(window.record for window in ordered):
        spans = [(window.start, window.end) for window in ordered if window.record == record]
        _, rows = _marks(opened, record)
        labels = tuple(
            dict.fromkeys(row["label"] for row in rows if (row["start"], row["end"]) in spans)
        )
        meant = [(row["start"], row["end"]) for row in rows if row["label"] in labels]
        kind: tuple[str, tuple[Any, ...]] = (
            ("manoeuvres", labels) if sorted(meant) == sorted(spans) else ("window", tuple(spans))
        )
        groups.setdefault(kind, []).append(record)
    found = []
    for number, ((key, value), records) in enumerate(groups.items(), start=1):
        table = tomlkit.inline_table()
        table.update({"name": name if len(groups) == 1 else f"{name} {number}", "records": records})
        table.update(
            {
                key: [list(one) if isinstance(one, tuple) else one for one in value],
                "models": [model],
            }
        )
        found.append(table.as_string())
    return found


def fit_command_words(opened: OpenProject, wanted: FitRequest) -> list[str]:
    """Return the words of ``flight identify`` that make the same fit; ``-o`` and the file are still
    to be added.
    """
    ordered = _ordered(wanted)
    paths = [
        opened.places.named(opened.path_file(record))
        for record in dict.fromkeys(window.record for window in ordered)
    ]
    words = [
        "flight",
        "identify",
        *paths,
        "--aircraft",
        opened.places.named(opened.project.aircraft),
    ]
    words += ["--model", str(flighttest.RegressionModel.parse(wanted.model))]
    for window in ordered:
        words += ["--window-of", window.record, repr(window.start), repr(window.end)]
    if wanted.cutoff is not None:
        words += ["--cutoff", repr(wanted.cutoff)]
    for source, size in opened.project.errors.items():
        words += ["--error", source, repr(size)]
    if wanted.intercepts != "common":
        words += ["--intercepts", wanted.intercepts]
    if wanted.weights != "equal":
        words += ["--weights", wanted.weights]
    if wanted.ridge:
        words += ["--ridge", str(wanted.ridge)]
    if wanted.band is not None:
        words += ["--band", *map(repr, wanted.band)]
    return words


def power_spectral_densities(found: flighttest.Fit) -> dict[str, Any]:
    """Return the power spectral densities of coefficient and residual, each stretch about its mean,
    by the method of Welch.

    Segments with a Hann window, half overlapping, as long as the lower median of the stretches,
    1024 samples at most; shorter stretches, and those sampled at another rate, have no part in it.

    Returns
    -------
    dict
        ``frequency`` [Hz], ``measured`` and ``residual`` [1/Hz], ``segments``, ``left_out``
        (stretches), ``white``: the level of a white residual of the same variance.

    References
    ----------
    .. [Welch1967] Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. Audio AU-15, 1967.
    """

    stretches = _stretches(found)
    step = float(np.median([interval for _, interval in stretches]))
    alike = [piece for piece, interval in stretches if abs(interval - step) < 1e-3 * step]
    size = min(_SEGMENT, sorted(piece.stop - piece.start for piece in alike)[(len(alike) - 1) // 2])
    used = [piece for piece in alike if piece.stop - piece.start >= size]
    lines = {"measured": found.data[found.model.coefficient].values, "residual": found.residual}
    counts = [(piece.stop - piece.start - size) // (size - size // 2) + 1 for piece in used]
    powers, frequency = {}, np.zeros(0)
    for name, line in lines.items():
        parts = [
            welch(line[piece], 1.0 / step, "hann", size, size // 2, detrend="constant")
            for piece in used
        ]
        frequency = parts[0][0]
        powers[name] = np.average([power for _, power in parts], axis=0, weights=counts)
    residual = np.concatenate([lines["residual"][piece] for piece in used])
    return {
        "frequency": frequency[1:],
        **{name: power[1:] for name, power in powers.items()},
        "white": 2.0 * step * float(np.var(residual)),
        "segments": int(np.sum(counts)),
        "left_out": len(stretches) - len(used),
    }


def _stretches(found: flighttest.Fit) -> list[tuple[slice, float]]:
    """Return the stretches without a gap, each inside one window, with their sampling intervals."""
    moment, window = found.data["time"].values, found.data["manoeuvre"].values
    step = np.diff(moment)
    usual = {
        k: float(np.median(step[(window[1:] == k) & (window[:-1] == k)]))
        for k in np.unique(window)
        if np.sum(window == k) > 1
    }
    limit = np.array([1.5 * usual.get(k, 0.0) for k in window[1:]])
    cuts = np.flatnonzero((np.diff(window) != 0) | (step > limit)) + 1
    edges = [0, *cuts.tolist(), len(moment)]
    return [(slice(a, b), usual[window[a]]) for a, b in pairwise(edges) if b - a > 1]


def _along(
    found: flighttest.Fit,
) -> tuple[np.ndarray, list[tuple[float, float]], dict[str, np.ndarray]]:
    """Return time along the windows, where each begins and ends, and the lines; NaN stands where a
    stretch ends.
    """
    measured, residual = found.data[found.model.coefficient].values, found.residual
    moment, window = found.data["time"].values, found.data["manoeuvre"].values
    at: list[Any] = []
    places: list[Any] = []
    edges: dict[int, tuple[float, float]] = {}
    now = last = 0.0
    for piece, step in _stretches(found):
        own = now + moment[piece] - moment[piece.start]
        edges[int(window[piece.start])] = (
            edges.get(int(window[piece.start]), (float(own[0]), 0.0))[0],
            float(own[-1]),
        )
        at += [own, [own[-1] + 0.5 * step]]
        places += [np.arange(piece.start, piece.stop), [-1]]
        now = last = float(own[-1]) + step
    index = np.concatenate(places).astype(int)
    lines = {"measured": measured, "fitted": measured - residual, "residual": residual}
    broken = {name: np.where(index < 0, np.nan, line[index]) for name, line in lines.items()}
    return (
        np.concatenate(at),
        [edges.get(k, (last, last)) for k in range(found.estimates.attrs["manoeuvres"])],
        broken,
    )


def _ordered(wanted: FitRequest) -> list[RecordWindow]:
    """Return the windows record by record, as ``flight identify`` takes them."""
    records = list(dict.fromkeys(window.record for window in wanted.windows))
    return sorted(wanted.windows, key=lambda window: records.index(window.record))


def _parts(opened: OpenProject, wanted: FitRequest) -> list[xr.Dataset]:
    form_missing(opened, dict.fromkeys(window.record for window in wanted.windows), wanted.cutoff)
    return [
        window_of(opened, window.record, window.start, window.end, wanted.cutoff)
        for window in _ordered(wanted)
    ]


def _fit(opened: OpenProject, wanted: FitRequest) -> flighttest.Fit:
    files = [
        opened.path_file(record)
        for record in dict.fromkeys(window.record for window in wanted.windows)
    ]
    about = (wanted.model_copy(update={"prior": None}), tuple(opened.project.errors.items()))
    model = flighttest.RegressionModel.parse(wanted.model)

    def make() -> flighttest.Fit:
        parts, one, ridge = _parts(opened, wanted), wanted.intercepts, wanted.ridge
        if wanted.band is not None:
            return flighttest.equation_error.regress_frequency(
                model, parts, wanted.band, intercepts=one, ridge=ridge
            )
        return flighttest.regress(model, parts, intercepts=one, weights=wanted.weights, ridge=ridge)

    return opened.kept(("fit", *about), [*files, opened.project.aircraft], make)


def _outcome(opened: OpenProject, wanted: FitRequest) -> dict[str, Any]:
    """Return the figures of a fit, or why there is none."""
    try:
        found = _fit(opened, wanted)
    except AeromatchError as error:
        return {"refused": str(error)}
    e = found.estimates
    estimates = {
        str(term): float(value)
        for term, value in zip(e["term"].values, e["estimate"].values, strict=True)
    }
    return {"R2": e.attrs["R2"], "residual_rms": e.attrs["residual_rms"], "estimates": estimates}


def _priors(opened: OpenProject) -> dict[str, Path]:
    """Return the databases that may be a prior, by place; that of DATCOM first."""
    made = [opened.work / MATCH / f"{name}.nc" for name in _MODELS]
    found = [file for file in made if file.exists()] + sorted(
        (opened.work / DATABASES).glob("*.nc")
    )
    return {opened.places.named(file): file for file in found}


def _prior(
    opened: OpenProject, wanted: FitRequest, found: flighttest.Fit
) -> tuple[dict[str, dict[str, float]], str]:
    """Return prior and standard error by term, and why there is none."""
    if wanted.prior is None:
        return {}, ""
    known = _priors(opened)
    if wanted.prior not in known:
        raise UnknownName(wanted.prior, known, "database")
    file = known[wanted.prior]
    try:
        prior = prior_of(found, opened.kept(("database",), [file], lambda: aerodb.open(file)))
    except AeromatchError as error:
        return {}, str(error)
    columns = zip(
        prior["term"].values, prior["estimate"].values, prior["stderr"].values, strict=True
    )
    return {
        str(term): {"prior": float(value), "prior_stderr": float(sigma)}
        for term, value, sigma in columns
    }, ""


def _marks(opened: OpenProject, name: str) -> tuple[str, list[dict[str, Any]]]:
    source, table = manoeuvres_of(opened, name)
    rows = [
        {
            "manoeuvre": str(row["manoeuvre"]),
            "label": _words(row["manoeuvre"], row["control"]),
            "start": float(row["start"]),
            "end": float(row["end"]),
        }
        for row in table.to_dict("records")
    ]
    return source, rows


def _words(*words: Any) -> str:
    return " ".join(str(word) for word in words if isinstance(word, str) and word)


def _label(opened: OpenProject, window: RecordWindow) -> str:
    _, rows = _marks(opened, window.record)
    own = next(
        (row["label"] for row in rows if (row["start"], row["end"]) == (window.start, window.end)),
        "",
    )
    return own or f"{window.start:g} to {window.end:g} s"


def _number(body: Mapping[str, Any], key: str, default: float) -> float:
    found = body.get(key)
    if found is None:
        return default
    if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
        raise SchemaError("fit", [f"{key} {found!r}; give a number"])
    return float(found)


ROUTES = {
    ("GET", "/api/identification"): list_fit_choices,
    ("GET", "/api/windows"): list_record_manoeuvres,
    ("POST", "/api/fit"): show_fit,
    ("POST", "/api/fit/samples"): show_fit_samples,
    ("POST", "/api/fit/partial"): show_partial_regression,
    ("POST", "/api/fit/without"): leave_one_out,
    ("POST", "/api/fit/entry"): show_fit_entries,
}
"""What the page of the identification requests; as `records.ROUTES`."""
