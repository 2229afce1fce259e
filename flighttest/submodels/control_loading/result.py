"""What was found of the control loading: constants for the aircraft file, hinge moments for the
database, text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from aerodb.edit.table_edits import delete_terms, replace_terms
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.errors import SchemaError, UnknownName
from flightmech.units import G0
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import term_powers
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.regression import SlidingFit
from flighttest.submodels.control_loading.simulation import SimulatedWindow, fly_windows

_UNITS = {  # of a travel in m, of one in rad
    "offset": ("N", "N m"), "bob_weight": ("kg", "kg m"), "stiffness": ("N/m", "N m"), "nose_spring": ("N/m", "N m"),
    "preload": ("N", "N m"), "friction": ("N", "N m"), "damping": ("N s/m", "N m s"), "mass": ("kg", "kg m2"),
    "inertia": ("kg m2", "kg m2"), "cable_stiffness": ("N/m", "N m"), "cable_damping": ("N s/m", "N m s"),
    "hinge_friction": ("N m", "N m"), "hinge_damping": ("N m s", "N m s"), "rigging": ("rad", "rad"),
}  # fmt: skip
_CIRCUIT = (
    *(
        "mass",
        "inertia",
        "damping",
        "hinge_damping",
        "stiffness",
        "preload",
        "friction",
        "hinge_friction",
    ),
    *("cable_stiffness", "cable_damping", "rigging", "bob_weight", "nose_spring"),
)


SHARED = {
    "friction": ("hinge_friction", 1),
    "damping": ("hinge_damping", 2),
    "mass": ("inertia", 2),
}  # and power of the gearing
DRAWINGS_ERROR = 0.25  # standard error over value of what drawings, weights and cable tables give
_SIGNED = ("rigging", "bob_weight")
_NEEDED = ("mass", "inertia", "cable_stiffness")


@dataclass(frozen=True)
class IdentifiedLoading:
    """Constants of one control circuit and its hinge moments.

    Attributes
    ----------
    loading : ControlLoading
    slid : SlidingFit
        Of the force at the hand; friction, damping and mass of both ends together.
    cable : Dataset or None
        Of the stretch of the cable, see `cable_fit`; None for order 2.
    estimates : Dataset (term, term_, error)
        ``estimate``, ``stderr``, ``covariance`` of all constants and terms; friction, damping and
        mass of the cockpit end with a cable.
    """

    loading: ControlLoading
    slid: SlidingFit
    cable: xr.Dataset | None
    estimates: xr.Dataset

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
        known = [str(term) for term in self.estimates["term"].values]
        if name not in known:
            raise UnknownName(name, known, "constant or term")
        one = self.estimates.sel(term=name)
        return float(one["estimate"]), float(one["stderr"])

    def total(self, name: str) -> tuple[float, float]:
        """Return ``friction``, ``damping`` or ``mass`` of both ends of the cable, reduced to the
        travel, and its standard error.
        """
        value, stderr = self.value(name)
        if self.cable is None:
            return value, stderr
        aft, power = SHARED[name]
        terms = [name, aft]
        row = np.array([1.0, abs(self.loading.gearing) ** power])
        own = self.estimates["covariance"].sel(term=terms, term_=terms).values
        return float(row @ self.estimates["estimate"].sel(term=terms).values), float(
            np.sqrt(row @ own @ row)
        )

    def with_errors(self, changes: np.ndarray) -> IdentifiedLoading:
        """Return the result with more errors of the estimates, one row each, (sources, terms),
        independent of each other.
        """
        return self._moved(
            self.estimates["estimate"].values,
            self.estimates["covariance"].values + changes.T @ changes,
        )

    def with_prior(self, known: Circuit, error: float = DRAWINGS_ERROR) -> IdentifiedLoading:
        """Return the result joined with what is known of the circuit from its drawings.

        Parameters
        ----------
        known : Circuit
            Constants that are not zero count.
        error : float
            Their standard error over their value. [1]

        Notes
        -----
        Mixed estimation: where records cannot divide mass, damping or friction between both ends of the cable, the drawings do.

        References
        ----------
        .. [Theil1961] Theil, Goldberger, Int. Econ. Review 2, 1961.
        """
        names = [str(name) for name in self.estimates["term"].values]
        at = [
            names.index(name)
            for name in _CIRCUIT
            if name in names and name not in _SIGNED and getattr(known, name) > 0.0
        ]
        cables = 2.0 if known.order == 6 and self.order == 4 else 1.0
        prior = np.array(
            [
                getattr(known, names[k]) * (cables if names[k].startswith("cable_") else 1.0)
                for k in at
            ]
        )
        theta, C = self.estimates["estimate"].values, self.estimates["covariance"].values
        gain = np.linalg.solve(C[np.ix_(at, at)] + np.diag((error * prior) ** 2), C[at]).T
        return self._moved(theta + gain @ (prior - theta[at]), C - gain @ C[at])

    def _moved(self, theta: np.ndarray, covariance: np.ndarray) -> IdentifiedLoading:
        names = [str(name) for name in self.estimates["term"].values]
        nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(names), 0)))
        found = least_squares.regression_estimates(
            names,
            theta,
            0.5 * (covariance + covariance.T),
            np.full(len(names), np.nan),
            nothing,
            {},
        )
        return replace(self, estimates=found)

    def fly(self, free: Sequence[xr.Dataset]) -> list[SimulatedWindow]:
        """Return the free motion of records, simulated with what was identified, see `fly_windows`."""
        return fly_windows(
            self.loading,
            dict(zip(self.estimates["term"].values.tolist(), self.estimates["estimate"].values)),
            free,
        )

    @property
    def collinear(self) -> list[tuple[str, str]]:
        """Pairs of terms that go together inside every manoeuvre and are separated by differences
        between manoeuvres alone.
        """
        return self.slid.alike

    @property
    def force_bias(self) -> float:
        """What ``bias.F_column`` (wheel, pedal) of the model needs so that a recorded force acts as
        it did. [N or N m]
        """
        bob = self.value("bob_weight")[0] if "bob_weight" in self.loading.constants else 0.0
        return -(self.value("offset")[0] - bob * G0)

    def circuit(self, known: Circuit) -> Circuit:
        """Return a circuit with the identified constants; what was not identified stays, such as
        the stops.

        What is negative within two standard errors, as a damping that the records do not show,
        becomes zero.

        A wheel with two cables (order 6) moves in roll as one of order 4 with both cables: each
        gets half.

        Raises
        ------
        SchemaError
            A constant that is negative beyond its error, or a mass or stiffness that is not
            positive.
        """
        names = [str(name) for name in self.estimates["term"].values]
        order = (
            self.order if "mass" in names else known.order
        )  # without a mass only what acts slowly was identified
        found: dict[str, Any] = {name: self.value(name)[0] for name in _CIRCUIT if name in names}
        if self.order == 2:
            found |= {"inertia": 0.0} if "mass" in names else {}
            found |= {"hinge_friction": 0.0, "hinge_damping": 0.0}
        for name in (name for name in found if name not in _SIGNED):
            value, stderr = self.value(name) if name in names else (0.0, 0.0)
            if value < -2.0 * stderr or (name in names and value <= 0.0 and name in _NEEDED):
                text = (
                    f"{name} is {value:.3g} +- {stderr:.2g}; it must not be negative: leave "
                    f"it out, or take order 2"
                )
                raise SchemaError(self.loading.item, [text])
            found[name] = max(0.0, found[name])
        if known.order == 6 and self.order == 4 and order == 4:
            order = 6
            found |= {name: 0.5 * found[name] for name in ("cable_stiffness", "cable_damping")}
        return replace(known, order=order, **found)

    def aircraft(self, known: Aircraft) -> Aircraft:
        """Return an aircraft with this circuit; source and standard errors are in its history.

        Raises
        ------
        SchemaError
            The aircraft has no circuit of this control, whose stops are needed.
        """
        item, one = self.loading.item, self.loading
        if item not in known.circuits:
            raise SchemaError(
                known.name, [f"[circuit.{item}] is missing; give stops and mass at least"]
            )
        controls = {
            **known.controls,
            one.deflection: ControlGeometry(one.S_hinge, one.c_hinge, one.gearing),
        }
        circuits = {**known.circuits, item: self.circuit(known.circuits[item])}
        values = ", ".join(
            f"{name} {value:.4g} ({stderr:.2g})"
            for name, value, stderr in self._rows()
            if name in _CIRCUIT
        )
        line = (
            f"circuit.{item} identified from flight, standard errors in brackets: {values}; "
            f"bias.F_{item} {self.force_bias:.3g}"
        )
        return replace(
            known, controls=controls, circuits=circuits, history=f"{known.history}\n{line}".strip()
        )

    def published(self) -> tuple[Mapping[str, float], Mapping[str, float], np.ndarray]:
        """Return values, standard errors and correlation of the terms of the hinge moment, for
        `published_fit` and `mixed`.
        """
        terms = list(self.loading.model.terms)
        own = self.estimates.sel(
            term=[self.loading.term(t) for t in terms], term_=[self.loading.term(t) for t in terms]
        )
        sd = own["stderr"].values
        R = own["covariance"].values / np.outer(sd, sd)
        return dict(zip(terms, own["estimate"].values.tolist())), dict(zip(terms, sd.tolist())), R

    def _rows(self) -> list[tuple[str, float, float]]:
        return [(str(name), *self.value(str(name))) for name in self.estimates["term"].values]

    def report(self) -> str:
        """Return the estimates as a text table."""
        one, s = self.loading, self.slid.estimates.attrs
        wheel = one.item == "wheel"
        unit = "N m" if wheel else "N"
        lines = [
            f"{one.item}: {one.model}, gearing {one.gearing:g} {'rad/rad' if wheel else 'rad/m'}"
        ]
        lines.append(
            f"sliding: R2 {s['R2']:.5f}, rms {s['residual_rms']:.3g} {unit}, {s['samples']} "
            f"samples of {s['manoeuvres']} manoeuvres"
        )
        if self.cable is not None:
            rms = self.cable.attrs["rms"]
            lines.append(
                f"stretch of the cable: rms {f'{rms:.2g} rad' if wheel else f'{1e3 * rms:.2g} mm'}"
            )
        wide = max(len(name) for name, _, _ in self._rows()) + 2
        lines.append(f"{'':<{wide}}{'estimate':>12}{'stderr':>10}")
        for name, value, stderr in self._rows():
            lines.append(
                f"{name:<{wide}}{value:>12.5g}{stderr:>10.2g}  {_UNITS.get(name, ('', ''))[wheel]}".rstrip()
            )
        if self.order == 4:
            totals = [
                (name, *self.total(name))
                for name in ("friction", "damping", "mass")
                if name in one.constants
            ]
            lines += [
                f"{f'{name}, both ends':<{wide}}{value:>12.5g}{error:>10.2g}  {_UNITS[name][wheel]}"
                for name, value, error in totals
            ]
        pairs = [
            f"! {a} and {b} go together in every manoeuvre; only differences between them "
            f"separate the two"
            for a, b in self.collinear
        ]
        return "\n".join([*lines, *pairs])


def hinge_terms(found: IdentifiedLoading) -> dict[str, xr.Dataset]:
    """Return the terms of the hinge moment by name, ``Ch_e/alpha`` and so on, with standard errors.

    Raises
    ------
    SchemaError
        A term with a ramp or more than two factors: a leaf multiplies at most two variables.
    """
    coefficient = found.loading.model.coefficient
    leaves = {}
    for term in found.loading.model.terms:
        regressors = [name for name, power in term_powers(term).items() for _ in range(power)]
        value, stderr = found.value(found.loading.term(term))
        if len(regressors) > 2:
            leaves[f"{coefficient}/{_contribution(term)}"] = _tabulated(found, term, value, stderr)
            continue
        leaf = _terms.make_term(
            value,
            regressors=regressors,
            stderr=stderr,
            source="flight",
            comment="control loading from flight",
        )
        leaves[f"{coefficient}/{_contribution(term)}"] = leaf
    return leaves


def replace_hinge_moments(database: xr.DataTree, found: IdentifiedLoading) -> xr.DataTree:
    """Return a database whose terms of this hinge moment are those identified.

    Parameters
    ----------
    database : DataTree
    found : IdentifiedLoading
        To weigh flight against DATCOM first, give ``published_fit(model, *found.published()[:2],
        conditions, R)`` to `mixed` or to `aerodb.tabulate`, as any fit.
    """

    note = "control loading identified from flight"
    new = hinge_terms(found)
    old = [
        name
        for name in terms(database)
        if name.startswith(f"{found.loading.model.coefficient}/") and name not in new
    ]
    return replace_terms(delete_terms(database, old, note) if old else database, new, note)


def _contribution(term: str) -> str:
    return "basic" if term == "1" else term.replace("**", "").replace("*", "_")


def _tabulated(found: IdentifiedLoading, term: str, value: float, stderr: float) -> xr.Dataset:
    """A power of the deflection beyond the second: a table over it times the deflection, up to 0.5
    rad.
    """
    factors = term_powers(term)
    name = found.loading.deflection
    if set(factors) != {name}:
        raise SchemaError(
            "hinge moments",
            [f"{term}: at most two factors, or a power of {name} alone, fit into a term"],
        )
    x = np.linspace(-0.5, 0.5, 41)
    shape = x ** (factors[name] - 1)
    return _terms.make_term(
        value * shape,
        {name: x},
        [name],
        stderr=stderr * np.abs(shape),
        source="flight",
        comment="control loading from flight",
    )
