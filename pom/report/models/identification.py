"""Identification: every local model with its estimates, standard errors, collinearity, residual, and where the flights were."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.support.svg_chart import WIDTH, Frame, axes, dots, spaced, svg

from ..presentation.quantities import MISSING, fixed, label, number, symbol
from ..presentation.traces import Pack, step_of
from ..submodels.section import Picture

if TYPE_CHECKING:
    import flighttest

MOST_SAMPLES = 1200  # drawn of one fit: a line of 650 units shows no more
LEAST_CORRELATION = 0.9  # from which two estimates are listed as correlated, as usual in the field
_BAR, _MIDDLE = 74.0, 80.0  # [px] half the length of the bar of an estimate, and where its zero lies
_CELLS = 160  # of the map of test points, in each direction


def page(fits: Sequence[flighttest.Fit]) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """Return what the template ``identification.html`` needs, what the script draws, and the traces it points into."""
    pack = Pack.empty()
    drawn = [_traces(fit, pack) for fit in fits]
    where = sample_map(fits)
    context = {"fits": described(fits), "map": svg(where.height, where.body, where.words) if where else ""}
    return context, {"fits": drawn}, bytes(pack.body)


def described(fits: Sequence[flighttest.Fit]) -> list[dict[str, Any]]:
    """Return what page and paper state of every fit: model, figures of merit, estimates, correlated estimates, remarks."""
    return [_fit(i, fit) for i, fit in enumerate(fits)]


def _fit(index: int, fit: flighttest.Fit) -> dict[str, Any]:
    found = fit.estimates
    names = [str(name) for name in found["term"].values]
    largest_vif = float(np.nanmax(found["vif"].values)) if "vif" in found and np.isfinite(found["vif"].values).any() else math.nan
    return {
        "index": index,
        "name": fit.name,
        "coefficient": fit.model.coefficient,
        "symbol": symbol(fit.model.coefficient),
        "model": str(fit.model),
        "domain": str(found.attrs.get("domain", "time")),
        "samples": found.attrs.get("samples", fit.data.sizes["sample"]),
        "manoeuvres": found.attrs.get("manoeuvres", 1),
        "R2": fixed(found.attrs.get("R2"), 4),
        "rms": number(found.attrs.get("residual_rms"), 3),
        **_agreement(fit),
        "vif": fixed(largest_vif, 1),
        "remarks": [str(remark) for remark in fit.remarks],
        "terms": [_term(fit, i, name) for i, name in enumerate(names)],
        "correlated": _correlated(fit, names),
    }


def _agreement(fit: flighttest.Fit) -> dict[str, str]:
    """Return Theil's coefficient and what the residual consists of."""
    from flighttest.uncertainty import theil, theil_shares

    measured = fit.data[fit.model.coefficient].values
    predicted = measured - fit.residual
    try:
        shares = theil_shares(measured, predicted)
        return {"theil": fixed(theil(measured, predicted), 3), "shares": " / ".join(fixed(100.0 * share, 0) for share in shares)}
    except IdentificationError:
        return {"theil": MISSING, "shares": MISSING}


def _term(fit: flighttest.Fit, index: int, name: str) -> dict[str, Any]:
    found = fit.estimates.isel(term=index)

    def of(variable: str) -> float:
        return float(found[variable]) if variable in found else math.nan

    estimate, stderr = of("estimate"), of("stderr")
    return {
        "name": name,
        "estimate": number(estimate, 4),
        "stderr": number(stderr, 2),
        "systematic": number(of("stderr_systematic"), 2),
        "ratio": fixed(abs(estimate) / stderr if stderr > 0.0 else math.nan, 1),
        "vif": fixed(of("vif"), 1),
        "contribution": f"{fixed(100.0 * of('contribution'), 0)} %" if math.isfinite(of("contribution")) else MISSING,
        "bar": _error_bar(estimate, stderr),
    }


def _error_bar(estimate: float, stderr: float) -> dict[str, float] | None:
    """Return places of zero, estimate and its two standard errors on a line that the larger of them fills. [px]"""
    reach = abs(estimate) + 2.0 * stderr
    if not math.isfinite(reach) or reach == 0.0:
        return None
    at, wide = _BAR * estimate / reach, 2.0 * _BAR * stderr / reach
    return {"at": round(_MIDDLE + at, 1), "low": round(_MIDDLE + at - wide, 1), "high": round(_MIDDLE + at + wide, 1), "zero": _MIDDLE}


def _correlated(fit: flighttest.Fit, names: Sequence[str]) -> list[str]:
    """Return the pairs of estimates that can hardly be distinguished."""
    if "correlation" not in fit.estimates:
        return []
    table = fit.estimates["correlation"].values
    pairs = [(a, b) for a in range(len(names)) for b in range(a) if abs(table[a, b]) >= LEAST_CORRELATION]
    return [f"{names[b]} with {names[a]}: {fixed(table[a, b], 3)}" for a, b in pairs]


def _traces(fit: flighttest.Fit, pack: Pack) -> dict[str, Any]:
    """Return the measured and the fitted coefficient over the samples, thinned to what a figure can show."""
    measured = fit.data[fit.model.coefficient].values
    every = max(1, math.ceil(len(measured) / MOST_SAMPLES))
    fitted = (measured - fit.residual)[::every]
    measured = measured[::every]
    step = step_of(None, (float(np.nanmin(measured)), float(np.nanmax(measured))))
    runs = fit.data["manoeuvre"].values[::every] if "manoeuvre" in fit.data else np.zeros(len(measured))
    base, sub = symbol(fit.model.coefficient)
    return {
        "base": base,
        "sub": sub,
        "every": every,
        "starts": [int(i) for i in np.flatnonzero(np.diff(runs)) + 1],
        "measured": pack.add(measured, step),
        "fitted": pack.add(fitted, step),
        "alt": f"{fit.model.coefficient} of {fit.name}, measured and fitted",
    }


def sample_map(fits: Sequence[flighttest.Fit]) -> Picture | None:
    """Return a figure of the angles of attack and Mach numbers that the samples hold, as LR-743 Fig. 9; None without them."""
    held = [fit.data for fit in fits if "alpha" in fit.data and "mach" in fit.data]
    if not held:
        return None
    alpha, mach = (np.concatenate([data[name].values for data in held]) for name in ("alpha", "mach"))
    good = np.isfinite(alpha) & np.isfinite(mach)
    x, y = mach[good], label("alpha").shown(alpha[good])
    if not len(x):
        return None
    frame = Frame(54.0, 12.0, WIDTH - 66.0, 240.0, _reach(x), _reach(y))
    cells = np.unique(np.stack([np.floor(_CELLS * (v - low) / (high - low)) for v, (low, high) in ((x, frame.x), (y, frame.y))]), axis=1)
    centres = [low + (cell + 0.5) / _CELLS * (high - low) for cell, (low, high) in zip(cells, (frame.x, frame.y), strict=True)]
    body = axes(frame, x_labels=True) + dots(frame, centres[0], centres[1], "test-point")
    body += spaced(frame.left + frame.width / 2, frame.bottom + 28, [("M", "symbol")], "middle") + spaced(
        8, 20, [("α", "symbol"), (", deg", "caption")]
    )
    return Picture(body, frame.bottom + 36, f"Angle of attack and Mach number of {len(x)} samples")


def _reach(values: np.ndarray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    pad = 0.04 * (high - low) or 0.05
    return low - pad, high + pad
