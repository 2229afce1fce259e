"""Identification: estimates, standard errors, collinearity and residual of every local model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech.errors import IdentificationError
from flightmech.support.figures import make_svg_figure
from flighttest.regression.uncertainty.prediction_errors import theil, theil_shares
from pom.report.models.fit_figures import fit_picture, sample_map
from pom.report.presentation.quantities import (
    MISSING,
    fixed_decimals,
    format_number,
    symbol_parts,
)
from pom.report.presentation.traces import Pack, step_of

MOST_SAMPLES = 1200  # drawn of one fit: a line of 650 units shows no more
LEAST_CORRELATION = 0.9  # from which two estimates are listed as correlated, as usual in the field
_BAR, _MIDDLE = 74.0, 80.0  # [px] half length of the bar of an estimate, and place of its zero


def identification_chapter(
    fits: Sequence[flighttest.Fit], level_lines: Mapping[str, xr.Dataset], on_paper: bool
) -> dict[str, Any]:
    """Return the data of the identification for page and paper.

    Parameters
    ----------
    fits : sequence of Fit
    level_lines : mapping of str to Dataset (mach,)
        1 g lines by name, from `aerodb.figures.one_g_lines`.
    on_paper : bool
        Draw the figures of the fits for paper.

    Returns
    -------
    dict
        ``fits`` (`describe_fits`, with ``drawing``), ``map`` (Picture or None), ``heads`` (plots
        that the script of the page draws) and ``body`` (their traces).
    """
    pack = Pack.empty()
    heads, rows = [_pack_traces(fit, pack) for fit in fits], describe_fits(fits)
    for row, fit in zip(rows, fits, strict=True):
        row["drawing"] = None
        # Published values have no samples, and no time.
        if on_paper and "time" in fit.data:
            row["drawing"] = fit_picture(row["index"], fit)
    return {
        "fits": rows,
        "map": sample_map(fits, level_lines),
        "heads": heads,
        "body": bytes(pack.body),
    }


def identification_page(found: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """Return the data of the template ``identification.html``, the plots, and their traces.

    Parameters
    ----------
    found : mapping
        Result of `identification_chapter`.
    """
    picture = found["map"]
    svg = make_svg_figure(picture.height, picture.body, picture.words) if picture else ""
    return {"fits": found["fits"], "map": svg}, {"fits": found["heads"]}, found["body"]


def describe_fits(fits: Sequence[flighttest.Fit]) -> list[dict[str, Any]]:
    """Return the texts of every fit: model, figures of merit, estimates, remarks.

    Parameters
    ----------
    fits : sequence of Fit
    """
    return [_describe_fit(i, fit) for i, fit in enumerate(fits)]


def _describe_fit(index: int, fit: flighttest.Fit) -> dict[str, Any]:
    estimates = fit.estimates
    names = [str(name) for name in estimates["term"].values]
    largest_vif = math.nan
    if "vif" in estimates and np.isfinite(estimates["vif"].values).any():
        largest_vif = float(np.nanmax(estimates["vif"].values))
    return {
        "index": index,
        "name": fit.name,
        "coefficient": fit.model.coefficient,
        "symbol": symbol_parts(fit.model.coefficient),
        "model": str(fit.model),
        "domain": str(estimates.attrs.get("domain", "time")),
        "samples": estimates.attrs.get("samples", fit.data.sizes["sample"]),
        "manoeuvres": estimates.attrs.get("manoeuvres", 1),
        "R2": fixed_decimals(estimates.attrs.get("R2"), 4),
        "rms": format_number(estimates.attrs.get("residual_rms"), 3),
        **_describe_agreement(fit),
        "vif": fixed_decimals(largest_vif, 1),
        "remarks": [str(remark) for remark in fit.remarks],
        "terms": [_describe_term(fit, i, name) for i, name in enumerate(names)],
        "correlated": _list_correlated(fit, names),
    }


def _describe_agreement(fit: flighttest.Fit) -> dict[str, str]:
    """Return Theil's coefficient, and the shares of the residual in percent."""
    measured = fit.data[fit.model.coefficient].values
    predicted = measured - fit.residual
    try:
        shares = theil_shares(measured, predicted)
        return {
            "theil": fixed_decimals(theil(measured, predicted), 3),
            "shares": " / ".join([fixed_decimals(100.0 * share, 0) for share in shares]),
        }
    except IdentificationError:
        return {"theil": MISSING, "shares": MISSING}


def _describe_term(fit: flighttest.Fit, index: int, name: str) -> dict[str, Any]:
    """Return the cells of one estimate."""
    estimates = fit.estimates.isel(term=index)

    def number(variable: str) -> float:
        return float(estimates[variable]) if variable in estimates else math.nan

    estimate, stderr, contribution = number("estimate"), number("stderr"), number("contribution")
    percent = MISSING
    if math.isfinite(contribution):
        percent = f"{fixed_decimals(100.0 * contribution, 0)} %"
    return {
        "name": name,
        "estimate": format_number(estimate, 4),
        "stderr": format_number(stderr, 2),
        "systematic": format_number(number("stderr_systematic"), 2),
        "ratio": fixed_decimals(abs(estimate) / stderr if stderr > 0.0 else math.nan, 1),
        "vif": fixed_decimals(number("vif"), 1),
        "contribution": percent,
        "bar": _error_bar(estimate, stderr),
    }


def _error_bar(estimate: float, stderr: float) -> dict[str, float] | None:
    """Return the positions of zero, estimate and two standard errors on a line. [px]"""
    # The larger of estimate and error fills the line.
    reach = abs(estimate) + 2.0 * stderr
    if not math.isfinite(reach) or reach == 0.0:
        return None
    offset, half_width = _BAR * estimate / reach, 2.0 * _BAR * stderr / reach
    return {
        "at": round(_MIDDLE + offset, 1),
        "low": round(_MIDDLE + offset - half_width, 1),
        "high": round(_MIDDLE + offset + half_width, 1),
        "zero": _MIDDLE,
    }


def _list_correlated(fit: flighttest.Fit, names: Sequence[str]) -> list[str]:
    """Return the pairs of estimates that can hardly be distinguished."""
    if "correlation" not in fit.estimates:
        return []
    table = fit.estimates["correlation"].values
    pairs = []
    # Every pair once: the table is symmetric.
    for row, name in enumerate(names):
        for column in range(row):
            correlation = table[row, column]
            if abs(correlation) >= LEAST_CORRELATION:
                pairs.append(f"{names[column]} with {name}: {fixed_decimals(correlation, 3)}")
    return pairs


def _pack_traces(fit: flighttest.Fit, pack: Pack) -> dict[str, Any]:
    """Return the plot of measured and fitted coefficient, with its traces in `pack`."""
    all_measured = fit.data[fit.model.coefficient].values
    every = max(1, math.ceil(len(all_measured) / MOST_SAMPLES))
    fitted = (all_measured - fit.residual)[::every]
    measured = all_measured[::every]
    step = step_of(None, (float(np.nanmin(measured)), float(np.nanmax(measured))))
    manoeuvres = np.zeros(len(measured))
    if "manoeuvre" in fit.data:
        manoeuvres = fit.data["manoeuvre"].values[::every]
    base, subscript = symbol_parts(fit.model.coefficient)
    return {
        "base": base,
        "sub": subscript,
        "every": every,
        "starts": [int(i) for i in np.flatnonzero(np.diff(manoeuvres)) + 1],
        "measured": pack.add(measured, step),
        "fitted": pack.add(fitted, step),
        "alt": f"{fit.model.coefficient} of {fit.name}, measured and fitted",
    }
