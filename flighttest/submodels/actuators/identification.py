"""Identification of an actuator from its logs: equation error in frequency, output error in time,
limits as far as they were reached.
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
from flighttest.submodels.actuators.estimation import equation_error, fit_actuator_response
from flighttest.submodels.actuators.response import LIMITS, Structure, simulate_actuator
from flighttest.submodels.actuators.result import IdentifiedActuator, LogEstimates

UNITS = {"position": "rad", "rate": "rad s-1", "torque": "N m"}
"""SI unit of each measured channel; the command has whatever unit it is recorded in."""
CHANNELS = ("command", *UNITS)
_UNEVEN = 1e-3  # of the median step, beyond which a clock is made even
_GAP = 3.0  # steps; samples in a longer hole are no readings


def read_bench_log(path: str | Path, columns: Mapping[str, str] | None = None) -> xr.Dataset:
    """Return command and measured motion of an actuator from a log.

    Parameters
    ----------
    path : str or Path
        CSV, MATLAB, netCDF, HDF5, ULog, DataFlash: whatever `flighttest.read` opens, by its own
        column names.
    columns : mapping of str to str, optional
        Channel among ``command``, ``position``, ``rate``, ``torque`` to the column that holds it,
        ``TABLE/COLUMN`` where there are several tables; ``COLUMN [deg]`` gives a unit that the file
        does not state.  A channel without an entry is looked for under its own name.

    Returns
    -------
    Dataset (time,)
        ``command`` as recorded, ``position`` [rad], ``rate`` [rad/s], ``torque`` [N m] as far as
        recorded, on the clock of the position or rate; others are interpolated onto it linearly,
        and a clock that is not uniform is made even at its median rate.

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
    A held command that jumps between two samples is read as a ramp between them: half a sample early or late, zero in the mean.
    """
    recording = open_recording(path, NameMap({}))
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    units: dict[str, str] = {}
    for channel in CHANNELS:
        wanted = (columns or {}).get(channel)
        place = locate_column(recording, wanted or channel, path, required=wanted is not None)
        if place is not None:
            time, values, unit = place
            si = UNITS.get(channel)
            values = np.asarray(to_si(values, unit, si)) if si and unit else values
            found[channel], units[channel] = (time, values), si or unit
    demand_motion(found, str(path))
    clock = _even(found["position" if "position" in found else "rate"][0], str(path))
    data = {
        name: ("time", _onto(clock, *pair), {"units": units[name]}) for name, pair in found.items()
    }
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
    """Raise for a log without a command, or without a measured motion.

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


def _even(time: np.ndarray, what: str) -> np.ndarray:
    """Return the stamps themselves where they are uniform, else even ones at their median rate."""
    steps = np.diff(time)
    if len(steps) < 8 or not (steps > 0.0).all():
        raise SchemaError(
            what,
            [
                f"{len(time)} samples, smallest step {steps.min() if len(steps) else 0.0:g} "
                f"s; time must rise, 9 samples at least"
            ],
        )
    step = float(np.median(steps))
    if np.ptp(steps) <= _UNEVEN * step:
        return time
    return np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)


def _onto(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings at the times of `clock`, NaN where none is near."""
    if len(time) == len(clock) and np.array_equal(time, clock):
        return values
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(clock), np.nan)
    time, values = time[good], values[good]
    after = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    hole = time[after] - time[after - 1] > _GAP * max(
        float(np.median(np.diff(time))), float(np.median(np.diff(clock)))
    )
    return np.where(
        hole & (clock != time[after - 1]) & (clock != time[after]),
        np.nan,
        np.interp(clock, time, values, left=np.nan, right=np.nan),
    )


_REACHED = 0.005  # part of the samples that a limit must hold
_QUICKER = (
    1.0,
    2.0,
)  # natural frequency of a start over that of the equation error, which takes a limit for slowness
_SMALLEST = 1e-9


def identify_actuator(
    logs: xr.Dataset | Sequence[xr.Dataset],
    gear: float = 1.0,
    limits: bool = True,
    delay: bool = True,
    held: bool = False,
    band: tuple[float, float] | None = None,
) -> IdentifiedActuator:
    """Identify Ma v' + Ca v + Ka p + G tau = B [u(t - delay) - neutral], [Grauer2010] eq. (8), with
    limits.

    Parameters
    ----------
    logs : Dataset (time,) or sequence of Dataset
        As from `read_bench_log`: ``command`` in any unit, ``position`` [rad] of a servo or ``rate``
        [rad/s] of a motor, or both, and ``torque`` [N m] where a cell measured it, positive where
        the actuator drives its load towards positive position.
    gear : float
        G: torque at the actuator per measured torque. [1]
    limits : bool
        Whether limits of rate and position are looked for.
    delay : bool
        Whether the command has a dead time.
    held : bool
        Whether the command holds from its stamp to the next, as where the loop that writes the log
        commands the actuator.  Otherwise a jump lies anywhere between two samples, which adds the
        sampling interval over the root of twelve to the error of the dead time.
    band : (low, high), optional
        Of the equation error; default: where the motion stands above its noise. [Hz]

    Returns
    -------
    IdentifiedActuator
        Without a measured torque its coefficients are ratios to Ma.

    Raises
    ------
    IdentificationError
        No position and no rate, a command or motion that does not move, logs that do not agree on
        what they record.

    Notes
    -----
    The output error is what is used: it knows the limits and takes the noise of the motion for noise of its outputs, which biases the
    equation error, where it is noise of the regressors.  Limits are kept where they lower the information criterion BIC and hold half a
    per cent of the samples; otherwise the largest rate and position reached bound them from below.

    References
    ----------
    .. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
    """
    records = [logs] if isinstance(logs, xr.Dataset) else list(logs)
    structure = _structure(records, gear, delay, held)
    if structure.absolute:
        records = [_with_smooth_torque(_without_gaps(log, ("torque",))) for log in records]
    first = equation_error([_without_gaps(log) for log in records], structure, band)
    start = first.values | {"delay": max(first.values.get("delay", 0.0), 0.0)}
    for name in ("Ma", "Ka", "Ka/Ma"):
        if name in start:
            start[name] = max(start[name], _SMALLEST)
    if limits and structure.stiffness:
        found, structure = _with_limits(records, structure, start)
    else:
        found = fit_actuator_response(records, structure, start)
    single = [_alone(log, structure, found) for log in records] if len(records) > 1 else []
    return IdentifiedActuator(
        structure,
        first,
        found,
        tuple(one for one in single if one),
        tuple(records),
        _reached(records, structure, found),
    )


def _structure(records: Sequence[xr.Dataset], gear: float, delay: bool, held: bool) -> Structure:
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
    kinds = {tuple(name in log for name in ("position", "rate", "torque")) for log in records}
    if len(kinds) > 1:
        raise IdentificationError(
            "the logs differ in which of position, rate and torque they hold; identify those "
            "that agree"
        )
    torque = "torque" in records[0] and all(
        np.nanstd(log["torque"].values) > 0.0 for log in records
    )
    return Structure("position" in records[0], torque, delay, gear=gear, held=held)


def _with_smooth_torque(log: xr.Dataset) -> xr.Dataset:
    """Return the log with the noise of its torque removed: the torque is an input of the response,
    where noise biases.
    """
    time = log["time"].values
    smooth = fourier_smooth(
        log["torque"].values, float((time[-1] - time[0]) / (len(time) - 1))
    ).value
    return log.assign(
        torque=(
            "time",
            smooth,
            {**log["torque"].attrs, "noise": float(np.std(log["torque"].values - smooth))},
        )
    )


def _without_gaps(
    log: xr.Dataset, names: Sequence[str] = ("position", "rate", "torque")
) -> xr.Dataset:
    """Return the log with missing readings interpolated, as spectra need them."""
    time = log["time"].values
    filled = {}
    for name in names:
        if name in log and (bad := ~np.isfinite(log[name].values)).any():
            filled[name] = "time", np.interp(time, time[~bad], log[name].values[~bad])
    return log.assign(filled)


def _with_limits(
    records: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> tuple[OutputError, Structure]:
    """Return the output error of the structure that BIC prefers: all limits, those that no response
    reaches taken off, or none.
    """
    speed = max(float(np.nanmax(np.abs(_rate(log)))) for log in records)
    lowest = min(float(np.nanquantile(log["position"].values, 0.005)) for log in records)
    highest = max(float(np.nanquantile(log["position"].values, 0.995)) for log in records)
    samples = sum(int(np.isfinite(log["position"].values).sum()) for log in records)
    first = {"rate_limit": 0.9 * speed, "stop_low": lowest, "stop_high": highest}

    def bic(found: OutputError, model: Structure) -> float:
        return 2.0 * float(found.estimates.attrs["cost"]) + len(model.parameters) * np.log(samples)

    free = fit_actuator_response(records, structure, start), structure
    model = replace(structure, **dict.fromkeys(LIMITS, True))
    tried = [free]
    while any(getattr(model, name) for name in LIMITS):
        found = _best(records, model, [{**first, **_quicker(start, factor)} for factor in _QUICKER])
        idle = (
            LIMITS
            if found is None
            else [
                name for name, part in _reached(records, model, found).items() if part <= _REACHED
            ]
        )
        if found is not None and not idle:
            tried.append((found, model))
            break
        model = replace(model, **dict.fromkeys(idle, False))
    return min(tried, key=lambda one: bic(*one))


def _best(
    records: Sequence[xr.Dataset], model: Structure, starts: Sequence[Mapping[str, float]]
) -> OutputError | None:
    """Return the most likely of the estimates from several starts; None where no start leads to
    any.
    """
    found = []
    for start in starts:
        try:
            found.append(fit_actuator_response(records, model, start))
        except IdentificationError:
            continue
    return min(found, key=lambda one: float(one.estimates.attrs["cost"])) if found else None


def _quicker(values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return parameters of the same static gain and damping ratio, and a natural frequency so many
    times as high.
    """
    power = {"Ca": 1, "Ka": 2, "B": 2}
    return {
        name: value * factor ** power.get(name.removesuffix("/Ma"), 0)
        for name, value in values.items()
    }


def _rate(log: xr.Dataset) -> np.ndarray:
    """Rate as recorded, or the slope of the position over five samples."""
    if "rate" in log:
        return log["rate"].values
    x, time = log["position"].values, log["time"].values
    return (x[4:] - x[:-4]) / (time[4:] - time[:-4])


def _reached(
    records: Sequence[xr.Dataset], structure: Structure, found: OutputError
) -> dict[str, float]:
    """Part of the samples that each limit of the structure holds in the simulated response."""
    held: dict[str, list[np.ndarray]] = {}
    for k, log in enumerate(records, 1):
        values = found.of_manoeuvre(k)
        moved = simulate_actuator(log, structure, values)
        if structure.rate_limit:
            held.setdefault("rate_limit", []).append(
                np.abs(moved["rate"].values) > (1.0 - 1e-6) * values["rate_limit"]
            )
        width = 1e-6 * float(np.ptp(moved["position"].values))
        for name, sign in (("stop_low", 1.0), ("stop_high", -1.0)):
            if getattr(structure, name):
                held.setdefault(name, []).append(
                    sign * (moved["position"].values - values[name]) < width
                )
    return {name: float(np.concatenate(parts).mean()) for name, parts in held.items()}


def _alone(log: xr.Dataset, structure: Structure, found: OutputError) -> LogEstimates | None:
    """Estimates of one log by itself, from those of all; None where it cannot determine them."""
    try:
        own = fit_actuator_response([log], structure, found.parameters)
    except IdentificationError:
        return None
    e = own.estimates.sel(parameter=[name for name in structure.parameters])
    names = [str(name) for name in e["parameter"].values]
    values, stderr = (dict(zip(names, e[key].values.tolist())) for key in ("estimate", "stderr"))
    return LogEstimates(str(log.attrs.get("record", "")), values, stderr)
