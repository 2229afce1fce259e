"""A flight-test campaign in simulation: fly, record, reconstruct, fit, join the runs.

The steps are those of [Gresham]: several runs with the same multisine in the same condition, least
squares run by run, the median over the runs as the value and the scaled median absolute deviation
as the scatter of single runs.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft
   Using Flight Data, section IV.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from spin_recording import as_recorded

from flightmech.errors import IdentificationError, UnknownName
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.smoother import reconstruct
from flighttest.regression.combining.pooling import pool
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.special_tests.spin.polynomial_models import Polynomial
from flighttest.special_tests.spin.rotation_rates import reconstruct_steep, spin_variables

if TYPE_CHECKING:
    import pandas as pd

    from flightmech.aircraft.aircraft import Aircraft
    from flightmech.simulation.compiler import SimModel

CUTOFF = 6.0  # [Gresham]: low-pass of all signals alike [Hz]
EDGE = 0.5  # what the ends of a zero-phase filter spoil [s]
_STEP = 0.005  # of the simulation, and of its output [s]
_RATES = {
    "gps": 5.0,
    "air_data": 20.0,
    "attitude": 50.0,
}  # of the other instruments: that of the simulation, 200 Hz


def fly_and_record(
    sim: SimModel,
    aircraft: Aircraft,
    signal: xr.Dataset,
    surfaces: Mapping[str, float],
    start: Mapping[str, float],
    errors: dict[str, float],
    rng: np.random.Generator,
    title: str = "",
) -> xr.DataTree:
    """Return the record of one simulated run.

    Parameters
    ----------
    sim : SimModel
        What flies.
    aircraft : Aircraft
        For the instruments.
    signal : Dataset (time,)
        Test input, deflections from `surfaces` [SI].
    surfaces : mapping of str to float
        Steady deflections. [rad]
    start : mapping of str to float
        ``init.*`` and other parameters; the run starts in this state, trimmed or not. [SI]
    errors : dict of str to float
        Constant errors of the instruments, `draw_errors`.
    rng : Generator
        For the noise.
    title : str
        Of the record.

    Returns
    -------
    DataTree
        A flight record.
    """
    from flightmech.simulation.run import simulate

    time = np.arange(0.0, signal["time"].values[-1] + 1e-9, _STEP)
    columns = {name: level + _moved(signal, name, time) for name, level in surfaces.items()}
    inputs = xr.Dataset(
        {name: ("time", column) for name, column in columns.items()}, {"time": time}
    )
    truth = simulate(sim, inputs, {**start, "mode.earth": 0.0, "mode.trim": 0.0}, step=_STEP)
    return as_recorded(truth, aircraft, errors, rng, _RATES, title)


def _moved(signal: xr.Dataset, name: str, time: np.ndarray) -> np.ndarray:
    return (
        np.interp(time, signal["time"].values, signal[name].values)
        if name in signal
        else np.zeros_like(time)
    )


def measured_variables(
    record: xr.DataTree,
    aircraft: Aircraft,
    window: tuple[float, float],
    steep: bool = False,
    cutoff: float = CUTOFF,
    errors: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Return coefficients and explanatory variables of one run, reconstructed and low-passed.

    Parameters
    ----------
    record : DataTree
        A flight record.
    aircraft : Aircraft
    window : (float, float)
        The moving stretch; the record goes on by `EDGE` on both sides, or the ends are spoiled by
        the filter. [s]
    steep : bool
        Reconstruct in turned axes, for flight with the nose near the vertical.
    cutoff : float
        Low-pass of all states and controls alike. [Hz]
    errors : mapping of str to float, optional
        Relative standard errors of dynamic pressure, mass and inertia, as in `coefficients`.

    Returns
    -------
    Dataset (time,)
        ``CX CY CZ Cl Cm Cn``, the states, and everything `spin_variables` gives.
    """
    path = reconstruct_steep(record, aircraft) if steep else reconstruct(record, aircraft)
    data = spin_variables(coefficients(path, aircraft, errors, cutoff), aircraft)
    return select_time(data, *window)


def fit_run(
    data: xr.Dataset, models: Mapping[str, RegressionModel], name: str = ""
) -> dict[str, Fit]:
    """Return one fit per coefficient of one run; errors as in `regress`."""
    return {coefficient: regress(model, data, name) for coefficient, model in models.items()}


def predictions(
    data: xr.Dataset, models: Mapping[str, tuple[RegressionModel, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return the coefficients that fitted models give along a run, coefficient to array (time,)."""
    return {
        coefficient: model.design(data) @ np.asarray(estimates, float)
        for coefficient, (model, estimates) in models.items()
    }


@dataclass(frozen=True)
class Recovery:
    """What a campaign found, next to what had been put in.

    Attributes
    ----------
    table : DataFrame
        Index (``coefficient``, ``term``): ``published`` and ``sigma``, ``flown`` (what the
        simulation flew), ``median`` over the runs, its ``stderr`` (1.25 scatter/sqrt(runs)),
        ``scatter`` of single runs (scaled MAD), ``run_stderr`` (mean coloured standard error),
        ``vif`` (median), ``inside`` (median within two sigma of the published value), ``error``
        (median minus flown, in ``stderr``).
    runs : int
    """

    table: pd.DataFrame
    runs: int

    @property
    def inside(self) -> int:
        """Number of terms within two sigma of the published value."""
        return int(self.table["inside"].sum())

    def models(
        self, structure: Mapping[str, RegressionModel]
    ) -> dict[str, tuple[RegressionModel, np.ndarray]]:
        """Return the medians as fitted models, coefficient to (Model, estimates)."""
        return {
            c: (model, np.array([self.table.loc[(c, term), "median"] for term in model.terms]))
            for c, model in structure.items()
        }

    def report(self) -> str:
        """Return the table as text, laid out as [Gresham] Tables 2 and 3 with what was found next
        to it.
        """
        wide, narrow = (
            ("published", "sigma", "flown", "median"),
            ("stderr", "scatter", "run_stderr"),
        )
        heads = "".join(f"{name:>11}" for name in wide) + "".join(
            f"{name.replace('_', ' '):>12}" for name in narrow
        )
        lines = [
            f"{self.runs} runs; {self.inside} of {len(self.table)} terms within two sigma of "
            f"the published value",
            f"{'':3}{'term':<17}{heads}{'VIF':>7}",
        ]
        for (coefficient, term), row in zip(
            self.table.index.to_flat_index(), self.table.to_dict("records")
        ):
            numbers = "".join(f"{row[name]:>11.4g}" for name in wide) + "".join(
                f"{row[name]:>12.2g}" for name in narrow
            )
            vif = "-" if np.isnan(row["vif"]) else f"{row['vif']:.0f}"
            lines.append(
                f"{coefficient:3}{term:<17}{numbers}{vif:>7}{'' if row['inside'] else '  outside'}"
            )
        return "\n".join(lines)


def joined(
    runs: Sequence[Mapping[str, Fit]],
    published: Mapping[str, Polynomial],
    flown: Mapping[str, Polynomial],
) -> Recovery:
    """Return the medians over several runs next to the published and the flown values.

    Parameters
    ----------
    runs : sequence of mapping of str to Fit
        As `fit_run` gives them, of the same models.
    published, flown : mapping of str to Polynomial
        Of the same terms.

    Raises
    ------
    IdentificationError
        Fewer than three runs: no median, no scatter.
    """
    import pandas as pd

    if len(runs) < 3:
        raise IdentificationError(
            f"{len(runs)} runs; the median and the scatter of single runs need at least 3"
        )
    rows = {}
    for coefficient, polynomial in published.items():
        for k, term in enumerate(polynomial.model.terms):
            e = [run[coefficient].estimates.sel(term=term) for run in runs]
            stderr = [float(one["stderr"]) for one in e]
            pooled = pool([float(one["estimate"]) for one in e], stderr, "median")
            value, sigma, truth = (
                polynomial.estimates[k],
                polynomial.sigma[k],
                flown[coefficient].estimates[k],
            )
            rows[(coefficient, term)] = {
                "published": value,
                "sigma": sigma,
                "flown": truth,
                "median": pooled.value,
                "stderr": pooled.stderr,
                "scatter": pooled.scatter,
                "run_stderr": float(np.mean(stderr)),
                "vif": float(np.median([float(one["vif"]) for one in e])),
                "inside": abs(pooled.value - value) <= 2.0 * sigma,
                "error": (pooled.value - truth) / pooled.stderr,
            }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis(["coefficient", "term"])
    return Recovery(table, len(runs))


def two_component(structure: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return a spin structure with the two independent rates normal to the flight path instead of
    the three dependent ones.

    ``phat_osc`` and ``rhat_osc`` are replaced by ``rhat_wind``; ``qhat_osc`` stays.  Nothing
    identifiable is lost: to first order about a nominal state the three are one linear combination
    of each other, of alpha and of beta.

    Raises
    ------
    UnknownName
        A coefficient without these three rates.
    """
    found = {}
    for coefficient, terms in structure.items():
        for name in ("phat_osc", "qhat_osc", "rhat_osc"):
            if name not in terms:
                raise UnknownName(
                    name,
                    terms,
                    "term",
                    f"{coefficient} does not have the three rates normal to the flight path",
                )
        found[coefficient] = tuple(
            "rhat_wind" if term == "rhat_osc" else term for term in terms if term != "phat_osc"
        )
    return found
