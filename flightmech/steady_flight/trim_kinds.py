"""Kinds of steady flight: unknowns and their limits, residuals and fixed quantities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

ACCELERATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
CLIMB = "hddot"  # upward acceleration: the kernel computes it, but it is not an output
# Constraint of the search of the kernel: fixed climb angle, fixed pitch attitude, or the ground.
BY_GAMMA, BY_THETA, ON_GROUND = range(3)
_SURFACES = ("delta_e", "delta_a", "delta_r")
_STRAIGHT = {"gamma": 0.0, "phi": 0.0, "psi_dot": 0.0}


@dataclass(frozen=True)
class Kind:
    """One kind of steady flight.

    Parameters
    ----------
    unknowns, residuals : tuple of str
        Unknowns, and the quantities that vanish.
    fixed : mapping of str to float
        Fixed quantities and their default values. [SI]
    one_of : tuple of str
        The flight is not defined without a value of at least one of these quantities.
    frees : mapping of str to str
        A value of the first quantity makes the second one unknown.
    drops : mapping of str to str
        A value of the first quantity removes the second one from the residuals.
    path : int
        `BY_GAMMA`, `BY_THETA` or `ON_GROUND`.
    """

    unknowns: tuple[str, ...]
    residuals: tuple[str, ...] = ACCELERATIONS
    fixed: Mapping[str, float] = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    frees: Mapping[str, str] = field(default_factory=dict)
    drops: Mapping[str, str] = field(default_factory=dict)
    path: int = BY_GAMMA


# Once the values of `one_of` are fixed, a kind has as many unknowns as residuals. A fixed output is
# a residual, too.
KINDS = {
    "level": Kind(
        ("alpha", "beta", *_SURFACES, "power"), fixed=_STRAIGHT, frees={"beta": "phi", "power": "V"}
    ),
    "climb": Kind(
        ("alpha", "beta", *_SURFACES, "power"),
        fixed={"phi": 0.0, "psi_dot": 0.0},
        one_of=("gamma", "hdot", "theta", "power"),
        frees={"beta": "phi", "power": "gamma"},
    ),
    "turn": Kind(
        ("alpha", "beta", *_SURFACES, "power", "psi_dot"),
        (*ACCELERATIONS, "ay"),
        fixed={"gamma": 0.0},
        one_of=("phi", "psi_dot", "nz"),
        frees={"psi_dot": "phi", "nz": "phi", "power": "gamma"},
        drops={"beta": "ay"},
    ),
    "sideslip": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0},
        one_of=("beta", "delta_r", "phi"),
        frees={"delta_r": "beta", "phi": "beta", "power": "gamma"},
    ),
    "pull_up": Kind(
        ("alpha", "beta", *_SURFACES, "power", "q"),
        fixed=_STRAIGHT,
        one_of=("nz", "q"),
        frees={"power": "gamma"},
    ),
    "engine_out": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0, "beta": 0.0},
        frees={"phi": "beta", "delta_r": "beta", "power": "gamma"},
    ),
    "ground": Kind(
        ("h", "theta", "phi"),
        (CLIMB, "p_dot", "q_dot"),
        fixed={"V": 0.0, "gamma": 0.0, "psi_dot": 0.0, "gear": 1.0},
        frees={"u_dot": "power"},
        path=ON_GROUND,
    ),
}


_ANGLE, _RATE = 1.5, 3.0  # limits of attitude and climb angle [rad], of rates [rad s-1]


class TrimLimits(NamedTuple):
    """Limits of an unknown, and the size over which the residuals change. [SI]"""

    low: float
    high: float
    size: float


# Alpha and beta have the limits of the kernel's trim at the start of a run.
LIMITS = {
    "alpha": TrimLimits(-0.6, 0.6, 1.0),
    "beta": TrimLimits(-0.35, 0.35, 1.0),
    "psi": TrimLimits(-np.inf, np.inf, 1.0),
    "V": TrimLimits(1.0, 1000.0, 100.0),
    "h": TrimLimits(-500.0, 30000.0, 10000.0),
    **dict.fromkeys(("gamma", "theta", "phi"), TrimLimits(-_ANGLE, _ANGLE, 1.0)),
    **dict.fromkeys(("p", "q", "r", "psi_dot"), TrimLimits(-_RATE, _RATE, 1.0)),
}
