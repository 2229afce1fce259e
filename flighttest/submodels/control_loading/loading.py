"""What is known of a control circuit before the flights, and the force at the hand as a sum of
terms.

Travel s, force F and deflection have the signs of the kernel: F has the sign of the travel that it
produces, positive aft, right and right foot, and delta = gearing s.  Reduced to the travel, [LR743]
3.4:

    F = offset + bob_weight g0 (nz - 1) + stiffness s + preload sgn(s) + friction sgn(s') + damping
    s' + mass s''
        - gearing qbar S_hinge c_hinge Ch
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.units import G0
from flighttest.regression.equation_error.model import RegressionModel, term_powers

DEFLECTION = {"column": "delta_e", "wheel": "delta_a", "pedal": "delta_r"}
COEFFICIENT = {"column": "Ch_e", "wheel": "Ch_a", "pedal": "Ch_r"}
# default terms of the hinge moments; of the ailerons alpha is that of the roll, p arm / V
HINGE = {
    "column": "Ch_e = 1 + alpha + delta_e + delta_t",
    "wheel": "Ch_a = 1 + alpha + delta_a",
    "pedal": "Ch_r = 1 + beta + delta_r",
}
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
DEFAULT = {
    "column": ("offset", "bob_weight", "preload", "friction", "damping", "mass"),
    "wheel": ("offset", "preload", "friction", "damping", "mass"),
    "pedal": ("offset", "nose_spring", "preload", "friction", "damping", "mass"),
}


@dataclass(frozen=True)
class ControlLoading:
    """A control circuit whose constants are to be identified.

    Parameters
    ----------
    item : {"column", "wheel", "pedal"}
    gearing : float
        d(delta)/ds, surveyed. [rad m-1, of the wheel rad rad-1]
    S_hinge, c_hinge : float
        Area and mean chord behind the hinge line; of both ailerons together. [m2, m]
    hinge : Model or str, optional
        Terms of the hinge-moment coefficient; the deflection enters as integer powers.  Of ``Ch_a``
        the variable ``alpha`` is the change of the local angle of attack at the aileron, p arm / V.
    constants : tuple of str, optional
        Terms of `FORCES` in the force.
    arm : float
        Distance of the ailerons from the plane of symmetry; the wheel alone needs it. [m]

    Attributes
    ----------
    model : Model
        The terms of the hinge-moment coefficient.

    Raises
    ------
    SchemaError
        Every problem.
    """

    item: str
    gearing: float
    S_hinge: float
    c_hinge: float
    hinge: RegressionModel | str = ""
    constants: tuple[str, ...] = ()
    arm: float = 0.0
    model: RegressionModel = field(init=False)

    def __post_init__(self):
        if self.item not in DEFLECTION:
            raise SchemaError(
                "control loading", [f"item is {self.item!r}; allowed: {', '.join(DEFLECTION)}"]
            )
        model = self.hinge or HINGE[self.item]
        object.__setattr__(
            self, "model", RegressionModel.parse(model) if isinstance(model, str) else model
        )
        object.__setattr__(self, "constants", tuple(self.constants) or DEFAULT[self.item])
        problems = [
            f"{name} is {getattr(self, name)!r}; it must not be 0"
            for name in ("gearing",)
            if not self.gearing
        ]
        problems += [
            f"{n} is {getattr(self, n)!r}; it must be positive"
            for n in ("S_hinge", "c_hinge")
            if not getattr(self, n) > 0.0
        ]
        problems += [
            f"{name}: no term of the force; allowed: {', '.join(FORCES)}"
            for name in self.constants
            if name not in FORCES
        ]
        problems += [
            f"{name} is missing; the force needs it"
            for name in ("offset", "friction")
            if name not in self.constants
        ]
        if self.model.coefficient != COEFFICIENT[self.item]:
            problems.append(
                f"the model is one of {self.model.coefficient}; the {self.item} has "
                f"{COEFFICIENT[self.item]}"
            )
        if self.item == "wheel" and "alpha" in self.model.variables and not self.arm > 0.0:
            problems.append(
                f"arm is {self.arm!r}; the distance of the ailerons from the plane of "
                f"symmetry is needed for p arm / V"
            )
        if problems:
            raise SchemaError(f"control loading of the {self.item}", problems)

    @property
    def deflection(self) -> str:
        """Name of the surface deflection."""
        return DEFLECTION[self.item]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what the regression estimates: constants, then ``Ch_e: alpha`` and so on."""
        return (*self.constants, *(self.term(term) for term in self.model.terms))

    def term(self, term: str) -> str:
        """Return the name of a term of the hinge moment among the estimates."""
        return f"{self.model.coefficient}: {term}"

    def load(self, data: xr.Dataset) -> np.ndarray:
        """Return the force at the hand that Ch = 1 needs, -gearing qbar S_hinge c_hinge, (time,).
        [N or N m]
        """
        return -self.gearing * self.S_hinge * self.c_hinge * data["qbar"].values

    def by_power(self, data: xr.Dataset) -> list[tuple[int, np.ndarray]]:
        """Return power of the deflection and the remaining factor, (time,), of every term of the
        hinge moment.

        Raises
        ------
        SchemaError
            The deflection in a ramp.
        """
        found = []
        for term in self.model.terms:
            factors = dict(term_powers(term))
            if any(self.deflection in factor and factor != self.deflection for factor in factors):
                raise SchemaError(
                    "control loading",
                    [f"{term}: the deflection must enter as a power, such as {self.deflection}**3"],
                )
            power = factors.pop(self.deflection, 0)
            rest = (
                "*".join(f"{name}**{k}" if k != 1 else name for name, k in factors.items()) or "1"
            )
            found.append(
                (power, RegressionModel(self.model.coefficient, [rest]).design(data)[:, 0])
            )
        return found


def loading_of(
    aircraft: Aircraft, item: str, model: str = "", constants: Sequence[str] = (), arm: float = 0.0
) -> ControlLoading:
    """Return what an aircraft knows of a control.

    Raises
    ------
    SchemaError
        No hinge geometry or gearing of this control in the aircraft; the faults of
        `ControlLoading`.
    """
    control = aircraft.controls.get(DEFLECTION.get(item, ""))
    if control is None or control.gearing is None:
        wanted = DEFLECTION.get(item, "delta_e")
        raise SchemaError(
            aircraft.name,
            [
                f"[control.{wanted}] with S_hinge, c_hinge and gearing is needed for the "
                f"{item}; it is missing"
            ],
        )
    return ControlLoading(
        item, control.gearing, control.S_hinge, control.c_hinge, model, tuple(constants), arm
    )
