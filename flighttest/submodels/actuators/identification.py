"""Identification of an actuator from its logs.

The methods are equation error in frequency and output error in time.  Limits of rate and position
are estimated if the logs reach them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError
from flightmech.units import to_si
from flighttest.maximum_likelihood.result import OutputError
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.records.signals.differentiation import fourier_smooth
from flighttest.remarks import Remark
from flighttest.submodels.actuators.estimation import equation_error
from flighttest.submodels.actuators.output_error import fit_actuator_response
from flighttest.submodels.actuators.response import LIMITS, Structure, simulate_actuator
from flighttest.submodels.actuators.result import IdentifiedActuator
from flighttest.submodels.actuators.values import LogEstimates

UNITS = {"position": "rad", "rate": "rad s-1", "torque": "N m"}
"""SI unit of each measured channel; the command has whatever unit it is recorded in."""
CHANNELS = ("command", *UNITS)
# Deviation of a clock from uniform steps, in median steps, above which it is resampled.
_UNEVEN = 1e-3
# Readings inside a gap longer than this many steps are not interpolated.
_GAP = 3.0


def read_bench_log(path: str | Path, columns: Mapping[str, str] | None = None) -> xr.Dataset:
    """Return command and measured motion of an actuator from a log.

    Parameters
    ----------
    path : str or Path
        A file that `flighttest.read` opens (CSV, MATLAB, netCDF, HDF5, ULog, DataFlash). Columns
        have the names of the file.
    columns : mapping of str to str, optional
        Channel among ``command``, ``position``, ``rate``, ``torque`` to its column. The form is
        ``TABLE/COLUMN`` if there are several tables; ``COLUMN [deg]`` gives a unit that the file
        does not state.  A channel without an entry has a column of the same name.

    Returns
    -------
    Dataset (time,)
        ``command`` as recorded, ``position`` [rad], ``rate`` [rad/s], ``torque`` [N m] as far as
        recorded, on the clock of the position or rate. Other channels are interpolated linearly.
        A clock that is not uniform is replaced by a uniform clock at its median rate.

    Raises
    ------
    UnknownName
        A column that the file does not have.
    IdentificationError
        No command, or neither position nor rate.
    SchemaError
        No clock or one that does not rise, gaps in the command.

    Notes
    -----
    A held command that jumps between two samples is read as a ramp between them.  The error is half
    a sample early or late, with a mean of zero.
    """
    recording = open_recording(path, NameMap({}))
    channels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    units: dict[str, str] = {}
    for channel in CHANNELS:
        requested = (columns or {}).get(channel)
        column = locate_column(
            recording, requested or channel, path, required=requested is not None
        )
        if column is not None:
            time, values, unit = column
            si = UNITS.get(channel)
            if si and unit:
                values = np.asarray(to_si(values, unit, si))
            channels[channel], units[channel] = (time, values), si or unit
    demand_motion(channels, str(path))
    # All channels on the clock of the motion, which the actuator determines.
    motion = "position" if "position" in channels else "rate"
    clock = _uniform_clock(channels[motion][0], str(path))
    data = {}
    for name, (time, values) in channels.items():
        data[name] = "time", _resample(clock, time, values), {"units": units[name]}
    log = xr.Dataset(
        data, {"time": ("time", clock - clock[0], {"units": "s"})}, {"record": Path(path).stem}
    )
    if not np.isfinite(log["command"].values).all():
        raise SchemaError(
            str(path),
            ["the command has gaps or does not cover the log; cut the log to where it is recorded"],
        )
    return log


def demand_motion(channels, what: str) -> None:
    """Raise an error for a log without a command, or without a measured motion.

    Raises
    ------
    IdentificationError
        A log that cannot identify an actuator.
    """
    if "command" not in channels:
        raise IdentificationError(
            f"{what}: no recorded command; name its column (--command COLUMN)"
        )
    if "position" not in channels and "rate" not in channels:
        raise IdentificationError(
            f"{what}: no recorded position or rate: a command alone contains no information "
            f"about the actuator; record the position of "
            "its output and name its column (--position COLUMN)"
        )


def _uniform_clock(time: np.ndarray, what: str) -> np.ndarray:
    """Return the time stamps if they are uniform, else uniform ones at their median rate."""
    steps = np.diff(time)
    if len(steps) < 8 or not (steps > 0.0).all():
        smallest = steps.min() if len(steps) else 0.0
        raise SchemaError(
            what,
            [
                f"{len(time)} samples, smallest step {smallest:g} "
                f"s; time must rise, 9 samples at least"
            ],
        )
    step = float(np.median(steps))
    if np.ptp(steps) <= _UNEVEN * step:
        return time
    return np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)


def _resample(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings at the times of `clock`, NaN inside a gap and outside the readings."""
    if len(time) == len(clock) and np.array_equal(time, clock):
        return values
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(clock), np.nan)
    time, values = time[good], values[good]
    # `after` is the index of the first reading at or after each time of the clock.
    after = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    hole = time[after] - time[after - 1] > _GAP * max(
        float(np.median(np.diff(time))), float(np.median(np.diff(clock)))
    )
    return np.where(
        hole & (clock != time[after - 1]) & (clock != time[after]),
        np.nan,
        np.interp(clock, time, values, left=np.nan, right=np.nan),
    )


# Part of the samples at which a response must be at a limit for the limit to be estimated.
_REACHED = 0.005
# Factors on the natural frequency of the equation error, which mistakes a limit for slowness.
_QUICKER = (1.0, 2.0)
# Smallest start value of inertia and stiffness.
_SMALLEST = 1e-9


def identify_actuator(
    logs: xr.Dataset | Sequence[xr.Dataset],
    gear: float = 1.0,
    limits: bool = True,
    delay: bool = True,
    held: bool = False,
    band: tuple[float, float] | None = None,
) -> IdentifiedActuator:
    """Identify Ma v' + Ca v + Ka p + G tau = B [u(t - delay) - neutral] with limits.

    The equation is [Grauer2010], eq. (8).

    Parameters
    ----------
    logs : Dataset (time,) or sequence of Dataset
        As from `read_bench_log`: ``command`` in any unit, ``position`` [rad] of a servo or ``rate``
        [rad/s] of a motor, or both, and ``torque`` [N m] if it was measured. The torque is positive
        if the actuator drives its load towards positive position.
    gear : float
        G: torque at the actuator per measured torque. [1]
    limits : bool
        Whether limits of rate and position are estimated.
    delay : bool
        Whether the command has a dead time.
    held : bool
        Whether the command holds from its time stamp to the next one. This applies if the loop that
        writes the log also commands the actuator.  Otherwise a jump lies anywhere between two
        samples, which adds the sampling interval over the root of twelve to the error of the dead
        time.
    band : (low, high), optional
        Band of the equation error. Default: where the motion exceeds its noise. [Hz]

    Returns
    -------
    IdentifiedActuator
        Without a measured torque, its coefficients are ratios to Ma.

    Raises
    ------
    IdentificationError
        Neither position nor rate, a constant command or motion, or logs with different channels.

    Notes
    -----
    The output error gives the result.  It contains the limits and treats the noise of the motion as
    noise of its outputs.  In the equation error, noise of the motion is noise of the regressors and
    causes a bias.  Limits are estimated if they lower the information criterion BIC and hold half a
    per cent of the samples.  Otherwise the largest rate and position reached bound them from below.

    References
    ----------
    .. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
       aerodynamics model, AIAA 2010-7632.
    """
    records = [logs] if isinstance(logs, xr.Dataset) else list(logs)
    structure = _structure(records, gear, delay=delay, held=held)
    if structure.absolute:
        records = [_with_smooth_torque(_fill_gaps(log, ("torque",))) for log in records]
    spectral = equation_error([_fill_gaps(log) for log in records], structure, band)
    start = spectral.values | {"delay": max(spectral.values.get("delay", 0.0), 0.0)}
    for name in ("Ma", "Ka", "Ka/Ma"):
        if name in start:
            start[name] = max(start[name], _SMALLEST)
    selection: list[Remark] = []
    if limits and structure.stiffness:
        response, structure, selection = _fit_limits(records, structure, start)
    else:
        response = fit_actuator_response(records, structure, start)
    return IdentifiedActuator(
        structure=structure,
        spectral=spectral,
        response=response,
        alone=_fit_each_log(records, structure, response),
        logs=tuple(records),
        reached=_limited_fraction(records, structure, response),
        selection=tuple(selection),
    )


def _structure(records: Sequence[xr.Dataset], gear: float, delay: bool, held: bool) -> Structure:
    """Return the model that the channels of the logs allow."""
    if not records:
        raise IdentificationError("no log; give one of an actuator with its command and position")
    for k, log in enumerate(records, 1):
        name = str(log.attrs.get("record", f"log {k}"))
        demand_motion(log, name)
        for channel in ("command", "position" if "position" in log else "rate"):
            if not np.nanstd(log[channel].values) > 0.0:
                raise IdentificationError(
                    f"{name}: the {channel} does not move; choose a log, or a stretch of it, "
                    f"with an excitation"
                )
    kinds = {("position" in log, "rate" in log, "torque" in log) for log in records}
    if len(kinds) > 1:
        raise IdentificationError(
            "the logs differ in which of position, rate and torque they hold; identify those "
            "that agree"
        )
    # A torque that never changes determines no inertia.
    torque = "torque" in records[0] and all(
        np.nanstd(log["torque"].values) > 0.0 for log in records
    )
    return Structure("position" in records[0], torque, delay=delay, gear=gear, held=held)


def _with_smooth_torque(log: xr.Dataset) -> xr.Dataset:
    """Return the log with a smooth torque and the standard deviation of its noise.

    The torque is an input of the response, where noise would cause a bias.
    """
    time, torque = log["time"].values, log["torque"].values
    smooth = fourier_smooth(torque, float((time[-1] - time[0]) / (len(time) - 1))).value
    attrs = {**log["torque"].attrs, "noise": float(np.std(torque - smooth))}
    return log.assign(torque=("time", smooth, attrs))


def _fill_gaps(
    log: xr.Dataset, names: Sequence[str] = ("position", "rate", "torque")
) -> xr.Dataset:
    """Return the log with missing readings interpolated, as spectra require it."""
    time = log["time"].values
    filled = {}
    for name in names:
        if name not in log:
            continue
        missing = ~np.isfinite(log[name].values)
        if missing.any():
            readings = log[name].values[~missing]
            filled[name] = "time", np.interp(time, time[~missing], readings)
    return log.assign(filled)


def _fit_limits(
    records: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> tuple[OutputError, Structure, list[Remark]]:
    """Return the output error of the structure that BIC prefers, and remarks on the comparison.

    The candidates are the model without limits and the model with the limits that are reached.
    """
    free = fit_actuator_response(records, structure, start)
    limited = _fit_reached_limits(records, structure, start)
    if limited is None:
        return free, structure, []
    # every reading of the likelihood counts, position and rate
    samples = 0
    for log in records:
        for name in {"position", "rate"} & set(log):
            samples += int(np.isfinite(log[name].values).sum())

    def bic(fit: OutputError, model: Structure) -> float:
        return 2.0 * float(fit.estimates.attrs["cost"]) + len(model.parameters) * np.log(samples)

    if bic(*limited) < bic(free, structure):
        return *limited, _selection_remarks("without limits", free)
    return free, structure, _selection_remarks("with limits", limited[0])


def _selection_remarks(model: str, rejected: OutputError) -> list[Remark]:
    """Return a warning if the search of the rejected model did not converge."""
    attrs = rejected.estimates.attrs
    if attrs["converged"]:
        return []
    text = (
        f"selection of limits: the rejected model {model} is not converged after "
        f"{attrs['iterations']} iterations; its likelihood may be higher, so check the limits "
        f"against the logs"
    )
    return [Remark("convergence", text, "limits")]


def _fit_reached_limits(
    records: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> tuple[OutputError, Structure] | None:
    """Return the fit with all limits that the response reaches; None if it reaches none."""
    # First values: just below the extremes, so that the first response is at every limit.
    speed = max(float(np.nanmax(np.abs(_rate(log)))) for log in records)
    lowest = min(float(np.nanquantile(log["position"].values, 0.005)) for log in records)
    highest = max(float(np.nanquantile(log["position"].values, 0.995)) for log in records)
    first = {"rate_limit": 0.9 * speed, "stop_low": lowest, "stop_high": highest}
    starts = [{**first, **_scale_frequency(start, factor)} for factor in _QUICKER]

    model = replace(structure, **dict.fromkeys(LIMITS, True))
    while any(getattr(model, name) for name in LIMITS):
        fit = _best_fit(records, model, starts)
        if fit is None:
            return None
        reached = _limited_fraction(records, model, fit)
        idle = [name for name, part in reached.items() if part <= _REACHED]
        if not idle:
            return fit, model
        model = replace(model, **dict.fromkeys(idle, False))
    return None


def _best_fit(
    records: Sequence[xr.Dataset], model: Structure, starts: Sequence[Mapping[str, float]]
) -> OutputError | None:
    """Return the most likely of the fits from several starts; None if every start fails."""
    fits = []
    for start in starts:
        try:
            fits.append(fit_actuator_response(records, model, start))
        except IdentificationError:
            continue
    return min(fits, key=lambda fit: float(fit.estimates.attrs["cost"]), default=None)


def _scale_frequency(values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return parameters with a scaled natural frequency.

    Static gain and damping ratio do not change.
    """
    power = {"Ca": 1, "Ka": 2, "B": 2}
    return {
        name: value * factor ** power.get(name.removesuffix("/Ma"), 0)
        for name, value in values.items()
    }


def _rate(log: xr.Dataset) -> np.ndarray:
    """Return the rate as recorded, or the slope of the position over five samples."""
    if "rate" in log:
        return log["rate"].values
    x, time = log["position"].values, log["time"].values
    return (x[4:] - x[:-4]) / (time[4:] - time[:-4])


def _limited_fraction(
    records: Sequence[xr.Dataset], structure: Structure, fit: OutputError
) -> dict[str, float]:
    """Return the part of the samples at which the simulated response is at each limit."""
    at_limit: dict[str, list[np.ndarray]] = {}
    for k, log in enumerate(records, 1):
        values = fit.of_manoeuvre(k)
        response = simulate_actuator(log, structure, values)
        if structure.rate_limit:
            at_limit.setdefault("rate_limit", []).append(
                np.abs(response["rate"].values) > (1.0 - 1e-6) * values["rate_limit"]
            )
        # A position within this distance of a stop is at the stop.
        width = 1e-6 * float(np.ptp(response["position"].values))
        for name, sign in (("stop_low", 1.0), ("stop_high", -1.0)):
            if getattr(structure, name):
                at_limit.setdefault(name, []).append(
                    sign * (response["position"].values - values[name]) < width
                )
    return {name: float(np.concatenate(parts).mean()) for name, parts in at_limit.items()}


def _fit_each_log(
    records: Sequence[xr.Dataset], structure: Structure, fit: OutputError
) -> tuple[LogEstimates, ...]:
    """Return the estimates of each log alone; a log that cannot determine them is omitted."""
    if len(records) == 1:
        return ()
    estimates = []
    for log in records:
        try:
            single = fit_actuator_response([log], structure, fit.parameters)
        except IdentificationError:
            continue
        e = single.estimates.sel(parameter=list(structure.parameters))
        names = [str(name) for name in e["parameter"].values]
        values = dict(zip(names, e["estimate"].values.tolist()))
        stderr = dict(zip(names, e["stderr"].values.tolist()))
        estimates.append(
            LogEstimates(
                str(log.attrs.get("record", "")),
                values,
                stderr,
                converged=bool(e.attrs["converged"]),
                iterations=int(e.attrs["iterations"]),
            )
        )
    return tuple(estimates)
