"""Geometry of a control circuit, and the force at the hand as a sum of terms.

Travel s, force F and deflection have the signs of the kernel: F has the sign of the travel that it
produces, positive aft, right and right foot, and delta = gearing s.  Reduced to the travel, [LR743]
3.4:

    F = offset + bob_weight g0 (nz - 1) + stiffness s + preload sgn(s) + friction sgn(s')
        + damping s' + mass s'' - gearing qbar S_hinge c_hinge Ch

References
----------
.. [LR743] Report LR-743, 1993, 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.units import G0
from flighttest.regression.equation_error.model import RegressionModel, term_powers

# Deflection and hinge-moment coefficient of each control.
DEFLECTION = {"column": "delta_e", "wheel": "delta_a", "pedal": "delta_r"}
COEFFICIENT = {"column": "Ch_e", "wheel": "Ch_a", "pedal": "Ch_r"}
# Default terms of the hinge moments. Alpha of the ailerons is that of the roll, p arm / V.
HINGE = {
    "column": "Ch_e = 1 + alpha + delta_e + delta_t",
    "wheel": "Ch_a = 1 + alpha + delta_a",
    "pedal": "Ch_r = 1 + beta + delta_r",
}
# Regressor of each term of the force, from the signals of `motion.control_signals`.
FORCES: Mapping[str, Callable[[Mapping[str, np.ndarray]], np.ndarray]] = {
    "offset": lambda d: np.ones_like(d["travel"]),
    "bob_weight": lambda d: G0 * (d["nz"] - 1.0),
    "stiffness": lambda d: d["travel"],
    "nose_spring": lambda d: d["on_ground"] * d["travel"],
    "preload": lambda d: d["side"],
    "friction": lambda d: d["direction"],
    "damping": lambda d: d["rate"],
    "mass": lambda d: d["acceleration"],
}
# Default terms of the force.
DEFAULT = {
    "column": ("offset", "bob_weight", "preload", "friction", "damping", "mass"),
    "wheel": ("offset", "preload", "friction", "damping", "mass"),
    "pedal": ("offset", "nose_spring", "preload", "friction", "damping", "mass"),
}


@dataclass(frozen=True)
class ControlLoading:
    """Control circuit whose constants are identified.

    Parameters
    ----------
    item : {"column", "wheel", "pedal"}
        Control.
    gearing : float
        d(delta)/ds, surveyed. [rad m-1, of the wheel rad rad-1]
    S_hinge, c_hinge : float
        Area and mean chord behind the hinge line; of both ailerons together. [m2, m]
    hinge : Model or str, optional
        Terms of the hinge-moment coefficient; the deflection enters as integer powers.  The
        variable ``alpha`` of ``Ch_a`` is the change of the local angle of attack at the aileron,
        p arm / V.
    constants : tuple of str, optional
        Terms of `FORCES` in the force.
    arm : float
        Distance of the ailerons from the plane of symmetry; only the wheel requires it. [m]
    over : (str, tuple of float), optional
        Variable over which every term of the hinge moment is a table, such as ``"mach"``, and the
        nodes of the tables, at least two and rising. [SI]

    Attributes
    ----------
    model : Model
        Terms of the hinge-moment coefficient.

    Raises
    ------
    SchemaError
        Wrong values. The message lists all of them.
    """

    item: str
    gearing: float
    S_hinge: float
    c_hinge: float
    hinge: RegressionModel | str = ""
    constants: tuple[str, ...] = ()
    arm: float = 0.0
    over: tuple[str, tuple[float, ...]] | None = None
    model: RegressionModel = field(init=False)

    def __post_init__(self):
        if self.item not in DEFLECTION:
            raise SchemaError(
                "control loading", [f"item is {self.item!r}; allowed: {', '.join(DEFLECTION)}"]
            )
        model = self.hinge or HINGE[self.item]
        if isinstance(model, str):
            model = RegressionModel.parse(model)
        if self.over is not None:
            variable, nodes = self.over
            if len(nodes) < 2 or any(b <= a for a, b in pairwise(nodes)):
                text = f"nodes over {variable} are {nodes}; give two or more, rising"
                raise SchemaError(f"control loading of the {self.item}", [text])
            model = expand_over(model, variable, nodes)
        # The dataclass is frozen: derived values are set once, here.
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "constants", tuple(self.constants) or DEFAULT[self.item])
        problems = list(self._find_problems())
        if problems:
            raise SchemaError(f"control loading of the {self.item}", problems)

    def _find_problems(self) -> Iterator[str]:
        """Yield the problems of geometry, constants and terms."""
        if not self.gearing:
            yield f"gearing is {self.gearing!r}; it must not be 0"
        for name in ("S_hinge", "c_hinge"):
            value = getattr(self, name)
            if not value > 0.0:
                yield f"{name} is {value!r}; it must be positive"
        for name in self.constants:
            if name not in FORCES:
                yield f"{name}: no term of the force; allowed: {', '.join(FORCES)}"
        for name in ("offset", "friction"):
            if name not in self.constants:
                yield f"{name} is missing; the force needs it"
        if self.model.coefficient != COEFFICIENT[self.item]:
            yield (
                f"the model is one of {self.model.coefficient}; the {self.item} has "
                f"{COEFFICIENT[self.item]}"
            )
        if self.item == "wheel" and "alpha" in self.model.variables and not self.arm > 0.0:
            yield (
                f"arm is {self.arm!r}; the distance of the ailerons from the plane of "
                f"symmetry is needed for p arm / V"
            )

    @property
    def deflection(self) -> str:
        """Name of the surface deflection."""
        return DEFLECTION[self.item]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimates: constants, then terms such as ``Ch_e: alpha``."""
        return (*self.constants, *(self.term(term) for term in self.model.terms))

    def term(self, term: str) -> str:
        """Return the name of a term of the hinge moment among the estimates."""
        return f"{self.model.coefficient}: {term}"

    def load(self, data: xr.Dataset) -> np.ndarray:
        """Return the force at the hand for Ch = 1, (time,). [N or N m]

        It is -gearing qbar S_hinge c_hinge.
        """
        return -self.gearing * self.S_hinge * self.c_hinge * data["qbar"].values

    def by_power(self, data: xr.Dataset) -> list[tuple[int, np.ndarray]]:
        """Return power of the deflection and the other factors, (time,), of every term.

        Raises
        ------
        SchemaError
            A term of the hinge moment with the deflection in a ramp.
        """
        factors_by_term = []
        for term in self.model.terms:
            factors = dict(term_powers(term))
            if any(self.deflection in factor and factor != self.deflection for factor in factors):
                raise SchemaError(
                    "control loading",
                    [f"{term}: the deflection must enter as a power, such as {self.deflection}**3"],
                )
            power = factors.pop(self.deflection, 0)
            # The other factors as a term of their own.
            spellings = []
            for name, exponent in factors.items():
                spellings.append(name if exponent == 1 else f"{name}**{exponent}")
            other = "*".join(spellings) or "1"
            regressor = RegressionModel(self.model.coefficient, [other]).design(data)[:, 0]
            factors_by_term.append((power, regressor))
        return factors_by_term


def table_basis(variable: str, nodes: Sequence[float]) -> list[str]:
    """Return the factors whose sums are the tables over these nodes, ``"1"`` first."""
    return ["1", variable, *(f"ramp({variable},{node:.10g})" for node in nodes[1:-1])]


def join_factors(term: str, factor: str) -> str:
    """Return the product of a term and a factor, of which either may be ``"1"``."""
    return "*".join(part for part in (factor, term) if part != "1") or "1"


def expand_over(model: RegressionModel, variable: str, nodes: Sequence[float]) -> RegressionModel:
    """Return a model whose terms are linear between nodes of a variable.

    Raises
    ------
    SchemaError
        A term contains the variable already.
    """
    if variable in model.variables:
        text = f"{variable} is in a term and is the variable of the tables; leave it out of one"
        raise SchemaError("control loading", [text])
    terms = []
    for term in model.terms:
        terms += [join_factors(term, factor) for factor in table_basis(variable, nodes)]
    return RegressionModel.parse(f"{model.coefficient} = {' + '.join(terms)}")


def loading_of(
    aircraft: Aircraft,
    item: str,
    model: str = "",
    constants: Sequence[str] = (),
    arm: float = 0.0,
    over: tuple[str, tuple[float, ...]] | None = None,
) -> ControlLoading:
    """Return the control circuit of an aircraft.

    Parameters
    ----------
    aircraft : Aircraft
        Aircraft with hinge geometry and gearing of the control.
    item : {"column", "wheel", "pedal"}
        Control.
    model, constants, arm, over
        As for `ControlLoading`.

    Raises
    ------
    SchemaError
        No hinge geometry or gearing of this control in the aircraft; errors of `ControlLoading`.
    """
    control = aircraft.controls.get(DEFLECTION.get(item, ""))
    if control is None or control.gearing is None:
        deflection = DEFLECTION.get(item, "delta_e")
        raise SchemaError(
            aircraft.name,
            [
                f"[control.{deflection}] with S_hinge, c_hinge and gearing is needed for the "
                f"{item}; it is missing"
            ],
        )
    return ControlLoading(
        item,
        control.gearing,
        S_hinge=control.S_hinge,
        c_hinge=control.c_hinge,
        hinge=model,
        constants=tuple(constants),
        arm=arm,
        over=over,
    )
