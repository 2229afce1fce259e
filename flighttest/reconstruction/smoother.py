"""State reconstruction: from recordings with instrument errors to one consistent flight path
([LR743] 4.3).

The estimator is the iterated extended Kalman smoother (Gauss-Newton on the joint density of path
and constants), the right one for ordinary gyros: a batch output-error fit takes the inertial unit
for perfect and its standard errors cover 30 % of the truth where they promise 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.air import GAMMA, R_AIR, RHO_SEA
from flightmech.errors import IdentificationError
from flightmech.support.figures import html_table
from flighttest.reconstruction.channel_signals import channel_signals, compatibility_figure
from flighttest.reconstruction.path_quantities import solution_states
from flighttest.reconstruction.problem.assembly import Setup, assemble_problem
from flighttest.reconstruction.problem.output_equations import SEES_GUSTS
from flighttest.reconstruction.problem.problem import PathProblem, identifiability_remarks
from flighttest.reconstruction.problem.readings import sensor_residuals
from flighttest.reconstruction.problem.trajectory import Solution, estimate_trajectory, with_gusts
from flighttest.reconstruction.state_errors import state_errors
from flighttest.records.sensors.instruments import SPEEDS, VANES, instruments_of
from flighttest.records.sensors.measurements import order_windows
from flighttest.remarks import Remark, remark_lines, remarks_to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flightmech.aircraft.aircraft import Aircraft

GUST_LENGTH = (
    150.0  # m, of the gust model; vanes and pitot see the gusts themselves, so it matters little
)
# residual rms over noise of vanes and pitot above which the air may be turbulent, or the noise is
# larger than specified
CALM = 1.1
# share of the excess variance that must be correlated for it to be gusts: halfway between white
# noise and gusts alone
GUSTY = 0.5
MEMORY = 0.25  # of the correlation time of gusts, over which their correlation is looked for
STILL = 0.1  # standard errors: a constant that moves less has settled
CALM_STEPS = 4
ACCEPT = 1.5  # residual rms over sensor noise


@dataclass(frozen=True)
class FlightPath:
    """A reconstructed flight path.

    Attributes
    ----------
    states : Dataset (time,)
        At the c.g., corrected: air-relative and ground velocity, attitude, rates and their
        derivatives, specific force, wind, air data, reduced rates; controls, engine channels and
        mass as recorded. [SI]
    biases : Dataset (parameter,)
        ``estimate stderr prior prior_stderr unit``, ``correlation prior_correlation (parameter,
        parameter_)``.
    residuals : Dataset (time,)
        Reading minus model per channel, NaN where the channel has no reading.
    fit : DataFrame
        Per channel: readings, noise, residual rms, ratio, autocorrelation at the first lag,
        verdict.
    compatibility : Dataset (time, version)
        Per channel ``raw``, ``corrected`` and ``reconstructed`` signal, see
        `flighttest.reconstruction.compatibility_table`.
    errors : Dataset (error, time)
        Change of the states for one standard error of each independent error that the constants
        leave, see `flighttest.reconstruction.state_errors`; None for a path without them.
    """

    states: xr.Dataset
    biases: xr.Dataset
    residuals: xr.Dataset
    fit: Any
    compatibility: xr.Dataset
    errors: xr.Dataset | None = None

    def report(self) -> str:
        """Return the data-compatibility report as text."""
        return _report(self)

    def plot(self, channels: Sequence[str] | None = None) -> Figure:
        """Return a figure of raw, corrected and reconstructed signals, see
        `flighttest.reconstruction.compatibility_figure`.
        """
        return compatibility_figure(self.compatibility, str(self.states.attrs["record"]), channels)

    def _repr_html_(self) -> str:
        """Return the constants as a table for a notebook."""
        keys = ("estimate", "stderr", "prior", "prior_stderr", "unit")
        names = self.biases["parameter"].values
        rows = [
            (str(name), *(self.biases[key].sel(parameter=name).item() for key in keys))
            for name in names
        ]
        time = self.states["time"].values
        caption = (
            f"Flight path of {self.states.attrs.get('record', '')}, {time[0]:g} ... "
            f"{time[-1]:g} s, {len(time)} samples"
        )
        return html_table(
            caption, ("constant", *keys), rows, [remark.text for remark in self.remarks]
        )

    @property
    def remarks(self) -> list[Remark]:
        """What a reader of the path must know: turbulence and what rests on its prior for it, noise
        that is not as specified.
        """
        return _remarks(self)

    def summary(self) -> dict[str, Any]:
        """Return constants, sensors and remarks as plain numbers and words."""
        keys = ("estimate", "stderr", "prior", "prior_stderr", "unit")
        constants = {
            str(n): {k: self.biases[k].sel(parameter=n).item() for k in keys}
            for n in self.biases["parameter"].values
        }
        about = {key: item for key, item in self.states.attrs.items() if key != "manoeuvres"} | {
            "samples": self.states.sizes["time"]
        }
        return {
            **about,
            "constants": constants,
            "sensors": self.fit,
            "identifiability": identifiability_remarks(self.biases),
            "remarks": remarks_to_json(self.remarks),
        }


def reconstruct(
    record: xr.DataTree,
    aircraft: Aircraft,
    windows: Sequence[tuple[float, float]] | None = None,
    prior: xr.Dataset | None = None,
    rate: float = 50.0,
) -> FlightPath:
    """Reconstruct the flight path of a record.

    Parameters
    ----------
    record : DataTree
        Flight record.  Needed: inertial unit (p q r ax_imu ay_imu az_imu), phi, theta; airspeed
        (q_c, or V, V_cas or mach); p_static, h_baro or h_gps; temperature, as a channel or as root
        attribute.  Used when there: psi, vn ve vd h_gps, alpha_vane, beta_vane, h_radio.  Root
        attributes: ``temperature`` [K], ``wind_down_sigma`` (standard error of the prior of the
        mean vertical wind, 0.2) [m s-1], ``latitude`` [rad], ``runway_elevation`` (for h_radio)
        [m].
    aircraft : Aircraft
        For cbar, b, c.g. and the instruments (see `flighttest.records.sensors.parse_instruments`).
    windows : sequence of (start, stop), optional
        Parts to reconstruct, with common constants; the whole record without it. [s]
    prior : Dataset, optional
        `biases` of other runs (`combine_biases`); the constants of the instruments start from them.
    rate : float
        Samples per second of the path. [Hz]

    Returns
    -------
    Path

    Raises
    ------
    OutOfRange
        A window is not inside the record.
    SchemaError
        A needed channel is missing or holds NaN; the instrument specification is faulty.
    IdentificationError
        The iteration does not settle, or a constant has neither data nor a prior.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.3.
    .. [Mulder1999] Mulder et al., Prog. Aerosp. Sci. 35, 1999.
    .. [Bell1994] Bell, SIAM J. Optim. 4, 1994.
    """
    setup, solution = solve_record(record, aircraft, windows, prior, rate)
    return path_of_solution(record, aircraft, setup, solution)


def solve_record(
    record: xr.DataTree, aircraft: Aircraft, windows=None, prior=None, rate: float = 50.0
) -> tuple[Setup, Solution]:
    """Return the problem of a record and its solution; arguments as in `reconstruct`."""
    specification = instruments_of(aircraft, record.attrs)
    setup = assemble_problem(
        record, aircraft, specification, order_windows(record, windows), rate, prior
    )
    try:
        solution = estimate_trajectory(setup.problem, setup.x, setup.c, CALM_STEPS)
        if in_calm_air(setup, solution):
            return setup, _settle(setup.problem, solution)
        return _in_turbulence(setup)
    except IdentificationError as error:
        raise IdentificationError(f"{record.attrs.get('title', 'record')}: {error}") from error


def refine_path(
    record: xr.DataTree, aircraft: Aircraft, setup: Setup, solution: Solution, prior: xr.Dataset
) -> FlightPath:
    """Return the Path of a record solved once already, with the constants of other runs as prior."""
    constants = setup.problem.constants.with_prior(prior)
    problem = replace(setup.problem, constants=constants)
    if problem.gust is None:
        setup = replace(setup, problem=problem)
        return path_of_solution(
            record,
            aircraft,
            setup,
            _settle(problem, estimate_trajectory(problem, solution.x, solution.c)),
        )
    c = np.where([name in setup.held for name in constants.names], constants.mean, solution.c)
    calm = replace(
        setup, problem=replace(problem, gust=None), x=solution.x[:, : problem.gusts.start], c=c
    )
    return path_of_solution(record, aircraft, *_in_turbulence(calm))


def in_calm_air(setup: Setup, solution: Solution) -> bool:
    """Return whether vanes and impact pressure keep to a path in uniformly moving air.

    With an inertial unit the path hardly follows gusts, so they are left over in these residuals.
    Gusts last, noise of instruments does not: of a residual larger than the noise specified, only
    what is correlated from reading to reading speaks of gusts.  So a specification that is too
    small is not turbulence.
    """
    V = max(float(np.median(np.linalg.norm(solution.x[:, 3:6], axis=1))), 10.0)
    for sensor in setup.problem.sensors:
        rest, _ = sensor_residuals(setup.problem, sensor, solution.x, solution.c)
        for r, sigma, name in zip(rest.T, sensor.sigma, sensor.names, strict=True):
            if name in SEES_GUSTS and has_gusts(r / sigma, sensor.time, MEMORY * GUST_LENGTH / V):
                return False
    return True


def has_gusts(r: np.ndarray, time: np.ndarray, memory: float) -> bool:
    """Return whether scaled residuals hold gusts: larger than the noise, and by something that
    lasts.

    Parameters
    ----------
    r : array (readings,)
        Residuals over the noise specified.
    time : array (readings,)
        [s]
    memory : float
        Lags up to this one are averaged, at least one reading. [s]

    Notes
    -----
    With the variance s^2 of r and its mean autocovariance c over the lags, c is 0 of white noise of any size and s^2 - 1 of gusts
    added to the noise specified.  Gusts are found where s > `CALM` and c > `GUSTY` (s^2 - 1), and c above two of its standard
    errors of white noise, s^2/sqrt(readings lags).
    """
    power = float(np.mean(r**2))
    if len(r) < 3 or power < CALM**2:
        return False
    lags = int(
        np.clip(memory // max(float(np.median(np.diff(time))), 1e-9), 1, max(len(r) // 4, 1))
    )
    c = float(np.mean([r[k:] @ r[:-k] / len(r) for k in range(1, lags + 1)]))
    return c > max(GUSTY * (power - 1.0), 2.0 * power / np.sqrt(len(r) * lags))


def _in_turbulence(setup: Setup) -> tuple[Setup, Solution]:
    """Return problem and solution with gusts: first the constants, then with these the gusts
    themselves.
    """
    noise = {
        n: s
        for sensor in setup.problem.sensors
        for n, s in zip(sensor.names, sensor.sigma, strict=True)
    }
    sigma = 5.0 * np.array([noise.get(n, 1e-3) for n in (*VANES, _airspeed(setup.problem))])
    held = _hidden_by_gusts(setup.problem)
    problem, x = with_gusts(setup.problem, setup.x, sigma, GUST_LENGTH, shown=True)
    first = estimate_trajectory(problem, x, setup.c, CALM_STEPS, held)
    sigma = np.maximum(np.sqrt(np.mean(first.x[:, problem.gusts] ** 2, axis=0)), 0.1 * sigma)
    problem = replace(problem, gust=sigma)
    found = replace(_settle(problem, first, held), equations=None)  # those of another problem
    del first
    blowing, x = with_gusts(
        problem, found.x, _intensity(setup, found, sigma), GUST_LENGTH, shown=False
    )
    air = _settle(
        blowing,
        estimate_trajectory(blowing, x, found.c, CALM_STEPS, problem.constants.names),
        problem.constants.names,
    )
    return replace(setup, problem=blowing, held=held), replace(
        air, covariance=found.covariance, iterations=found.iterations + air.iterations
    )


def _airspeed(problem: PathProblem) -> str:
    """Return the channel that shows the airspeed."""
    shown = [
        name for sensor in problem.sensors for name in sensor.names if name in ("q_c", *SPEEDS)
    ]
    return shown[0] if shown else "q_c"


def _hidden_by_gusts(problem: PathProblem) -> tuple[str, ...]:
    """Return the constants that turbulence hides, because gusts move vanes and aeroplane alike."""
    latencies = {
        sensor.delay for sensor in problem.sensors if not SEES_GUSTS.keys().isdisjoint(sensor.names)
    }
    factors = {f"factor.{name}" for name in VANES}
    return tuple(
        name for name in problem.constants.names if name in {*latencies, *factors, "lag.vanes"}
    )


def _settle(problem: PathProblem, solution: Solution, held: Sequence[str] = ()) -> Solution:
    """Return the settled solution, iterating on where it is not."""
    if not solution.settled:
        more = estimate_trajectory(
            problem, solution.x, solution.c, held=held, known=solution.equations
        )
        solution = replace(more, iterations=solution.iterations + more.iterations)
    if not solution.settled:
        raise IdentificationError(
            f"the reconstruction did not settle in {solution.iterations} iterations: "
            f"{_moving(problem, solution, held)}"
        )
    return solution


def _moving(problem: PathProblem, solution: Solution, held: Sequence[str]) -> str:
    """Report which constants one more iteration moves, by how much, and what to do."""
    change = estimate_trajectory(problem, solution.x, solution.c, 1, held).c - solution.c
    errors = np.sqrt(np.diag(solution.covariance))
    constants = problem.constants
    order = [k for k in np.argsort(-np.abs(change) / errors) if abs(change[k]) > STILL * errors[k]]
    if not order:
        return (
            "all constants stand still and only the path moves; look for readings that "
            "contradict each other (signs, units, clocks)"
        )
    names = [
        f"{constants.names[k]} by {change[k]:.2g} {constants.units[k]} "
        f"({abs(change[k]) / errors[k]:.2g} standard errors)"
        for k in order[:5]
    ]
    rest = f" and {len(order) - 5} more" if len(order) > 5 else ""
    return (
        f"still moving are {', '.join(names)}{rest}; give them a prior in the aircraft file, "
        f"or a window whose readings determine them"
    )


def _intensity(setup: Setup, solution: Solution, sigma: np.ndarray) -> np.ndarray:
    """Return one sigma of the gusts north, east, down from what they add to the readings.

    w = V alpha, v = V beta; u is the reading times its slope: 1/(rho V) of q_c, sqrt(rho_0/rho) of
    V_cas, the speed of sound of mach.
    """
    V = max(float(np.median(np.linalg.norm(solution.x[:, 3:6], axis=1))), 10.0)
    rho = setup.problem.constants.get(solution.c, "p_reference") / (R_AIR * setup.reference[1])
    a = np.sqrt(GAMMA * R_AIR * setup.reference[1])
    slope = {"q_c": 1.0 / (rho * V), "V": 1.0, "V_cas": np.sqrt(RHO_SEA / rho), "mach": a}[
        _airspeed(setup.problem)
    ]
    up, across, along = sigma * np.array([V, V, slope])
    level = float(np.sqrt((across**2 + along**2) / 2.0))
    return np.array([level, level, up])


def path_of_solution(
    record: xr.DataTree, aircraft: Aircraft, setup: Setup, solution: Solution
) -> FlightPath:
    """Return the Path of a solution."""

    found = setup.biases(solution)
    states = solution_states(record, aircraft, setup, solution)
    columns: dict[str, Any] = {}
    rows = []
    for sensor in setup.problem.sensors:
        values, k = sensor_residuals(setup.problem, sensor, solution.x, solution.c)
        for i, name in enumerate(sensor.names):
            column = np.full(len(setup.problem.time), np.nan)
            column[k] = values[:, i]
            columns[name] = "time", column
            rows.append(_row(name, values[:, i], float(sensor.sigma[i])))
    rest = xr.Dataset(columns, coords={"time": states["time"]})
    errors = state_errors(record, aircraft, setup, solution)
    return FlightPath(
        states,
        found,
        rest,
        pd.DataFrame(rows).set_index("channel"),
        channel_signals(setup, solution),
        errors,
    )


def _row(name: str, rest: np.ndarray, sigma: float) -> dict[str, Any]:
    rms = float(np.sqrt(np.mean(rest**2)))
    spread = rest - rest.mean()
    power = float(spread @ spread)
    lag = float(spread[1:] @ spread[:-1] / power) if power > 0.0 else 0.0
    verdict = "use" if rms < ACCEPT * sigma else "suspect: residual exceeds the noise"
    return {
        "channel": name,
        "readings": len(rest),
        "noise": sigma,
        "rms": rms,
        "ratio": rms / sigma,
        "autocorrelation": lag,
        "verdict": verdict,
    }


def _remarks(path: FlightPath) -> list[Remark]:
    found = []
    gusts, about = str(path.states.attrs.get("gusts", "none")), path.biases
    if gusts != "none":
        held = [str(name) for name in about["parameter"].values[about["held"].values.astype(bool)]]
        words = (
            f"turbulence (gusts {gusts} m/s, one sigma): {', '.join(held) or 'no constant'} "
            f"is indistinguishable from gusts and rests on "
            "its prior; give the vane calibration of a flight in calm air (--biases)"
        )
        found.append(Remark("turbulence", words, " ".join(held)))
    for name, row in path.fit.iterrows():
        if row.ratio > CALM and row.autocorrelation < GUSTY * (1.0 - 1.0 / row.ratio**2):
            words = (
                f"noise of {name} is {row.ratio:.2f} times that specified ({row.rms:.3g} for "
                f"{row.noise:.3g}), and white; correct it in "
                "the aircraft file"
            )
            found.append(Remark("noise", words, str(name), float(row.ratio), CALM))
    return found


def _report(path: FlightPath) -> str:
    states = path.states
    time = states["time"].values
    lines = [
        f"State reconstruction: {states.attrs['record']}, {time[0]:g} ... {time[-1]:g} s",
        f"{len(time)} samples at {states.attrs['rate']:g} Hz, {states.attrs['iterations']} "
        f"iterations",
        f"channels not used: {states.attrs['unused'] or 'none'}; gusts [m/s]: "
        f"{states.attrs['gusts']}",
        *(["spikes: " + states.attrs["spikes"]] if states.attrs.get("spikes") else []),
        "",
        f"{'constant':22s}{'estimate':>13s}{'std. error':>13s}{'prior':>13s}{'prior s.e.':>13s} "
        f" unit",
    ]
    for i, name in enumerate(path.biases["parameter"].values):
        row = path.biases.isel(parameter=i, parameter_=i)
        numbers = "".join(
            f"{float(row[key]):13.5g}" for key in ("estimate", "stderr", "prior", "prior_stderr")
        )
        lines.append(f"{name:22s}{numbers}  {row['unit'].item()}")
    lines += [
        "",
        f"{'channel':14s}{'readings':>9s}{'noise':>11s}{'rms':>11s}{'ratio':>7s}{'lag-1 ac':>9s} "
        f" verdict",
    ]
    for name, row in path.fit.iterrows():
        lines.append(
            f"{name:14s}{row.readings:9d}{row.noise:11.4g}{row.rms:11.4g}{row.ratio:7.2f}{row.autocorrelation:9.2f} "
            f" {row.verdict}"
        )
    words = identifiability_remarks(path.biases)
    lines += ["", *remark_lines(path.remarks)] if path.remarks else []
    return "\n".join(
        [
            *lines,
            "",
            "Identifiability:",
            *(f"  - {word}" for word in words or ["every constant is identifiable"]),
        ]
    )
