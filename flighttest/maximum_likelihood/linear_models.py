"""Output error in frequency for linear models.

The transforms of the measured outputs over the record are compared with

    y~(f) = C (jw - A)^-1 (B u~(f) exp(-jw tau) + x(0) - x(T)) + D u~(f) exp(-jw tau)

at the multiples of 1/T, where values of the spectrum are independent and constants (trim, zero of
an instrument, constant acceleration) have none.  What the state has changed between start and end,
x(0) - x(T), is free for every record, so that the record need neither be periodic nor end where it
began.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import (
    Likelihood,
    LikelihoodMaximum,
    invert_information,
    maximise_likelihood,
)
from flighttest.maximum_likelihood.state_space import (
    LinearModel,
    Predictor,
    demand_known,
    filter_innovations,
    innovation_slopes,
    input_output_arrays,
    make_predictor,
    pick_values,
    steady_filter,
)
from flighttest.maximum_likelihood.time_domain import noise_groups, uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, Wanted, lay_out
from flighttest.records.signals.fourier import finite_fourier, harmonics

BAND = (0.1, 2.0)
_AROUND = 5  # frequencies on each side over which the spectrum of the noise is averaged
_JUMP = "jump."


def frequency_output_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    band: tuple[float, float] = BAND,
    noise: str = "common",
    iterations: int = 50,
) -> OutputError:
    """Estimate parameters of a linear model by maximum likelihood in the frequency domain.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model, and ``delay.delta_e``, by which an input acts later [s].
    band : (float, float)
        Lowest and highest frequency: 0.1 to 2 Hz for a small aeroplane, 0.05 to 1.5 Hz for a jet.
        [Hz]
    noise : {"common", "own"}
        One noise spectrum per output, or one per output and manoeuvre.
    iterations : int
        At most so many.

    Returns
    -------
    OutputError
        ``noise.stderr`` is that of the real and of the imaginary part of a transform [unit of the
        output times second].

    Raises
    ------
    UnknownName
        A parameter the model does not have, a signal the record does not hold.
    IdentificationError
        A band without frequencies, fewer values than unknowns, or unknowns that the records cannot
        determine.
    SchemaError
        Samples that are not finite, time that is not uniform.

    Notes
    -----
    The noise is taken for white inside the band; ``stderr`` is corrected with its spectrum as the residuals show it.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification: Theory and Practice, AIAA 2006, ch. 7.
    """
    demand_known(model, list(parameters), [f"delay.{name}" for name in model.inputs])
    records = [manoeuvres] if isinstance(manoeuvres, xr.Dataset) else list(manoeuvres)
    jumps = {f"{_JUMP}{name}": Unknown(0.0, own=True) for name in model.states}
    layout = lay_out({**parameters, **jumps}, [{} for _ in records])
    pieces = [_Spectra(model, record, band, names) for record, names in zip(records, layout.bases)]
    if sum(piece.measured.size for piece in pieces) <= len(layout.names):
        raise IdentificationError(
            f"{len(layout.names)} unknowns and fewer values of the spectra; widen the band "
            f"or take longer records"
        )
    found = maximise_likelihood(
        Likelihood(pieces, layout, noise_groups(noise, len(records))), iterations
    )
    estimates = estimates_dataset(
        found, layout, _covariance(found, layout), {"method": "output error in frequency"}
    )
    shown = [name for name in layout.names if not name.startswith(_JUMP)]
    estimates = estimates.sel(parameter=shown, parameter_=shown)
    rest = tuple(piece.residual(v) for piece, v in zip(pieces, found.residuals))
    return OutputError(estimates, rest, noise_dataset(found, list(model.outputs)))


class _Spectra:
    """One record; real parts of the transforms above the imaginary ones."""

    def __init__(
        self,
        model: LinearModel,
        record: xr.Dataset,
        band: tuple[float, float],
        names: Sequence[str],
    ):
        self.model, self.names = model, tuple(names)
        time = record["time"].values.astype(float)
        step = uniform_step(time, "record")
        self.frequencies = harmonics((len(time) - 1) * step, *band)
        u, z = input_output_arrays(model, record)
        self.inputs = finite_fourier(u - u[0], step, self.frequencies)
        self.measured = _stacked(finite_fourier(z - z[0], step, self.frequencies))

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the transforms of the outputs."""
        at = dict(zip(self.names, values))
        A, B, C, D = self.model.at(at)
        s = 2j * np.pi * self.frequencies
        late = np.array([at.get(f"delay.{name}", 0.0) for name in self.model.inputs])
        u = self.inputs * np.exp(-np.outer(s, late))
        forcing = u @ B.T + np.array([at[f"{_JUMP}{name}"] for name in self.model.states])
        x = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, forcing[:, :, None])[:, :, 0]
        return _stacked(x @ C.T + u @ D.T)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return central differences, which cost little here."""
        moved = np.diag(steps)
        return np.stack(
            [
                (self.predict(values + d) - self.predict(values - d)) / (2.0 * d.sum())
                for d in moved
            ],
            axis=2,
        )

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as complex numbers."""
        z = _unstacked(v)
        columns = {name: ("frequency", z[:, k]) for k, name in enumerate(self.model.outputs)}
        return xr.Dataset(columns, {"frequency": ("frequency", self.frequencies, {"units": "Hz"})})


def _stacked(z: np.ndarray) -> np.ndarray:
    return np.concatenate([z.real, z.imag])


def _unstacked(v: np.ndarray) -> np.ndarray:
    return v[: len(v) // 2] + 1j * v[len(v) // 2 :]


def _covariance(found: LikelihoodMaximum, layout: UnknownVector) -> np.ndarray:
    """Return D [P^-1 + 1/2 Re sum_k H_k* R^-1 Phi_k R^-1 H_k] D with the noise spectrum Phi
    averaged over neighbours.
    """
    free = ~found.active
    rest, inner = found.information.copy(), np.zeros_like(found.information)
    for S, v, noise, place in zip(found.slopes, found.residuals, found.noise, layout.columns):
        root = np.sqrt(noise)
        X = (S / root[None, :, None]).reshape(-1, S.shape[2])
        rest[np.ix_(place, place)] -= X.T @ X
        H, e = _unstacked(S) / root[None, :, None], _unstacked(v) / root
        cross = e[:, :, None] * e[:, None, :].conj()
        for k, h in enumerate(H):
            spectrum = cross[max(0, k - _AROUND) : k + _AROUND + 1].mean(axis=0)
            inner[np.ix_(place, place)] += 0.5 * np.real(h.conj().T @ spectrum @ h)
    values = sum(v.size for v in found.residuals)
    D = invert_information(found.information, free)
    return D @ (inner * values / max(1, values - int(free.sum())) + rest) @ D


_FEWEST = 9  # readings of an output
_BEYOND = 1e100  # an unstable model has no response from there on


def linear_output_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    noise: str = "common",
    iterations: int = 50,
) -> OutputError:
    """Estimate parameters of a linear model by maximum likelihood, from whole responses in time.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``; NaN in an output is no
        reading. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``init.alpha``, a state at the first sample, zero unless given;
        ``drift.alpha``, a constant in its rate; ``sensor.alpha``, a constant added to an output.
        [SI]
    noise : {"common", "own"}
        One noise variance per output, or one per output and manoeuvre.
    iterations : int
        At most so many.

    Returns
    -------
    OutputError
        ``residuals`` are NaN where there is no reading.

    Raises
    ------
    UnknownName
        A parameter the model does not have, a signal the record does not hold.
    SchemaError
        Inputs that are not finite, time that is not uniform, unknowns outside their bounds.
    IdentificationError
        Fewer than nine readings of an output, a start whose response grows beyond all numbers, no
        output responds to a parameter, or the records cannot distinguish a combination.

    Warns
    -----
    AeromatchWarning
        The residuals carry a disturbance far above the noise of the instruments, as turbulence
        leaves it: see `filter_error`.

    Notes
    -----
    Cost, search and standard errors are those of `output_error`.  The variance of the noise follows from the residuals and needs neither a
    start nor a search of its own, as it does in `filter_error`.

    References
    ----------
    .. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA RP-1138, 1985.
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 4.
    """
    records = [manoeuvres] if isinstance(manoeuvres, xr.Dataset) else list(manoeuvres)
    extra = {"init": model.states, "drift": model.states, "sensor": model.outputs}
    demand_known(
        model,
        list(parameters),
        [f"{kind}.{name}" for kind, names in extra.items() for name in names],
    )
    groups = noise_groups(noise, len(records))
    layout = lay_out(parameters, [{} for _ in records])
    pieces = [_RecordResponse(model, record, names) for record, names in zip(records, layout.bases)]
    found = maximise_likelihood(Likelihood(pieces, layout, groups), iterations)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [piece.step for piece in pieces]
    )
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "output error in time, linear model"}
    )
    measured = [piece.measured for piece in pieces]
    scatter = noise_dataset(
        found,
        list(model.outputs),
        colours,
        measured,
        effect_on_motion(found, layout.columns, covariance, measured),
    )
    rest = tuple(piece.residual(v) for piece, v in zip(pieces, found.residuals))
    return OutputError(estimates, rest, scatter, warn_of_turbulence(scatter))


class _RecordResponse:
    """One record and its response."""

    def __init__(self, model: LinearModel, record: xr.Dataset, names: Sequence[str]):
        self.model, self.names = model, tuple(names)
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.measured = input_output_arrays(model, record, gaps=True)
        idle = [
            name
            for name, z in zip(model.outputs, self.measured.T)
            if np.isfinite(z).sum() < _FEWEST
        ]
        if idle:
            raise IdentificationError(
                f"{', '.join(idle)} has fewer than {_FEWEST} readings; leave it out of the "
                f"outputs of the model"
            )

    def _run(self, values: np.ndarray) -> Predictor:
        at = dict(zip(self.names, values))
        states, outputs = self.model.states, self.model.outputs
        calm = np.zeros(len(states)), np.zeros(len(outputs))
        made = steady_filter(self.model.at(at), pick_values(at, "drift", states), *calm, self.step)
        return make_predictor(
            made, pick_values(at, "init", states), pick_values(at, "sensor", outputs)
        )

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs as the instruments show them."""
        with np.errstate(over="ignore", invalid="ignore"):
            y = -filter_innovations(
                self._run(values), self.u, np.zeros_like(self.measured)
            )  # innovations are 0 - y
        return np.where(np.abs(y) < _BEYOND, y, np.nan)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return slopes by central differences of the matrices, which cost little here."""
        up, down = (
            [self._run(values + side * step) for step in np.diag(steps)] for side in (1.0, -1.0)
        )
        with np.errstate(over="ignore", invalid="ignore"):
            S = innovation_slopes(
                self._run(values), up, down, 2.0 * steps, self.u, np.zeros_like(self.measured)
            )
        return np.moveaxis(-S, 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as a Dataset; NaN where there is no reading."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        return xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(self.model.outputs)},
            {"time": self.time},
        )
