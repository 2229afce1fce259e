"""Propeller and engine identified from flight: estimates, corrected tables, report.

Thrust, power and drag are estimated together from points of steady power
(`equations`, `estimate`).  The corrected tables keep axes and breakpoints of
the a-priori ones.  Inside the flown advance ratios the nodes are those of the flight; outside, the
correction at the end of the range is held and its standard error grows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flightmech.names import value_text
from flighttest.reconstruction.dynamics.shaft_condition import (
    STOPPED,
    power_unit,
    table_at,
    thrust_unit,
)
from flighttest.remarks import (
    PrintedResult,
    Remark,
    is_forbidden,
    remarks_to_json,
    warn_forbidden,
)
from flighttest.submodels.engine.propellers.corrected_tables import (
    from_flight,
    fuel_tables,
    replace_parts,
)
from flighttest.submodels.engine.propellers.corrections import (
    FlownRange,
    coefficient_slopes,
    corrected,
)
from flighttest.submodels.engine.propellers.equations import PropulsionEquations
from flighttest.submodels.engine.propellers.estimate import PointEstimate, Separability
from flighttest.submodels.engine.propellers.fit_remarks import fit_remarks
from flighttest.submodels.engine.propellers.shaft_dynamics import (
    ShaftDynamics,
)
from flighttest.submodels.engine.static_thrust import Polar

# Thrust of a propeller that takes no power, as part of the largest power, for the mean of idle.
_IDLE_POWER = 0.05
# Advance ratios at which the coefficients are printed.
_PRINTED = 5


@dataclass(frozen=True)
class PropellerFit(PrintedResult):
    """Identified propeller and engine.

    Attributes
    ----------
    equations : PropulsionEquations
        Points, a-priori tables, unknowns.
    estimate : PointEstimate
        Values with their joint covariance.
    separability : Separability or None
        Of thrust and drag; None if the polar is held.
    dynamics : ShaftDynamics or None
        Constants of shaft, governor and lever from chops and slams.
    records : tuple of str
        Names of the records.
    cut_off : tuple of str
        Stretches of the records with an engine cut off, which are left out.
    """

    equations: PropulsionEquations
    estimate: PointEstimate
    separability: Separability | None
    dynamics: ShaftDynamics | None = None
    records: tuple[str, ...] = ()
    cut_off: tuple[str, ...] = ()

    @property
    def value(self) -> dict[str, float]:
        """Estimates by name."""
        return dict(zip(self.equations.unknowns, map(float, self.estimate.value)))

    @property
    def polar(self) -> Polar:
        """Estimated drag polar with standard errors."""
        value, error = self.value, self._errors()
        return Polar(value["CD0"], value["K"], error["CD0"], error["K"])

    def _errors(self) -> dict[str, float]:
        return dict(zip(self.equations.unknowns, np.sqrt(np.diag(self.estimate.covariance))))

    def coefficient(
        self, name: str, J: Any, blade_angle: Any = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return ``CT_prop`` or ``CP_prop`` and its standard error.

        Parameters
        ----------
        name : {"CT_prop", "CP_prop"}
        J, blade_angle : array
            Advance ratio [1], and blade angle where the blades turn. [rad]
        """
        leaf = self.equations.propeller.tables[name]
        J = np.atleast_1d(np.asarray(J, float))
        at = {str(dim): np.full(J.shape, float(leaf[dim][0])) for dim in leaf["value"].dims}
        at |= {"J": J, "rpm": J}
        if blade_angle is not None:
            at["blade_angle"] = np.broadcast_to(np.asarray(blade_angle, float), J.shape)
        return self.with_error(name, table_at(leaf, at), at)

    def with_error(
        self, name: str, prior: np.ndarray, at: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return corrected coefficients and their standard errors (point,).

        Parameters
        ----------
        name : {"CT_prop", "CP_prop"}
        prior : array (point,)
            A-priori coefficients.
        at : mapping of str to array (point,)
            ``J``, and ``blade_angle`` where the blades turn.
        """
        shapes = self.equations.shapes
        value = corrected(name, prior, at, shapes, self.value)
        slopes = coefficient_slopes(name, prior, at, shapes, list(self.value))
        variance = np.einsum("ij,jk,ik->i", slopes, self.estimate.covariance, slopes)
        return value, np.sqrt(variance + self._beyond(name, prior, at["J"], shapes[name]) ** 2)

    def _beyond(self, name: str, prior: np.ndarray, J: np.ndarray, shape: FlownRange) -> np.ndarray:
        """Return the standard error that a coefficient has beyond the flown advance ratios.

        It grows to that of the prior over the length of the flown range.
        """
        unknown = self.equations.unknowns.get(f"{name} scale")
        if unknown is None:
            return np.zeros(len(J))
        distance = np.maximum(np.maximum(shape.low - J, J - shape.high), 0.0)
        share = np.minimum(distance / max(shape.high - shape.low, 1e-3), 1.0)
        return share * unknown.stderr * np.maximum(np.abs(prior), shape.size)

    def typical_blade_angle(self) -> float | None:
        """Return the median blade angle of the points [rad]; None for fixed pitch."""
        equations = self.equations
        if not equations.propeller.turns_blades:
            return None
        states = equations.states(self.value, equations.measured(self.value))
        return float(np.median(np.concatenate([state.at["blade_angle"] for state in states])))

    def power_factor(self, x: float | None = None) -> tuple[float, float]:
        """Return the factor on the gross power of the tables of the engine, and its standard error.

        Parameters
        ----------
        x : float, optional
            Manifold pressure [Pa] or n1 [1], the axis of the slope; its middle by default.
        """
        slopes = np.zeros(len(self.value))
        names = list(self.value)
        if "power scale" not in names:
            raise IdentificationError("the engine has no table of power that was corrected")
        slopes[names.index("power scale")] = 1.0
        if "power slope" in names and x is not None:
            place = self.equations.shapes["power"].place(np.array([x]))
            slopes[names.index("power slope")] = float(place[0])
        factor = 1.0 + float(slopes @ self.estimate.value)
        return factor, float(np.sqrt(slopes @ self.estimate.covariance @ slopes))

    def tables(self) -> dict[str, xr.Dataset]:
        """Return the corrected tables of propeller and engine by target, with standard errors.

        If a remark forbids their use, they are the a-priori tables.
        """
        tables = self._corrected_tables()
        if not is_forbidden(self.remarks):
            return tables
        priors = {
            **self.equations.propeller.tables,
            **self.equations.power_tables(),
            **fuel_tables(self.equations.engine),
        }
        return {name: priors[name] for name in tables}

    def _corrected_tables(self) -> dict[str, xr.Dataset]:
        tables = {}
        for name in ("CT_prop", "CP_prop"):
            if f"{name} scale" in self.value:
                tables[name] = self._corrected_coefficient(name)
        if "power scale" in self.value:
            for name, leaf in self.equations.power_tables().items():
                tables[name] = self._scaled_power(leaf)
        if "fuel flow scale" in self.value:
            factor = 1.0 + self.value["fuel flow scale"]
            error = self._errors()["fuel flow scale"]
            for name, leaf in fuel_tables(self.equations.engine).items():
                tables[name] = from_flight(leaf, factor * leaf["value"], error * abs(leaf["value"]))
        return tables

    def _corrected_coefficient(self, name: str) -> xr.Dataset:
        """Return the table of a coefficient at its own nodes."""
        prior, propeller = self.equations.propeller.tables[name], self.equations.propeller
        value = prior["value"]
        grids = dict(
            zip(
                map(str, value.dims),
                np.meshgrid(*(value[d].values for d in value.dims), indexing="ij"),
            )
        )
        J, before = grids["J"].ravel(), value.values.ravel()
        at = {"J": J, "blade_angle": grids.get("blade_angle", J).ravel()}
        after, stderr = self.with_error(name, before, at)
        shape = self.equations.shapes[name]
        inside = (shape.low <= J) & (shape.high >= J)
        if "blade_angle" in grids:
            # Angles above the governor's stop belong to the feathered propeller.
            far = grids["blade_angle"].ravel() > propeller.highest * (1.0 + 1e-9)
            factor = 1.0 + self.value.get(f"{name} feathered", 0.0)
            after = np.where(far, factor * before, after)
            share = self._errors().get(f"{name} feathered")
            prior_share = self.equations.unknowns[f"{name} scale"].stderr
            stderr = np.where(
                far, (prior_share if share is None else share) * np.abs(before), stderr
            )
            inside &= ~far | (share is not None)
        like = value.copy
        return from_flight(
            prior,
            like(data=after.reshape(value.shape)),
            like(data=stderr.reshape(value.shape)),
            inside=inside.reshape(value.shape),
        )

    def _scaled_power(self, leaf: xr.Dataset) -> xr.Dataset:
        """Return a table of power times the factor over its axis."""
        axis = self.equations.power_axis
        points = leaf[axis].values if axis else np.zeros(1)
        pairs = np.array([self.power_factor(x if axis else None) for x in points])
        factor, error = (
            xr.DataArray(column, dims=[axis] if axis else ["one"]) for column in pairs.T
        )
        if axis:
            factor, error = (x.assign_coords({axis: leaf[axis]}) for x in (factor, error))
        else:
            factor, error = factor[0], error[0]
        dims = leaf["value"].dims
        value = (leaf["value"] * factor).transpose(*dims)
        return from_flight(leaf, value, (abs(leaf["value"]) * error).transpose(*dims))

    def aircraft(self, aircraft: Aircraft) -> Aircraft:
        """Return an aircraft whose engines have the identified tables and constants.

        If a remark forbids their use, it is `aircraft` itself.

        Warns
        -----
        AeromatchWarning
            A remark forbids the use of the tables and constants.
        """
        subject = "propeller and engine, of which the aircraft keeps all tables and constants"
        warn_forbidden(self.remarks, subject)
        if is_forbidden(self.remarks):
            return aircraft
        tables = self.tables()
        constants = self.dynamics.constants() if self.dynamics else {}
        engines = tuple(replace_parts(engine, tables, constants) for engine in aircraft.engines)
        return replace(aircraft, engines=engines)

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on convergence, units, separability, points and unknowns."""
        remarks = fit_remarks(self.equations, self.estimate, self.separability)
        if self.dynamics:
            remarks += self.dynamics.remarks
        if self.cut_off:
            text = (
                f"an engine is cut off, and its lever does not show its power: "
                f"{'; '.join(self.cut_off)}; these windows are left out: give records or windows "
                f"that end before the cut-off"
            )
            remarks.append(Remark("points", text, "cutoff"))
        return remarks

    def drag_of_propellers(self) -> dict[str, tuple[float, float, int]]:
        """Return mean drag area of a propeller that takes no power, and of a feathered one.

        Returns
        -------
        dict of str to (value, standard error, points)
            ``windmilling or idle``, ``feathered``: -thrust over dynamic pressure. [m2]
        """
        equations, value = self.equations, self.value
        columns = equations.measured(value)
        areas: dict[str, list[tuple[float, float]]] = {"windmilling or idle": [], "feathered": []}
        for state, prior in zip(equations.states(value, columns), equations.states({}, columns)):
            q = 0.5 * state.at["rho"] * state.at["V"] ** 2
            unit = thrust_unit(equations.propeller, state.at) / q
            _, stderr = self.with_error("CT_prop", prior.CT, state.at)
            feathered = state.at.get("feather", np.zeros(len(q))) > 0.5
            power = state.CP * power_unit(equations.propeller, state.at)
            idle = (power < _IDLE_POWER * equations.units["power"]) & ~feathered
            own = self._errors().get("CT_prop feathered", 0.0) * np.abs(prior.CT)
            areas["windmilling or idle"] += list(
                zip((-state.CT * unit)[idle], (stderr * unit)[idle])
            )
            areas["feathered"] += list(zip((-state.CT * unit)[feathered], (own * unit)[feathered]))
        # Errors of one propeller are common to its points, so the mean error is that of the mean.
        means = {}
        for name, pairs in areas.items():
            if pairs:
                area, stderr = np.mean(pairs, axis=0)
                means[name] = float(area), float(stderr), len(pairs)
        return means

    def largest_torque_roll(self) -> float:
        """Return the largest torque of a propeller at the points over qbar S b. [1]

        The moment of a propeller about the roll axis has this size, with the sign of ``rotation``.
        """
        aircraft, value = self.equations.aircraft, self.value
        sizes = []
        for state in self.equations.states(value, self.equations.measured(value)):
            qbar_S = 0.5 * state.at["rho"] * state.at["V"] ** 2 * aircraft.S
            torque = state.shaft / np.maximum(state.at["rpm"], STOPPED)
            sizes.append(float(np.max(np.abs(torque) / (qbar_S * aircraft.b))))
        return max(sizes)

    def _rotation_line(self) -> str:
        """Return the rotations, which the points do not show, and the size of a wrong one."""
        words = []
        for engine in self.equations.aircraft.engines:
            assert engine.propeller is not None
            words.append(f"{engine.propeller.rotation:+d}")
        return (
            f"rotation {' '.join(words)} as in the aircraft file (default +1, clockwise seen from "
            f"behind), not identified: a wrong one changes Cl by 2 Q / (qbar S b) = "
            f"{2.0 * self.largest_torque_roll():.2g}"
        )

    def report_lines(self) -> list[str]:
        """Return estimates, coefficients, drag, noise and correlations as lines."""
        equations, errors = self.equations, self._errors()
        force = "accelerometers" if equations.accelerometer else "energy height"
        lines = [
            f"propeller and engine: {equations.count} points of {len(self.records)} records, force "
            f"by {force}",
            "",
            f"{'unknown':<34}{'estimate':>11}{'std. error':>12}{'a priori':>11}{'std. error':>12}",
        ]
        for name, unknown in equations.unknowns.items():
            numbers = (self.value[name], errors[name], unknown.value, unknown.stderr)
            lines.append(
                f"{name:<34}" + "".join(f"{x:>{w}.4g}" for x, w in zip(numbers, (11, 12, 11, 12)))
            )
        lines += ["", *self._coefficient_lines(), ""]
        for name, (area, stderr, count) in self.drag_of_propellers().items():
            lines.append(
                f"{name} propeller: drag area {area:.4g} ({stderr:.2g}) m2, {count} points"
            )
        for name, size in self.estimate.noise.items():
            unit = "m/s2" if name == "force" else "of the largest"
            lines.append(
                f"residual of {name}: {size:.3g} {unit}, {len(self.estimate.residuals[name])} "
                "points"
            )
        if self.separability:
            lines.append(
                f"correlation of thrust and drag: {self.separability.correlation:.3f} by the "
                f"points alone, {self.separability.posterior:.2f} with the a-priori values"
            )
            lines.append(
                f"standard error of the thrust: {self.separability.prior_error:.1%} a priori, "
                f"{self.separability.error:.1%} by the points alone, "
                f"{self.separability.posterior_error:.1%} together"
            )
        lines.append(self._rotation_line())
        if self.dynamics:
            lines += ["", *self.dynamics.report_lines()]
        return lines

    def _coefficient_lines(self) -> list[str]:
        """Return the coefficients over the flown advance ratios, at the median blade angle."""
        equations = self.equations
        shape = equations.shapes["CT_prop"]
        J = np.linspace(shape.low, shape.high, _PRINTED)
        angle, text = self.typical_blade_angle(), ""
        if angle is not None:
            text = f" at a blade angle of {value_text('blade_angle', angle)}"
        lines = [f"J{text:<33}{'CT_prop':>11}{'std. error':>12}{'CP_prop':>11}{'std. error':>12}"]
        thrust, power = (self.coefficient(name, J, angle) for name in ("CT_prop", "CP_prop"))
        for k, x in enumerate(J):
            numbers = (thrust[0][k], thrust[1][k], power[0][k], power[1][k])
            lines.append(
                f"{x:<34.3f}" + "".join(f"{y:>{w}.4g}" for y, w in zip(numbers, (11, 12, 11, 12)))
            )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON."""
        errors = self._errors()
        numbers: dict[str, Any] = {
            "estimates": {name: [x, float(errors[name])] for name, x in self.value.items()},
            "covariance": self.estimate.covariance,
            "noise": self.estimate.noise,
            "drag_area": self.drag_of_propellers(),
            "convergence": self.estimate.convergence.as_dict(),
            "remarks": remarks_to_json(self.remarks),
        }
        if self.separability:
            numbers["separability"] = {
                "correlation": self.separability.correlation,
                "posterior": self.separability.posterior,
                "error": self.separability.error,
                "posterior_error": self.separability.posterior_error,
                "prior_error": self.separability.prior_error,
                "separable": self.separability.separable,
                "manoeuvres": self.separability.manoeuvres,
            }
        if self.dynamics:
            numbers["dynamics"] = self.dynamics.as_dict()
        return numbers
