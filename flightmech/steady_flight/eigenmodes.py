"""Modes of a linear model: names of the motions, with frequency, damping and remarks.

Participation identifies a mode: p_ki = l_ki v_ki with the left and right eigenvectors scaled to
l_i v_i = 1 [Perez].  It is the part of state k in mode i.  It does not depend on the units of the
states or on their order, and its sum over the states of a mode is one.  Each eigenvalue is assigned
to one state, so that the sum of participations is largest.  The states of a mode give its name.

References
----------
.. [Perez] Perez-Arriaga, Verghese and Schweppe, Selective modal analysis, IEEE Trans. PAS-101
   (1982), 3117.
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapter 9.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

PHUGOID = "phugoid"
SHORT_PERIOD = "short period"
DUTCH_ROLL = "Dutch roll"
ROLL = "roll"
SPIRAL = "spiral"
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
_OSCILLATIONS = (PHUGOID, SHORT_PERIOD, DUTCH_ROLL)  # motions that are usually a conjugate pair
_REAL = 1e-9  # imaginary part that is rounding, of the modulus of an eigenvalue
_ZERO = 1e-9  # eigenvalue that counts as zero, of the fastest one
# Participation of the states of a mode below which a remark names the other states.
_CLEAR = 0.6
_WORTH_NAMING = 0.1  # smallest participation in texts
_DEFECTIVE = 1e10  # condition of the eigenvectors beyond which eigenvalues count as repeated


class _Eigenmode(NamedTuple):
    """A real eigenvalue, or the eigenvalue of positive frequency of a conjugate pair.

    `participation` is (states,), and `states` are the states assigned to the mode.
    """

    value: complex
    vector: np.ndarray
    participation: np.ndarray
    states: tuple[str, ...]

    @property
    def motions(self) -> set[str]:
        """Motions of the assigned states."""
        return {_motion_of_state(state) for state in self.states}


def modes(linear: xr.Dataset) -> pd.DataFrame:
    """Return the modes of a linear model.

    Parameters
    ----------
    linear : Dataset
        As from `linearize` or `subset`.

    Returns
    -------
    DataFrame
        One row per real eigenvalue or conjugate pair, fastest first; columns `COLUMNS`, units in
        ``attrs["units"]``.  ``mode`` is ``phugoid``, ``short period``, ``Dutch roll``, ``roll``,
        ``spiral``, ``height``, ``heading``, ``engine``, ``fuel`` or ``gear``.  An oscillation that
        has become two real modes appears twice with ``aperiodic`` in its remark.  A pair of two
        motions is the ``third oscillation`` (phugoid and short period), the ``roll-spiral
        oscillation``, or ``coupled``.  ``period`` is NaN without oscillation, ``t_half`` NaN for a
        growing motion, ``t_double`` NaN for a decaying motion.  ``damping_ratio`` is -real/omega_n,
        so -1 for an aperiodic divergence.  ``phi_beta`` is the ratio of bank to sideslip in a
        lateral oscillation.  ``participation`` lists the states above 0.1.

    Notes
    -----
    If eigenvectors are parallel, participations have no meaning, and the remark states this.  That
    happens for repeated eigenvalues, as at the point where a pair becomes real.
    """
    names = [str(name) for name in linear["state"].values]
    eigenmodes = _compute_eigenmodes(linear["A"].values, names)
    eigenmodes.sort(key=lambda mode: -abs(mode.value))
    rows = [_make_row(mode, names) for mode in eigenmodes]
    frame = pd.DataFrame(rows, columns=list(COLUMNS))
    frame.attrs = {"units": dict(UNITS), "condition": linear.attrs.get("condition", "")}
    return frame


def _compute_eigenmodes(A: np.ndarray, names: list[str]) -> list[_Eigenmode]:
    """Return one entry per real eigenvalue or conjugate pair of A, with its assigned states."""
    values, V = np.linalg.eig(A)
    # eigenvalues of heading, height and the like are rounding, not instability
    values = np.where(np.abs(values) < _ZERO * np.abs(values).max(initial=0.0), 0.0, values)
    # participations |l_ki v_ki|, (state, mode); rows of the inverse are the left eigenvectors
    V = V.astype(complex)
    left_vectors = np.linalg.pinv(V)
    participation = np.abs(left_vectors.T * V)
    participation /= np.maximum(participation.sum(axis=0), np.finfo(float).tiny)
    if np.linalg.cond(V) > _DEFECTIVE:
        displayed = np.full(participation.shape, np.nan)
    else:
        displayed = participation
    # one state for each eigenvalue, so that the sum of participations is largest
    state_of_mode = {}
    for state, mode in zip(*scipy.optimize.linear_sum_assignment(-participation), strict=True):
        state_of_mode[int(mode)] = names[state]

    eigenmodes = []
    for i, value in enumerate(values):
        if abs(value.imag) <= _REAL * abs(value):
            states: tuple[str, ...] = (state_of_mode[i],)
            eigenmodes.append(_Eigenmode(complex(value.real), V[:, i], displayed[:, i], states))
        elif value.imag > 0.0:
            conjugate = int(np.argmin(np.abs(values - value.conjugate())))
            states = (state_of_mode[i], state_of_mode[conjugate])
            eigenmodes.append(_Eigenmode(value, V[:, i], displayed[:, i], states))
    return eigenmodes


def _make_row(mode: _Eigenmode, names: list[str]) -> dict[str, object]:
    """Return the columns of a mode; a column without a value is missing, and becomes NaN."""
    value, omega_n = mode.value, abs(mode.value)
    name, remarks = _name_mode(mode)
    # An amplitude halves or doubles in ln(2) over the rate of decay or growth.
    decay = -value.real
    row: dict[str, object] = {
        "mode": name,
        "real": value.real,
        "imag": value.imag,
        "omega_n": omega_n,
        "damping_ratio": np.nan,
        "period": np.nan,
        "t_half": np.nan,
        "t_double": np.nan,
        "phi_beta": np.nan,
    }
    if omega_n > 0.0:
        row["damping_ratio"] = decay / omega_n
    if decay > 0.0:
        row["t_half"] = np.log(2.0) / decay
    elif decay < 0.0:
        row["t_double"] = -np.log(2.0) / decay
    if value.imag != 0.0:
        row["period"] = 2.0 * np.pi / value.imag
        row["phi_beta"] = _bank_per_sideslip(mode, names)
    row["participation"] = _describe_participation(mode, names)
    row["remark"] = "; ".join([*remarks, *_remark_on_others(mode, names)])
    return row


def _describe_participation(mode: _Eigenmode, names: list[str]) -> str:
    """Return the states with the largest participation, largest first."""
    texts = []
    for share, name in sorted(zip(mode.participation, names, strict=True), reverse=True):
        if share >= _WORTH_NAMING:
            texts.append(f"{name} {share:.2f}")
    return " ".join(texts)


def _motion_of_state(state: str) -> str:
    if state in _MOTION:
        return _MOTION[state]
    group = state.partition(".")[0]
    if group.startswith("engine"):
        return "engine"
    return "fuel" if group == "tank" else group


def _name_mode(mode: _Eigenmode) -> tuple[str, list[str]]:
    """Return the name of a mode and remarks on its stability and its motions."""
    motions = sorted(mode.motions)
    remarks = []
    if mode.value.real > 0.0:
        remarks.append("unstable")
    # a real eigenvalue has one state
    if mode.value.imag == 0.0:
        if motions[0] in _OSCILLATIONS:
            remarks.append("aperiodic")
        return motions[0], remarks
    # a pair of states of different motions
    if len(motions) > 1:
        name = _MERGED.get(frozenset(motions), "coupled")
        return name, [*remarks, f"merged of {' and '.join(motions)}"]
    if motions[0] in _OSCILLATIONS:
        return motions[0], remarks
    return "coupled", [*remarks, f"of {motions[0]} alone"]


def _remark_on_others(mode: _Eigenmode, names: list[str]) -> list[str]:
    """Return a remark if states of other motions take part in a mode."""
    if np.isnan(mode.participation).any():
        return ["repeated eigenvalues: the name is a guess"]
    # sum of the participations of the states of each motion
    shares: dict[str, float] = {}
    for name, share in zip(names, mode.participation, strict=True):
        motion = _motion_of_state(name)
        shares[motion] = shares.get(motion, 0.0) + share
    if sum(shares[motion] for motion in mode.motions) >= _CLEAR:
        return []
    texts = []
    for share, motion in sorted(zip(shares.values(), shares, strict=True), reverse=True):
        if motion not in mode.motions and share >= _WORTH_NAMING:
            texts.append(f"{motion} {share:.2f}")
    return [f"with {', '.join(texts)}"] if texts else []


def _bank_per_sideslip(mode: _Eigenmode, names: list[str]) -> float:
    """Return |phi| / |beta| of the eigenvector of a lateral mode, else NaN."""
    if "phi" not in names or "beta" not in names:
        return np.nan
    if not mode.motions & {DUTCH_ROLL, ROLL, SPIRAL}:
        return np.nan
    return float(abs(mode.vector[names.index("phi")] / mode.vector[names.index("beta")]))
