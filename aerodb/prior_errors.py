"""A-priori standard errors of DATCOM's estimates, by method class.

The standard error of a node is ``hypot(relative * |value|, absolute)``; nodes that are zero by definition (an increment at
zero deflection, a ground effect at height) have none.  The relative figures are the engineering defaults of the project's
identification guide (``7.6 A-priori weighting``) where it names the derivative (marked g); the others are this house's
judgement (j), set by the kind of method: fin-and-body build-ups, section data, charts of a few points.  They are starting
values, to be replaced by a project's own comparison of estimates with flight: pass ``stderr=`` to `aerodb.from_datcom`.
"""

from __future__ import annotations

from collections.abc import Mapping

from flightmech.errors import SchemaError, UnknownName

# term: (relative, absolute); the absolute one in the unit of the table
PRIOR_ERRORS: dict[str, tuple[float, float]] = {
    "CL/basic": (0.08, 0.05),  # g: slope 8 %, CL0 0.05
    "CD/basic": (0.15, 0.003),  # g: CD0 15 %
    "Cm/basic": (0.20, 0.02),  # g: slope 20 %; j: Cm0 0.02
    "CL/altitude": (0.5, 0.003),  # j: Reynolds-number effect, and rounding of the print
    "CD/altitude": (0.5, 0.001),  # j
    "Cm/altitude": (0.5, 0.003),  # j
    "CL/flap": (0.20, 0.02),  # j: as the elevator
    "CD/flap": (0.30, 0.005),  # j
    "Cm/flap": (0.30, 0.05),  # j: the tail in the downwash of the flaps is not in it
    "CL/flap_slope": (0.5, 0.1),  # j
    "Cm/flap_slope": (0.5, 0.05),  # j: exists only after a change of moment reference
    "CL/elevator": (0.20, 0.0),  # g
    "CD/elevator": (0.5, 0.002),  # j
    "Cm/elevator": (0.15, 0.0),  # g
    "CL/qhat": (0.35, 0.0),  # j: a little worse than Cm_qhat
    "CD/qhat": (0.5, 0.1),  # j: exists only after a change of moment reference
    "Cm/qhat": (0.25, 0.0),  # g
    "CL/alphadothat": (0.5, 0.5),  # g; j: the estimate passes through zero beyond the stall
    "Cm/alphadothat": (0.5, 1.5),  # g; j: as CL
    "CL/ground": (0.3, 0.01),  # j: outside its linear range the program warns itself
    "CD/ground": (0.3, 0.003),  # j
    "Cm/ground": (0.4, 0.01),  # j
    "CL/ground_flap": (0.5, 0.01),  # j: pages drift from deflection to deflection
    "CD/ground_flap": (0.5, 0.003),  # j
    "Cm/ground_flap": (0.5, 0.01),  # j
    "CL/ground_elevator": (0.5, 0.01),  # j
    "CD/ground_elevator": (0.5, 0.003),  # j
    "Cm/ground_elevator": (0.5, 0.01),  # j
    "CY/beta": (0.20, 0.02),  # j
    "Cl/beta": (0.35, 0.01),  # g
    "Cn/beta": (0.25, 0.01),  # g
    "CY/phat": (0.5, 0.05),  # j
    "Cl/phat": (0.15, 0.02),  # g
    "Cn/phat": (0.5, 0.02),  # g
    "CY/rhat": (0.5, 0.2),  # j: exists only after a change of moment reference
    "Cl/rhat": (0.5, 0.02),  # g
    "Cn/rhat": (0.30, 0.02),  # g
    "Cl/aileron": (0.20, 0.0),  # g
    "Cn/aileron": (1.0, 0.002),  # g; j: the estimate passes through zero with CL
}


def errors_with(overrides: Mapping[str, tuple[float, float]] | None) -> dict[str, tuple[float, float]]:
    """Return the table with a project's own figures laid over it.

    Parameters
    ----------
    overrides : mapping of str to (float, float), optional
        Term name to relative and absolute standard error. [1, unit of the table]

    Raises
    ------
    UnknownName
        A term that is not in the table.
    SchemaError
        An entry that is not a pair of numbers, zero or positive.
    """
    found = dict(PRIOR_ERRORS)
    for name, pair in (overrides or {}).items():
        if name not in found:
            raise UnknownName(name, found, "term", "stderr= takes terms that a listing can give")
        if not (isinstance(pair, tuple | list) and len(pair) == 2 and all(isinstance(x, int | float) and x >= 0 for x in pair)):
            raise SchemaError("stderr", [f"{name} is {pair!r}; give (relative, absolute), two numbers of zero or more"])
        found[name] = (float(pair[0]), float(pair[1]))
    return found
