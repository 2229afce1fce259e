"""Kinds of steady flight: which quantities are unknown, which vanish, and what is freed when another is given.

A kind is data.  Names are plain: ``alpha`` stands for the start value ``init.alpha``, ``throttle`` for the levers of all engines that
run, ``power`` for whatever drives them (lever, rotor speed or recorded thrust, by ``mode.engine``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

ACCELERATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
CLIMB = "hddot"  # acceleration upward: no output, but the kernel knows it
BY_GAMMA, BY_THETA, ON_GROUND = range(3)
_SURFACES = ("delta_e", "delta_a", "delta_r")
_STRAIGHT = {"gamma": 0.0, "phi": 0.0, "psi_dot": 0.0}


@dataclass(frozen=True)
class Kind:
    """One kind of steady flight.

    Parameters
    ----------
    unknowns, residuals : tuple of str
        Unknowns, and what shall vanish.
    fixed : mapping of str to float
        Held at these values unless given otherwise. [SI]
    one_of : tuple of str
        Without a value of at least one of them the flight is not defined.
    frees : mapping of str to str
        Giving the first frees the second in its place.
    drops : mapping of str to str
        Giving the first takes the second out of the residuals.
    """

    unknowns: tuple[str, ...]
    residuals: tuple[str, ...] = ACCELERATIONS
    fixed: Mapping[str, float] = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    frees: Mapping[str, str] = field(default_factory=dict)
    drops: Mapping[str, str] = field(default_factory=dict)
    path: int = BY_GAMMA


KINDS = {
    "level": Kind(("alpha", "beta", *_SURFACES, "power"), fixed=_STRAIGHT, frees={"beta": "phi", "power": "V"}),
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
    "pull_up": Kind(("alpha", "beta", *_SURFACES, "power", "q"), fixed=_STRAIGHT, one_of=("nz", "q"), frees={"power": "gamma"}),
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
# outputs that a start value brings about, in any kind
UNKNOWN_FOR = {"V_cas": "V", "mach": "V", "qbar": "V", "hdot": "gamma", "h_agl": "h"}
