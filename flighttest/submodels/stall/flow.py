"""Separation points of both wing halves along records, with their derivatives by the parameters.

The equation is that of the simulation (`flightmech.aircraft.separation`). Between two samples the
steady separation is linear in time and V / (tau1 cbar) is constant, and the lag is exact.

References
----------
.. [Goman1994] Goman, Khrabrov, State-space representation of aerodynamic characteristics of an
   aircraft at high angles of attack, J. Aircraft 31(5), 1994.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.records.signals.differentiation import derivative, derivative_window
from flighttest.regression.expression_functions import Pieces, Slopes

SIDES = {"left": -1.0, "right": 1.0}
SHARED = ("tau1", "tau2", "asymmetry")
PER_NODE = ("a1", "alpha_star")
UNITS = {
    "alpha_left": "rad",
    "alpha_right": "rad",
    "lead_left": "rad",
    "lead_right": "rad",
    "chords": "s-1",
}
"""Quantities that `with_half_flow` adds. ``lead`` is (cbar / V) d(alpha)/dt."""
LOSSES = {"X_loss": "X", "X_lift_loss": "X_lift"}
"""One less a variable of the separation, by its name in the texts of terms."""
SLOWEST = 2.0  # [m s-1] of an airspeed in flight; our number
_LARGEST = 300.0  # exponent of the logistic function beyond which it is 0 or 1


def with_half_flow(
    record: xr.Dataset, station: float, cbar: float, frequency: float = 1.5
) -> xr.Dataset:
    """Return a record with the angle of attack of both wing halves and its rate.

    Parameters
    ----------
    record : Dataset (time,)
        ``alpha p r V`` at uniform times. [SI]
    station : float
        Distance of the stations from the plane of symmetry. [m]
    cbar : float
        Reference chord. [m]
    frequency : float
        Highest frequency that the rate follows. [Hz]

    Raises
    ------
    IdentificationError
        Fewer than two samples, samples that are not finite, or an aircraft at rest.

    Returns
    -------
    Dataset (time,)
        With the quantities of `UNITS`. The velocity along body x is V cos(alpha), that along z is
        V sin(alpha): the sideslip is left out, which changes alpha of a half by less than
        p y / V (1 - cos(beta)).
    """
    time = record["time"].values
    if len(time) < 2:
        raise IdentificationError("a record of a stall has at least two samples; give a longer one")
    for name in ("alpha", "p", "r", "V"):
        faulty = int(np.count_nonzero(~np.isfinite(record[name].values)))
        if faulty:
            raise IdentificationError(
                f"{name}: {faulty} samples of a stall are not finite, first at "
                f"{float(time[~np.isfinite(record[name].values)][0]):.2f} s; choose a window "
                "without them: the separation has a memory and cannot leave them out"
            )
    step = float(np.median(np.diff(time)))
    window = derivative_window(frequency, step)
    alpha, V = record["alpha"].values, record["V"].values
    if V.min() < SLOWEST:
        raise IdentificationError(
            f"an airspeed of {V.min():.2g} m/s at {float(time[V.argmin()]):.2f} s: at rest the "
            f"angle of attack has no meaning; choose a window in flight, above {SLOWEST:g} m/s"
        )
    columns: dict[str, np.ndarray] = {"chords": V / cbar}
    for name, side in SIDES.items():
        y = side * station
        # Velocity at the station y: that of the c.g. plus omega x r, along body x and z.
        u = V * np.cos(alpha) - record["r"].values * y
        w = V * np.sin(alpha) + record["p"].values * y
        local = np.arctan2(w, u)
        columns[f"alpha_{name}"] = local
        columns[f"lead_{name}"] = cbar / V * derivative(local, step, window)
    return record.assign({name: ("time", values) for name, values in columns.items()})


@dataclass(frozen=True)
class SeparationFlow:
    """Separation points as functions of the nonlinear parameters.

    Parameters
    ----------
    axis : str
        Variable of the configuration over which `PER_NODE` parameters are tables; empty for one
        configuration.
    nodes : tuple of float
        Breakpoints of the axis. [SI]
    fixed : mapping of str to float
        Parameters that are not estimated, and their values.
    """

    axis: str = ""
    nodes: tuple[float, ...] = (0.0,)
    fixed: Mapping[str, float] = field(default_factory=dict)
    _last: dict[str, object] = field(default_factory=dict, repr=False, compare=False)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that `evaluate` needs."""
        return (*UNITS, self.axis) if self.axis else tuple(UNITS)

    def names(self, parameter: str) -> tuple[str, ...]:
        """Return the names of a parameter at all nodes: ``a1_0``, ``a1_1``; ``tau1``."""
        if parameter in SHARED or len(self.nodes) == 1:
            return (parameter,)
        return tuple(f"{parameter}_{k}" for k in range(len(self.nodes)))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, estimated or fixed."""
        names: list[str] = []
        for parameter in (*PER_NODE, *SHARED):
            names += self.names(parameter)
        return tuple(names)

    def evaluate(
        self, quantities: Mapping[str, np.ndarray], values: Mapping[str, float], pieces: Pieces
    ) -> dict[str, Slopes]:
        """Return the variables of the separation with their derivatives by the parameters.

        Parameters
        ----------
        quantities : mapping of str to array (samples,)
            `quantities` by name.
        values : mapping of str to float
            Estimated parameters.
        pieces : Pieces
            Stretches of samples without a gap.
        """
        # All coefficients need the same values in turn.
        key = tuple(sorted(values.items()))
        alpha = quantities["alpha_left"]
        last = self._last
        same_key = last.get("key") == key
        if same_key and np.array_equal(last["alpha"], alpha):  # type: ignore[arg-type]
            return self._last["found"]  # type: ignore[return-value]
        found = self._evaluate(quantities, values, pieces)
        self._last.update(key=key, alpha=alpha, found=found)
        return found

    def _evaluate(
        self, quantities: Mapping[str, np.ndarray], values: Mapping[str, float], pieces: Pieces
    ) -> dict[str, Slopes]:
        complete = {**self.fixed, **values}
        hats = self._hats(quantities)
        a1 = self._spread(complete, "a1", hats)
        star = self._spread(complete, "alpha_star", hats)
        X: dict[str, Slopes] = {}
        for name, side in SIDES.items():
            alpha, lead = quantities[f"alpha_{name}"], quantities[f"lead_{name}"]
            reach = alpha - complete["tau2"] * lead - star - 0.5 * side * complete["asymmetry"]
            steady = 1.0 / (1.0 + np.exp(np.clip(2.0 * a1 * reach, -_LARGEST, _LARGEST)))
            # derivative by the argument of the logistic function
            slope = -2.0 * steady * (1.0 - steady)
            by = {"tau2": -slope * a1 * lead, "asymmetry": -0.5 * side * slope * a1}
            for k, hat in enumerate(hats):
                by[self.names("a1")[k]] = slope * reach * hat
                by[self.names("alpha_star")[k]] = -slope * a1 * hat
            estimated = {key: by[key] for key in by if key in values}
            X[name] = _lag(steady, estimated, quantities["chords"], complete["tau1"], pieces)
            if "tau1" not in values:
                X[name].by.pop("tau1")
        return _variables(X["left"], X["right"])

    def _hats(self, quantities: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """Return the share of every node at the samples."""
        if len(self.nodes) == 1:
            return [np.ones(1)]
        place = quantities[self.axis]
        return [np.interp(place, self.nodes, hat) for hat in np.eye(len(self.nodes))]

    def _spread(
        self, values: Mapping[str, float], parameter: str, hats: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Return a parameter at the samples."""
        shares = zip(self.names(parameter), hats, strict=True)
        return np.sum([values[name] * hat for name, hat in shares], axis=0)


def _lag(
    steady: np.ndarray,
    by: Mapping[str, np.ndarray],
    chords: np.ndarray,
    tau1: float,
    pieces: Pieces,
) -> Slopes:
    """Return the lagged separation; it is steady at the start of each piece.

    With z = V dt / (tau1 cbar), a = exp(-z) and e = (1 - a) / z the recursion is
    X_k = a X_(k-1) + (e - a) X0_(k-1) + (1 - e) X0_k.
    """
    size = len(steady)
    z = np.ones(size)
    first = np.zeros(size, bool)
    for piece, step in zip(pieces.slices, pieces.steps, strict=True):
        inner = slice(piece.start + 1, piece.stop)
        z[inner] = 0.5 * step / tau1 * (chords[piece][1:] + chords[piece][:-1])
        first[piece.start] = True
    a, e = np.exp(-z), -np.expm1(-z) / z
    a[first] = 0.0
    before, after = np.where(first, 0.0, e - a), np.where(first, 1.0, 1.0 - e)
    bands = np.ones((2, size))
    bands[1, :-1] = -a[1:]

    def drive(signal: np.ndarray) -> np.ndarray:
        return before * np.concatenate([[0.0], signal[:-1]]) + after * signal

    inputs = [drive(np.broadcast_to(signal, (size,))) for signal in (steady, *by.values())]
    lagged = scipy.linalg.solve_banded((1, 0), bands, np.stack(inputs, axis=1))
    X = lagged[:, 0]
    # Derivative of the recursion by tau1: dz = -z / tau1, da = -a dz, de = (a - e) / z dz.
    dz = -z / tau1
    da, de = np.where(first, 0.0, -a * dz), np.where(first, 0.0, (a - e) / z * dz)
    previous = np.concatenate([[0.0], X[:-1]])
    steady_before = np.concatenate([[0.0], steady[:-1]])
    slope_drive = da * previous + (de - da) * steady_before - de * steady
    slopes = dict(zip(by, lagged[:, 1:].T, strict=True))
    slopes["tau1"] = scipy.linalg.solve_banded((1, 0), bands, slope_drive)
    return Slopes(X, slopes)


def _variables(left: Slopes, right: Slopes) -> dict[str, Slopes]:
    """Return the variables of `names.SEPARATION` and `LOSSES` with their derivatives."""
    names = left.by
    lift = []
    for half in (left, right):
        root = np.sqrt(half.value)
        # Kirchhoff: the lift has the factor ((1 + sqrt(X)) / 2)^2; slope is its derivative over X.
        slope = 0.25 * (1.0 + root) / np.maximum(root, 1e-150)
        factor = (0.5 * (1.0 + root)) ** 2
        lift.append(Slopes(factor, {name: slope * half.by[name] for name in names}))

    def combine(one: Slopes, other: Slopes, a: float, b: float) -> Slopes:
        by = {name: a * one.by[name] + b * other.by[name] for name in names}
        return Slopes(a * one.value + b * other.value, by)

    mean, mean_lift = combine(left, right, 0.5, 0.5), combine(lift[0], lift[1], 0.5, 0.5)
    return {
        "X_left": left,
        "X_right": right,
        "X": mean,
        "X_diff": combine(left, right, 1.0, -1.0),
        "X_lift": mean_lift,
        "X_lift_diff": combine(lift[0], lift[1], 1.0, -1.0),
        "X_loss": _complement(mean),
        "X_lift_loss": _complement(mean_lift),
    }


def _complement(share: Slopes) -> Slopes:
    """Return one less a variable."""
    return Slopes(1.0 - share.value, {name: -slope for name, slope in share.by.items()})
