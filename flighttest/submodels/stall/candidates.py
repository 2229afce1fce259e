"""Terms of the coefficients of a stall: those of the attached flow, candidates of the separated."""

from __future__ import annotations

from flighttest.submodels.stall.model import SeparatedTerm

ATTACHED = {
    "CL": ("1", "alpha", "qhat", "delta_e"),
    "CD": ("1", "alpha", "alpha^2"),
    "Cm": ("1", "alpha", "qhat", "delta_e"),
    "CY": ("1", "beta", "delta_r"),
    "Cl": ("1", "beta", "phat", "rhat", "delta_a", "delta_r"),
    "Cn": ("1", "beta", "phat", "rhat", "delta_a", "delta_r"),
}
"""Terms of the attached flow by coefficient."""
# Lift of two halves with the angles of attack alpha -+ p y / V and Kirchhoff's factors K: its sum
# has K_left - K_right times phat, its rolling moment the mean of K times phat.
SEPARATED = {
    "CL": (
        SeparatedTerm((), "X_lift"),
        SeparatedTerm(("alpha",), "X_lift"),
        SeparatedTerm(("X_lift_diff", "phat")),
    ),
    "CD": (
        SeparatedTerm((), "X"),
        SeparatedTerm(("alpha",), "X"),
        SeparatedTerm(("X_diff", "phat")),
    ),
    "Cm": (
        SeparatedTerm((), "X"),
        SeparatedTerm(("alpha",), "X"),
        SeparatedTerm(("delta_e",), "X"),
        SeparatedTerm(("X_diff", "phat")),
    ),
    "CY": (SeparatedTerm(("beta",), "X"),),
    "Cl": (
        SeparatedTerm(("X_lift_diff",)),
        SeparatedTerm(("X_lift_diff", "alpha")),
        SeparatedTerm(("beta",), "X"),
        SeparatedTerm(("phat",), "X"),
        SeparatedTerm(("phat",), "X_lift"),
        SeparatedTerm(("delta_a",), "X"),
    ),
    "Cn": (
        SeparatedTerm(("X_diff",)),
        SeparatedTerm(("X_lift_diff", "alpha")),
        SeparatedTerm(("beta",), "X"),
        SeparatedTerm(("phat",), "X"),
        SeparatedTerm(("rhat",), "X"),
        SeparatedTerm(("delta_r",), "X"),
    ),
}
"""Candidates for terms of the separated flow by coefficient."""
