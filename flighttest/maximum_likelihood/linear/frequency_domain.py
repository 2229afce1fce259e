"""Output error in frequency for linear models.

The transforms of the measured outputs over the record are compared with

    y~(f) = C (jw - A)^-1 (B u~(f) exp(-jw tau) + x(0) - x(T)) + D u~(f) exp(-jw tau)

at the multiples of 1/T. Values of the spectrum are independent there, and constants have no
spectrum: trim, zero of an instrument, constant acceleration. The change of the state between start
and end, x(0) - x(T), is free for every record. The record need not be periodic, and it need not end
in its first state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.constrained_unknowns import constrain_unknowns
from flighttest.maximum_likelihood.likelihood import Likelihood, LikelihoodMaximum
from flighttest.maximum_likelihood.linear.state_space import (
    LinearModel,
    demand_known,
    input_output_arrays,
    pick_values,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import invert_information, maximise_likelihood
from flighttest.maximum_likelihood.time_domain import noise_groups, uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, Wanted, lay_out
from flighttest.records.signals.fourier import finite_fourier, harmonics
from flighttest.regression.equation_error.frequency.transformed_stretches import stack_complex
from flighttest.regression.equation_error.samples import list_manoeuvres

BAND = (0.1, 2.0)  # [Hz]
_AROUND = 5  # frequencies on each side over which the spectrum of the noise is averaged
_JUMP = "jump"  # kind of the unknowns x(0) - x(T)


def frequency_output_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    band: tuple[float, float] = BAND,
    noise: str = "common",
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a linear model by maximum likelihood in the frequency domain.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model, and ``delay.delta_e``, the delay of an input [s].
    band : (float, float)
        Lowest and highest frequency: 0.1 to 2 Hz for a small aeroplane, 0.05 to 1.5 Hz for a jet.
        [Hz]
    noise : {"common", "own"}
        One noise spectrum per output, or one per output and manoeuvre.
    iterations : int
        Largest number of iterations.
    constraints : sequence of str
        Linear constraints among the parameters, as ``M_q = 0.5*M_alpha`` or ``M_q < 0``; see
        `parse_constraints`. [SI]

    Returns
    -------
    OutputError
        ``noise.stderr`` is that of the real and of the imaginary part of a transform [unit of the
        output times second].

    Raises
    ------
    UnknownName
        A parameter that the model does not have, or a signal that the record does not hold.
    IdentificationError
        A band without frequencies, fewer values than unknowns, or unknowns that the records cannot
        determine.
    SchemaError
        Samples that are not finite, or time that is not uniform.

    Notes
    -----
    The likelihood assumes white noise inside the band. ``stderr`` is corrected with the spectrum of
    the residuals.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification: Theory and Practice, AIAA 2006,
       ch. 7.
    """
    demand_known(model, list(parameters), {"delay": model.inputs})
    records = list_manoeuvres(manoeuvres)
    jumps = {f"{_JUMP}.{name}": Unknown(0.0, own=True) for name in model.states}
    layout = lay_out({**parameters, **jumps}, [{} for _ in records])
    pieces = []
    for record, names in zip(records, layout.bases):
        pieces.append(_RecordSpectra(model, record, band=band, names=names))
    values = sum(piece.measured.size for piece in pieces)
    if values <= len(layout.names):
        raise IdentificationError(
            f"{len(layout.names)} unknowns and fewer values of the spectra; widen the band "
            f"or take longer records"
        )
    groups = noise_groups(noise, len(records))
    constrained = constrain_unknowns(layout, constraints)
    free = constrained.layout
    maximum = maximise_likelihood(Likelihood(constrained.wrap(pieces), free, groups), iterations)
    covariance = _coloured_covariance(maximum, free)
    estimates = estimates_dataset(
        maximum, free, covariance=covariance, about={"method": "output error in frequency"}
    )
    estimates = constrained.rate(
        constrained.expand(estimates),
        Likelihood(pieces, constrained.full, groups),
        maximum.theta,
        _coloured_covariance,
    )
    # The changes of the states are not results.
    estimated = [name for name in layout.names if not name.startswith(f"{_JUMP}.")]
    return OutputError(
        estimates=estimates.sel(parameter=estimated, parameter_=estimated),
        residuals=tuple(piece.residual(v) for piece, v in zip(pieces, maximum.residuals)),
        noise=noise_dataset(maximum, list(model.outputs)),
    )


class _RecordSpectra:
    """One record; real parts of the transforms above the imaginary parts."""

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
        self.measured = stack_complex(finite_fourier(z - z[0], step, self.frequencies))

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the transforms of the outputs, (2 frequencies, outputs)."""
        named = dict(zip(self.names, values))
        A, B, C, D = self.model.at(named)
        s = 2j * np.pi * self.frequencies
        delay = pick_values(named, "delay", self.model.inputs)
        u = self.inputs * np.exp(-np.outer(s, delay))
        # (jw - A) x~ = B u~ + x(0) - x(T), one system per frequency
        forcing = u @ B.T + pick_values(named, _JUMP, self.model.states)
        x = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, forcing[:, :, None])[:, :, 0]
        return stack_complex(x @ C.T + u @ D.T)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return central differences, which are fast here."""
        slopes = []
        for k, step in enumerate(steps):
            shift = np.zeros(len(steps))
            shift[k] = step
            up, down = self.predict(values + shift), self.predict(values - shift)
            slopes.append((up - down) / (2 * step))
        return np.stack(slopes, axis=2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals as complex numbers."""
        z = _join_parts(v)
        columns = {name: ("frequency", z[:, k]) for k, name in enumerate(self.model.outputs)}
        return xr.Dataset(columns, {"frequency": ("frequency", self.frequencies, {"units": "Hz"})})


def _join_parts(v: np.ndarray) -> np.ndarray:
    """Return the complex rows of `stack_complex`."""
    return v[: len(v) // 2] + 1j * v[len(v) // 2 :]


def _coloured_covariance(maximum: LikelihoodMaximum, layout: UnknownVector) -> np.ndarray:
    """Return D [P^-1 + 1/2 Re sum_k H_k* R^-1 Phi_k R^-1 H_k] D.

    The noise spectrum Phi_k is the mean over neighbouring frequencies.
    """
    free = ~maximum.active
    # The prior P^-1 is the information without that of the readings.
    prior, inner = maximum.information.copy(), np.zeros_like(maximum.information)
    for S, v, noise, columns in zip(
        maximum.slopes, maximum.residuals, maximum.noise, layout.columns
    ):
        block = np.ix_(columns, columns)
        # Slopes and residuals over the root of the noise variance: R^-1 is then the identity.
        root = np.sqrt(noise)
        X = (S / root[None, :, None]).reshape(-1, S.shape[2])
        prior[block] -= X.T @ X
        H, e = _join_parts(S) / root[None, :, None], _join_parts(v) / root
        periodogram = e[:, :, None] * e[:, None, :].conj()
        for k, h in enumerate(H):
            # Phi_k, with fewer frequencies near the ends of the band.
            spectrum = periodogram[max(0, k - _AROUND) : k + _AROUND + 1].mean(axis=0)
            inner[block] += 0.5 * np.real(h.conj().T @ spectrum @ h)
    # Degrees of freedom of the spectrum: values less estimates.
    values = sum(v.size for v in maximum.residuals)
    freedom = max(1, values - int(free.sum()))
    D = invert_information(maximum.information, free)
    return D @ (inner * values / freedom + prior) @ D
