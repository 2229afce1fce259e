"""Result of the identification of a control loading.

It provides constants for the aircraft file, hinge moments for the database, and text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.errors import SchemaError, UnknownName
from flightmech.units import G0
from flighttest.regression.equation_error import least_squares
from flighttest.remarks import Convergence, PrintedResult, Remark, remarks_to_json, warn_forbidden
from flighttest.submodels.control_loading.joint_fit import convergence_remarks
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.regression import SlidingFit
from flighttest.submodels.control_loading.responses.response_fit import (
    FRICTION_MODELS,
    ResponseFit,
)
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
)
from flighttest.submodels.control_loading.simulation import SimulatedWindow, fly_windows
from flighttest.submodels.control_loading.table_coverage import list_coverage_remarks

# Units of a constant for a travel in m, and for a travel in rad.
_UNITS = {
    "offset": ("N", "N m"),
    "bob_weight": ("kg", "kg m"),
    "stiffness": ("N/m", "N m"),
    "nose_spring": ("N/m", "N m"),
    "preload": ("N", "N m"),
    "friction": ("N", "N m"),
    "damping": ("N s/m", "N m s"),
    "mass": ("kg", "kg m2"),
    "inertia": ("kg m2", "kg m2"),
    "cable_stiffness": ("N/m", "N m"),
    "cable_damping": ("N s/m", "N m s"),
    "hinge_friction": ("N m", "N m"),
    "hinge_damping": ("N m s", "N m s"),
    "rigging": ("rad", "rad"),
}
_CIRCUIT = (
    "mass",
    "inertia",
    "damping",
    "hinge_damping",
    "stiffness",
    "preload",
    "friction",
    "hinge_friction",
    "cable_stiffness",
    "cable_damping",
    "rigging",
    "bob_weight",
    "nose_spring",
)
# Constants of both ends of the cable: name at the surface, and power of the gearing to reduce it.
SHARED = {
    "friction": ("hinge_friction", 1),
    "damping": ("hinge_damping", 2),
    "mass": ("inertia", 2),
}
# Standard error over value of constants from drawings, weights and cable tables.
DRAWINGS_ERROR = 0.25
_INSTEAD = (
    "the result is that of the regressions, and its standard errors contain the difference to the "
    "output error; give records with more motion, fewer terms, or drawings"
)
# Constants that may be negative, and constants that must be positive.
_SIGNED = ("rigging", "bob_weight")
_NEEDED = ("mass", "inertia", "cable_stiffness")


@dataclass(frozen=True)
class IdentifiedLoading(PrintedResult):
    """Constants of one control circuit and its hinge moments.

    Attributes
    ----------
    loading : ControlLoading
        Control circuit.
    slid : SlidingFit
        Fit of the force at the hand; friction, damping and mass of both ends together.
    cable : Dataset or None
        Estimates of the stretch of the cable, see `cable_fit`; None for order 2.
    estimates : Dataset (term, term_, error)
        ``estimate``, ``stderr``, ``covariance`` of all constants and terms; friction, damping and
        mass are those of the cockpit end if there is a cable.
    iterations : dict of str to Convergence
        End of each iteration, by its name.
    response : ResponseFit or None
        Output error on free motion; None for regressions alone.
    sampled : array (sample,) or None
        Variable of the tables of hinge moments (`ControlLoading.over`) in the samples; None without
        tables. [SI]
    unfinished : Convergence or None
        Search of an output error that did not converge, if the regressions are the result for this
        reason.
    """

    loading: ControlLoading
    slid: SlidingFit
    cable: xr.Dataset | None
    estimates: xr.Dataset
    iterations: Mapping[str, Convergence] = field(default_factory=dict)
    response: ResponseFit | None = None
    sampled: np.ndarray | None = None
    unfinished: Convergence | None = None

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on iterations that did not converge, on tables and on the output error."""
        remarks = convergence_remarks(self.iterations)
        if self.loading.over is not None and self.sampled is not None:
            remarks += list_coverage_remarks(*self.loading.over, self.sampled)
        if self.response is not None:
            remarks += self.response.remarks
        if self.unfinished is not None:
            remarks += self.unfinished.remarks(
                "output error of the circuit", _INSTEAD, severity="warning"
            )
        return remarks

    @property
    def has_converged(self) -> bool:
        """Whether this is an output error whose search converged."""
        return self.response is not None and self.response.convergence.converged

    @property
    def is_maximum(self) -> bool:
        """Whether this is an output error whose search converged or ended stationary."""
        return self.response is not None and self.response.is_maximum

    @property
    def order(self) -> int:
        """Order of the model: 2 or 4."""
        return 2 if self.cable is None else 4

    def value(self, name: str) -> tuple[float, float]:
        """Return an estimate and its standard error.

        Raises
        ------
        UnknownName
            No such constant or term.
        """
        names = [str(term) for term in self.estimates["term"].values]
        if name not in names:
            raise UnknownName(name, names, "constant or term")
        row = self.estimates.sel(term=name)
        return float(row["estimate"]), float(row["stderr"])

    def total(self, name: str) -> tuple[float, float]:
        """Return ``friction``, ``damping`` or ``mass`` of both ends and its standard error.

        The value is reduced to the travel.
        """
        value, stderr = self.value(name)
        if self.cable is None:
            return value, stderr
        aft, power = SHARED[name]
        terms = [name, aft]
        row = np.array([1.0, abs(self.loading.gearing) ** power])
        C = self.estimates["covariance"].sel(term=terms, term_=terms).values
        estimate = float(row @ self.estimates["estimate"].sel(term=terms).values)
        return estimate, float(np.sqrt(row @ C @ row))

    def with_errors(self, changes: np.ndarray) -> IdentifiedLoading:
        """Return the result with further independent errors of the estimates, (sources, terms)."""
        return self._with_estimates(
            self.estimates["estimate"].values,
            self.estimates["covariance"].values + changes.T @ changes,
        )

    def instead_of(self, response: IdentifiedLoading) -> IdentifiedLoading:
        """Return these regressions in place of an output error that did not converge.

        The difference of both estimates is one more error of them.
        """
        change = response.estimates["estimate"].values - self.estimates["estimate"].values
        assert response.response is not None
        return replace(self.with_errors(change[None]), unfinished=response.response.convergence)

    def with_prior(self, known: Circuit, error: float = DRAWINGS_ERROR) -> IdentifiedLoading:
        """Return the result joined with the constants of the circuit by its drawings.

        Parameters
        ----------
        known : Circuit
            Constants of the drawings. Only positive constants are used.
        error : float
            Standard error of the constants over their value. [1]

        Notes
        -----
        Mixed estimation [Theil1961]: the drawings divide mass, damping or friction between both
        ends of the cable if the records cannot.

        References
        ----------
        .. [Theil1961] Theil, Goldberger, Int. Econ. Review 2, 1961.
        """
        names = [str(name) for name in self.estimates["term"].values]
        drawn = self.drawn(known)
        indices = [names.index(name) for name in drawn]
        prior = np.array(list(drawn.values()))
        theta, C = self.estimates["estimate"].values, self.estimates["covariance"].values
        gain = np.linalg.solve(
            C[np.ix_(indices, indices)] + np.diag((error * prior) ** 2), C[indices]
        ).T
        return self._with_estimates(theta + gain @ (prior - theta[indices]), C - gain @ C[indices])

    def drawn(self, known: Circuit) -> dict[str, float]:
        """Return the positive constants of a circuit that are among the estimates."""
        names = [str(name) for name in self.estimates["term"].values]
        # Order 6 has two cables, of which this model has the sum.
        cables = 2.0 if known.order == 6 and self.order == 4 else 1.0
        drawn = {}
        for name in _CIRCUIT:
            if name in names and name not in _SIGNED and getattr(known, name) > 0.0:
                drawn[name] = getattr(known, name) * (cables if name.startswith("cable_") else 1.0)
        return drawn

    def _with_estimates(self, theta: np.ndarray, covariance: np.ndarray) -> IdentifiedLoading:
        """Return the result with other estimates and a symmetric covariance."""
        names = [str(name) for name in self.estimates["term"].values]
        no_errors: tuple[list[str], np.ndarray] = ([], np.zeros((len(names), 0)))
        estimates = least_squares.regression_estimates(
            names,
            theta,
            0.5 * (covariance + covariance.T),
            white=np.full(len(names), np.nan),
            systematic=no_errors,
            extra={},
        )
        return replace(self, estimates=estimates)

    def fly(self, free: Sequence[xr.Dataset]) -> list[SimulatedWindow]:
        """Return the free motion of records, simulated with the estimates, see `fly_windows`."""
        return fly_windows(
            self.loading,
            dict(zip(self.estimates["term"].values.tolist(), self.estimates["estimate"].values)),
            free,
        )

    @property
    def collinear(self) -> list[tuple[str, str]]:
        """Pairs of terms that are collinear inside every manoeuvre.

        Only differences between manoeuvres separate them.
        """
        return self.slid.alike

    @property
    def force_bias(self) -> float:
        """Value of ``bias.F_column`` (wheel, pedal) for a replay of a recorded force. [N or N m]"""
        bob = self.value("bob_weight")[0] if "bob_weight" in self.loading.constants else 0.0
        return -(self.value("offset")[0] - bob * G0)

    def circuit(self, known: Circuit) -> Circuit:
        """Return a circuit with the identified constants; others, such as the stops, do not change.

        A constant that is negative within two standard errors, such as a damping that the records
        do not show, becomes zero.

        A wheel with two cables (order 6) moves in roll as one of order 4 with both cables: each
        gets half.

        Raises
        ------
        SchemaError
            A constant that is negative beyond its error, or a mass or stiffness that is not
            positive.
        """
        names = [str(name) for name in self.estimates["term"].values]
        has_mass = "mass" in names
        # Without a mass, only slow effects were identified.
        order = self.order if has_mass else known.order
        constants: dict[str, Any] = {
            name: self.value(name)[0] for name in _CIRCUIT if name in names
        }
        for name in constants:
            if name not in _SIGNED:
                constants[name] = self._not_negative(name)
        if self.order == 2:
            constants |= {"hinge_friction": 0.0, "hinge_damping": 0.0}
            if has_mass:
                constants["inertia"] = 0.0
        if known.order == 6 and self.order == 4 and order == 4:
            order = 6
            for name in ("cable_stiffness", "cable_damping"):
                constants[name] = 0.5 * constants[name]
        return replace(known, order=order, **constants)

    def _not_negative(self, name: str) -> float:
        """Return a constant, zero if it is negative within two standard errors."""
        value, stderr = self.value(name)
        if value < -2.0 * stderr or (value <= 0.0 and name in _NEEDED):
            text = (
                f"{name} is {value:.3g} +- {stderr:.2g}; it must not be negative: leave "
                f"it out, or take order 2"
            )
            raise SchemaError(self.loading.item, [text])
        return max(0.0, value)

    def aircraft(self, known: Aircraft) -> Aircraft:
        """Return an aircraft with this circuit; its history contains source and standard errors.

        Raises
        ------
        SchemaError
            The aircraft has no circuit of this control, whose stops are needed.

        Warns
        -----
        AeromatchWarning
            An estimate changes by more than its standard error in the last pass.
        """
        warn_forbidden(self.remarks, f"circuit of the {self.loading.item}")
        item, loading = self.loading.item, self.loading
        if item not in known.circuits:
            raise SchemaError(
                known.name, [f"[circuit.{item}] is missing; give stops and mass at least"]
            )
        controls = {
            **known.controls,
            loading.deflection: ControlGeometry(loading.S_hinge, loading.c_hinge, loading.gearing),
        }
        circuits = {**known.circuits, item: self.circuit(known.circuits[item])}
        values = []
        for name, value, stderr in self._rows():
            if name in _CIRCUIT:
                values.append(f"{name} {value:.4g} ({stderr:.2g})")
        line = (
            f"circuit.{item} identified from flight, standard errors in brackets: "
            f"{', '.join(values)}; "
            f"bias.F_{item} {self.force_bias:.3g}"
        )
        return replace(
            known, controls=controls, circuits=circuits, history=f"{known.history}\n{line}".strip()
        )

    def published(self) -> tuple[Mapping[str, float], Mapping[str, float], np.ndarray]:
        """Return values, standard errors and correlation of the terms of the hinge moment.

        They are the arguments of `published_fit` and `mixed`.
        """
        terms = list(self.loading.model.terms)
        names = [self.loading.term(term) for term in terms]
        rows = self.estimates.sel(term=names, term_=names)
        stderr = rows["stderr"].values
        R = rows["covariance"].values / np.outer(stderr, stderr)
        values = dict(zip(terms, rows["estimate"].values.tolist()))
        return values, dict(zip(terms, stderr.tolist())), R

    def _rows(self) -> list[tuple[str, float, float]]:
        return [(str(name), *self.value(str(name))) for name in self.estimates["term"].values]

    def as_dict(self) -> dict[str, Any]:
        """Return estimates with standard errors, and remarks, for JSON."""
        names = [str(name) for name in self.estimates["term"].values]
        shared = [name for name in SHARED if name in self.loading.constants]
        return {
            "item": self.loading.item,
            "order": self.order,
            "estimates": {name: self.value(name) for name in names},
            "both_ends": {name: self.total(name) for name in shared},
            "collinear": self.collinear,
            "remarks": remarks_to_json(self.remarks),
        }

    def report_lines(self) -> list[str]:
        """Return the estimates as lines."""
        loading, attrs = self.loading, self.slid.estimates.attrs
        is_wheel = loading.item == "wheel"
        # The travel of a wheel is an angle, the others are distances.
        unit, slope, k = ("N m", "rad/rad", 1) if is_wheel else ("N", "rad/m", 0)
        lines = [
            f"{loading.item}: {loading.model}, gearing {loading.gearing:g} {slope}",
            f"sliding: R2 {attrs['R2']:.5f}, rms {attrs['residual_rms']:.3g} {unit}, "
            f"{attrs['samples']} samples of {attrs['manoeuvres']} manoeuvres",
        ]
        if self.cable is not None:
            rms = self.cable.attrs["rms"]
            size = f"{rms:.2g} rad" if is_wheel else f"{1e3 * rms:.2g} mm"
            lines.append(f"stretch of the cable: rms {size}")
        if self.response is not None:
            travel, surface = (self.response.rms[name] for name in ("travel", "surface"))
            lines.append(
                f"output error of {self.response.windows} windows of free motion: travel "
                f"{travel:.2f}, surface {surface:.2f} times the noise"
            )
            for name, (value, stderr) in self.response.widths.items():
                per = "rad" if is_wheel else "m"
                unit_of = f"{per}/s" if name == FRICTION_RATE else per
                number = f"{value:.2g} ({stderr:.1g}) {unit_of}"
                if name == BRISTLE_TRAVEL:
                    lines.append(f"friction builds up as 1 - exp(-s / {number})")
                else:
                    label = "friction" if name == FRICTION_RATE else "preload"
                    lines.append(f"{label} acts as tanh(x / {number})")
            weights = []
            for name, weight in self.response.friction_models.items():
                end = " (search ended early)" if name in self.response.unfinished else ""
                weights.append(f"{FRICTION_MODELS[name]} {weight:.0%}{end}")
            lines.append(f"likelihood of friction that develops {', '.join(weights)}")
        rows = self._rows()
        width = max(len(name) for name, _, _ in rows) + 2
        lines.append(f"{'':<{width}}{'estimate':>12}{'stderr':>10}")
        for name, value, stderr in rows:
            units = _UNITS.get(name, ("", ""))
            lines.append(f"{name:<{width}}{value:>12.5g}{stderr:>10.2g}  {units[k]}".rstrip())
        if self.order == 4:
            for name in ("friction", "damping", "mass"):
                if name in loading.constants:
                    value, stderr = self.total(name)
                    label = f"{name}, both ends"
                    numbers = f"{value:>12.5g}{stderr:>10.2g}"
                    lines.append(f"{label:<{width}}{numbers}  {_UNITS[name][k]}")
        for first, second in self.collinear:
            lines.append(
                f"! {first} and {second} go together in every manoeuvre; only differences between "
                f"them separate the two"
            )
        return lines
