"""Modes of a linear model: which motion an eigenvalue is, and what a pilot or a test row requires
of it.

A mode is recognised by participation, p_ki = l_ki v_ki with the left and right eigenvectors scaled
to l_i v_i = 1 [Perez]: the part that state k has in mode i.  It does not depend on the units of the
states nor on their order, and its sum over the states of a mode is one.  Eigenvalues and states are
matched one to one so that the sum of participations becomes largest; the states that fall to a mode
give its name.

References
----------
.. [Perez] Perez-Arriaga, Verghese and Schweppe, Selective modal analysis, IEEE Trans. PAS-101 (1982), 3117.
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapter 9.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import linear_sum_assignment

PHUGOID, SHORT_PERIOD, DUTCH_ROLL, ROLL, SPIRAL = (
    "phugoid",
    "short period",
    "Dutch roll",
    "roll",
    "spiral",
)
COLUMNS = (
    "mode",
    "real",
    "imag",
    "omega_n",
    "damping_ratio",
    "period",
    "t_half",
    "t_double",
    "phi_beta",
    "participation",
    "remark",
)
UNITS = {
    "real": "s-1",
    "imag": "rad s-1",
    "omega_n": "rad s-1",
    "period": "s",
    "t_half": "s",
    "t_double": "s",
}
_MOTION = {
    "V": PHUGOID,
    "theta": PHUGOID,
    "alpha": SHORT_PERIOD,
    "q": SHORT_PERIOD,
    "beta": DUTCH_ROLL,
    "r": DUTCH_ROLL,
    "p": ROLL,
    "phi": SPIRAL,
    "psi": "heading",
    "h": "height",
}
_MERGED = {
    frozenset({ROLL, SPIRAL}): "roll-spiral oscillation",
    frozenset({PHUGOID, SHORT_PERIOD}): "third oscillation",
}
_REAL = 1e-9  # of the modulus: an imaginary part below it is rounding
_ZERO = 1e-9  # of the fastest: an eigenvalue below it is zero
_CLEAR = 0.6  # participation of a mode's own states below which others are named
_WORTH_NAMING = 0.1
_DEFECTIVE = 1e10  # condition of the eigenvectors beyond which eigenvalues count as repeated


class _Eigen(NamedTuple):
    """One real eigenvalue, or a conjugate pair by the one with positive frequency; `share`
    (states,) are participations.
    """

    value: complex
    vector: np.ndarray
    share: np.ndarray
    states: tuple[str, ...]


def modes(linear: xr.Dataset) -> pd.DataFrame:
    """Return the modes of a linear model.

    Parameters
    ----------
    linear : Dataset
        As from `linearize` or `linear.subset`.

    Returns
    -------
    DataFrame
        One row per real eigenvalue or conjugate pair, fastest first; columns `COLUMNS`, units in
        ``attrs["units"]``.  ``mode`` is ``phugoid``, ``short period``, ``Dutch roll``, ``roll``,
        ``spiral``, ``height``, ``heading``, ``engine``, ``fuel`` or ``gear``; a motion that has
        fallen apart into two real ones appears twice with ``aperiodic`` in its remark; a pair made
        of two motions is the ``third oscillation`` (phugoid and short period), the ``roll-spiral
        oscillation``, or ``coupled``.  ``period`` is NaN without oscillation, ``t_half`` NaN for a
        growing motion, ``t_double`` for a decaying one; ``damping_ratio`` is -real/omega_n, so -1
        for an aperiodic divergence. ``phi_beta`` is the ratio of bank to sideslip in a lateral
        oscillation.  ``participation`` lists the states above 0.1.

    Notes
    -----
    Where eigenvectors are parallel (repeated eigenvalues, as at the very point where a pair becomes real) participations lose
    their meaning; the remark then states so.
    """
    names = [str(name) for name in linear["state"].values]
    found = _eigen(linear["A"].values, names)
    rows = [_row(item, names) for item in sorted(found, key=lambda item: -abs(item.value))]
    frame = pd.DataFrame(rows, columns=list(COLUMNS))
    frame.attrs = {"units": dict(UNITS), "condition": linear.attrs.get("condition", "")}
    return frame


def _eigen(A: np.ndarray, names: list[str]) -> list[_Eigen]:
    values, V = np.linalg.eig(A)
    values = np.where(np.abs(values) < _ZERO * np.abs(values).max(initial=0.0), 0.0, values)
    V = V.astype(complex)
    left = np.linalg.pinv(V)
    share = np.abs(left.T * V)
    share /= np.maximum(share.sum(axis=0), np.finfo(float).tiny)
    owner = {
        int(mode): names[state] for state, mode in zip(*linear_sum_assignment(-share), strict=True)
    }
    repeated = np.linalg.cond(V) > _DEFECTIVE
    found = []
    for i, value in enumerate(values):
        oscillates = abs(value.imag) > _REAL * abs(value)
        if oscillates and value.imag < 0.0:
            continue
        conjugate = int(np.argmin(np.abs(values - value.conjugate()))) if oscillates else i
        states = (owner[i], owner[conjugate]) if oscillates else (owner[i],)
        value = value if oscillates else complex(value.real)
        found.append(
            _Eigen(value, V[:, i], np.full(len(names), np.nan) if repeated else share[:, i], states)
        )
    return found


def _row(item: _Eigen, names: list[str]) -> dict[str, object]:
    value, pair = item.value, item.value.imag != 0.0
    omega_n = abs(value)
    mode, remarks = _name(item)
    decay = -value.real
    row: dict[str, object] = {
        "mode": mode,
        "real": value.real,
        "imag": value.imag,
        "omega_n": omega_n,
    }
    row["damping_ratio"] = decay / omega_n if omega_n > 0.0 else np.nan
    row["period"] = 2.0 * np.pi / value.imag if pair else np.nan
    row["t_half"] = np.log(2.0) / decay if decay > 0.0 else np.nan
    row["t_double"] = -np.log(2.0) / decay if decay < 0.0 else np.nan
    row["phi_beta"] = _ratio(item, names) if pair else np.nan
    shares = sorted(zip(item.share, names, strict=True), reverse=True)
    row["participation"] = " ".join(
        f"{name} {share:.2f}" for share, name in shares if share >= _WORTH_NAMING
    )
    row["remark"] = "; ".join([*remarks, *_shared(item, names)])
    return row


def _motion(state: str) -> str:
    group = state.partition(".")[0]
    return _MOTION.get(state) or ("engine" if group.startswith("engine") else group)


def _name(item: _Eigen) -> tuple[str, list[str]]:
    motions = {_motion(state) for state in item.states}
    unstable = ["unstable"] if item.value.real > 0.0 else []
    if item.value.imag == 0.0:
        (motion,) = motions
        apart = motion in (PHUGOID, SHORT_PERIOD, DUTCH_ROLL)
        return motion, [*unstable, *(["aperiodic"] if apart else [])]
    if len(motions) == 1:
        (motion,) = motions
        return (
            (motion, unstable)
            if motion in (PHUGOID, SHORT_PERIOD, DUTCH_ROLL)
            else ("coupled", [*unstable, f"of {motion} alone"])
        )
    merged = _MERGED.get(frozenset(motions), "coupled")
    return merged, [*unstable, f"merged of {' and '.join(sorted(motions))}"]


def _shared(item: _Eigen, names: list[str]) -> list[str]:
    """Return a remark when others than the mode's own states take part in it."""
    if np.isnan(item.share).any():
        return ["repeated eigenvalues: the name is a guess"]
    own = {_motion(state) for state in item.states}
    part = {
        motion: sum(s for s, name in zip(item.share, names, strict=True) if _motion(name) == motion)
        for motion in map(_motion, names)
    }
    if sum(part[motion] for motion in own) >= _CLEAR:
        return []
    others = sorted(
        (
            (share, motion)
            for motion, share in part.items()
            if motion not in own and share >= _WORTH_NAMING
        ),
        reverse=True,
    )
    return (
        [f"with {', '.join(f'{motion} {share:.2f}' for share, motion in others)}"] if others else []
    )


def _ratio(item: _Eigen, names: list[str]) -> float:
    if (
        "phi" not in names
        or "beta" not in names
        or not {_motion(state) for state in item.states} & {DUTCH_ROLL, ROLL, SPIRAL}
    ):
        return np.nan
    return float(abs(item.vector[names.index("phi")] / item.vector[names.index("beta")]))
