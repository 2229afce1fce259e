"""What files written here express by the names of their variables; export and import share it."""

from __future__ import annotations

STORED = "checks: "  # how the name of a case begins that stands in the database


# reduced rate: the rate it is made of and the reference length; rate * length / (2 V)
REDUCED = {
    "phat": ("p", "b"),
    "qhat": ("q", "cbar"),
    "rhat": ("r", "b"),
    "alphadothat": ("alpha_dot", "cbar"),
    "betadothat": ("beta_dot", "b"),
}
VALUE = " value"  # how the name of a constant ends that is the table of a term; it stays one, with or without standard error
