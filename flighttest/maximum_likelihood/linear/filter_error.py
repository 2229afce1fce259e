"""Filter error: maximum likelihood of linear models with process noise, such as turbulence.

After a gust, an open-loop simulation deviates from the measured path permanently. The filter
predicts one sample ahead from all previous samples. Its innovations are white if the model is
correct, and the likelihood is that of the innovations [Maine1981]_, [Jategaonkar]_:

    J = 1/2 sum_k e_k' S^-1 e_k + N/2 ln |S| + 1/2 (theta - theta_0)' P^-1 (theta - theta_0)

The intensities of the disturbance and the noise of the instruments are unknowns too. They are
estimated as variances. S and the gain follow from them. The search uses Fisher's scoring:
M_ij = sum e_i' S^-1 e_j + N/2 tr(S^-1 S_i S^-1 S_j), with e_i and S_i by central differences.

References
----------
.. [Maine1981] Maine, Iliff, Formulation and implementation of a practical algorithm for parameter
   estimation with process and measurement noise, SIAM J. Appl. Math. 41, 1981.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from flighttest.maximum_likelihood.constrained_unknowns import constrain_unknowns
from flighttest.maximum_likelihood.linear.disturbance_choice import (
    compare_disturbances,
    prefer_calm,
)
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust, add_gusts, gust_starts
from flighttest.maximum_likelihood.linear.innovation_likelihood import (
    ConstrainedFilter,
    InnovationLikelihood,
    InnovationSlopes,
    filtered_datasets,
    intensity_starts,
    noise_starts,
    search_from_starts,
    whiten_innovations,
)
from flighttest.maximum_likelihood.linear.output_error import linear_output_error
from flighttest.maximum_likelihood.linear.positive_unknowns import (
    DEVIATIONS,
    LENGTHS,
    refuse_positive_constraints,
    transform_positive,
)
from flighttest.maximum_likelihood.linear.state_space import (
    LinearModel,
    Predictor,
    demand_known,
    filter_innovations,
    innovation_slopes,
    input_output_arrays,
    make_predictor,
    pick_rows,
    stack_models,
    steady_filters,
)
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.time_domain import uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, Wanted, lay_out
from flighttest.regression.equation_error.samples import list_manoeuvres


def filter_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    gusts: Sequence[DrydenGust] = (),
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a linear model from records in turbulence.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``process.alpha``, intensity of the disturbance of a state [its
        unit per square root of second]; ``noise.alpha``, standard deviation of the noise of an
        output, with a start from the record by default; ``init.alpha``, a state at the first
        sample, default zero; ``drift.alpha``, a constant in its rate; ``sensor.alpha``, a constant
        added to an output; ``gust.w`` and ``scale.w``, intensity and scale of a gust, which are as
        given otherwise; ``turn.w``, factor on the rotation of a gust with a span, 1 otherwise. [SI]
    gusts : sequence of DrydenGust
        Gusts that drive the model besides ``process.*``. The gust at the first sample of each
        manoeuvre, ``init.gust_w``, is an unknown, in intensities. [SI]
    iterations : int
        Largest number of iterations.
    constraints : sequence of str
        Linear constraints among the parameters of the model, as of `linear_output_error`; not of
        noises, intensities and scales. [SI]

    Returns
    -------
    OutputError
        ``residuals`` are the innovations. It is that of `linear_output_error`, with a remark, if
        the records do not need the disturbance: see `prefer_calm`. Without ``process.*`` and gusts
        the result is that of `linear_output_error` with the noise among the unknowns.

    Warns
    -----
    AeromatchWarning
        There are neither ``process.*`` nor gusts, and the residuals are a disturbance of the
        motion.

    Raises
    ------
    UnknownName
        A parameter that the model does not have, or a signal that the record does not hold.
    SchemaError
        ``process.*``, ``noise.*``, ``gust.*`` or ``scale.*`` that does not start above zero, an
        output that may be air-relative or inertial, samples that are not finite, time that is not
        uniform.
    IdentificationError
        The start does not have a filter, or the records cannot determine the unknowns.
    """
    records = list_manoeuvres(manoeuvres)
    states, outputs = model.states, model.outputs
    extra = {"process": states, "init": states, "drift": states, "noise": outputs}
    names = tuple(gust.name for gust in gusts)
    turning = tuple(gust.name for gust in gusts if gust.span)
    extra |= {"gust": names, "scale": names, "turn": turning}
    extra["init"] = (*states, *(f"gust_{gust.name}" for gust in gusts))
    demand_known(model, list(parameters), {**extra, "sensor": outputs})

    def filter_records(wanted: Wanted, kept: Sequence[DrydenGust]) -> OutputError:
        return _filter_records(
            model, records, wanted, kept, iterations=iterations, constraints=constraints
        )

    fit = filter_records(parameters, gusts)
    fit = prefer_calm(
        fit,
        parameters,
        gusts,
        lambda calm: linear_output_error(
            model, records, calm, iterations=iterations, constraints=constraints
        ),
        readings=len(outputs) * sum(record.sizes["time"] for record in records),
    )
    return compare_disturbances(fit, parameters, gusts, filter_records)


def _filter_records(
    model: LinearModel,
    records: Sequence[xr.Dataset],
    parameters: Wanted,
    gusts: Sequence[DrydenGust],
    iterations: int,
    constraints: Sequence[str],
) -> OutputError:
    """Return the fit with the given disturbances, whether the records need them or not."""
    outputs, moved = model.outputs, add_gusts(model, gusts)
    starts = noise_starts([input_output_arrays(model, record)[1] for record in records])
    unknowns: Wanted = {f"noise.{name}": Unknown(start) for name, start in zip(outputs, starts)}
    # Every output has a noise; given parameters replace the starts from the record.
    natural = lay_out({**unknowns, **gust_starts(gusts), **parameters}, [{} for _ in records])
    refuse_positive_constraints(natural.names, constraints)
    constrained = constrain_unknowns(natural, constraints)
    transformed = transform_positive(constrained.layout)
    layout = transformed.layout
    everything = replace(constrained, full=transform_positive(constrained.full).layout)
    pieces = []
    for record, names, columns in zip(records, natural.bases, natural.columns):
        starts = natural.start[columns]
        pieces.append(_FilteredRecord(moved, record, gusts=gusts, names=names, starts=starts))
    maximum, worse = search_from_starts(
        InnovationLikelihood(constrained.wrap(pieces, ConstrainedFilter), layout),
        intensity_starts(layout),
        iterations=iterations,
    )
    estimates, scatter = filtered_datasets(
        maximum,
        transformed,
        pieces,
        outputs=outputs,
        about={"method": "filter error", "worse_starts": worse},
    )
    steps = [piece.step for piece in pieces]
    estimates = everything.rate(
        constrained.expand(estimates),
        InnovationLikelihood(pieces, everything.full),
        maximum.theta,
        lambda end, full: coloured_likelihood_covariance(
            whiten_innovations(end), full.columns, steps
        )[0],
    )
    warnings: tuple[str, ...] = ()
    if not gusts and not any(name.startswith("process.") for name in parameters):
        warnings = warn_of_turbulence(scatter)
    innovations = maximum.residuals.parts
    residuals = tuple(piece.residual(e) for piece, e in zip(pieces, innovations))
    return OutputError(estimates, residuals, noise=scatter, warnings=warnings)


class _FilteredRecord:
    """One record and the filter of its readings."""

    def __init__(
        self,
        model: LinearModel,
        record: xr.Dataset,
        gusts: Sequence[DrydenGust],
        names: Sequence[str],
        starts: np.ndarray,
    ):
        self.model, self.names, self.starts = model, tuple(names), starts
        self.gusts = gusts
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.z = input_output_arrays(model, record)

    def _make_runs(self, rows: np.ndarray) -> tuple[Predictor, np.ndarray]:
        """Return the filters of rows of unknowns, and the variances of their innovations.

        Raise LinAlgError or ValueError if one of them has no steady filter.
        """
        states, outputs = self.model.states, self.model.outputs
        named = [self._name_values(values) for values in rows]
        # A trial far off overflows, and then has no filter.
        with np.errstate(all="ignore"):
            steady = steady_filters(
                stack_models(self.model, named),
                drift=pick_rows(named, "drift", states),
                intensity=pick_rows(named, "process", states),
                noise=pick_rows(named, "noise", outputs),
                step=self.step,
            )
        offset = pick_rows(named, "sensor", outputs)
        return make_predictor(steady, pick_rows(named, "init", states), offset), steady.S

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output) and their variance; NaN without a filter."""
        try:
            runs, S = self._make_runs(values[None])
        except (np.linalg.LinAlgError, ValueError):
            return np.full(self.z.shape, np.nan), np.full((1, *2 * self.z.shape[1:]), np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            return filter_innovations(Predictor(*(part[0] for part in runs)), self.u, self.z), S

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> InnovationSlopes:
        """Return their slopes; NaN if a step does not have a filter.

        A variance does not become negative: near zero, the differences are those about one step
        above it.
        """
        is_variance = np.array([name.split(".")[0] in DEVIATIONS for name in self.names])
        values = np.where(is_variance, np.maximum(values, steps), values)
        count, shifts, width = len(values), np.diag(steps), 2.0 * steps
        try:
            runs, S = self._make_runs(values + np.vstack([shifts, -shifts, np.zeros(count)]))
        except (np.linalg.LinAlgError, ValueError):
            return InnovationSlopes(
                np.full((*self.z.shape, count), np.nan),
                np.full((count, 1, *2 * self.z.shape[1:]), np.nan),
            )
        up = Predictor(*(part[:count] for part in runs))
        down = Predictor(*(part[count:-1] for part in runs))
        run = Predictor(*(part[-1] for part in runs))
        dS = (S[:count] - S[count:-1]) / width[:, None, None]
        with np.errstate(over="ignore", invalid="ignore"):
            e = innovation_slopes(run, up, down=down, width=width, u=self.u, z=self.z)
        return InnovationSlopes(np.moveaxis(e, 0, 2), dS[:, None])

    def _name_values(self, values: np.ndarray) -> dict[str, float]:
        """Return the unknowns by name, in their natural form."""
        named = {}
        for name, value, start in zip(self.names, values, self.starts):
            named[name] = float(value)
            if name.split(".")[0] in DEVIATIONS:
                named[name] = start * np.sqrt(abs(float(value)))
            if name.split(".")[0] in LENGTHS:
                named[name] = start * np.exp(float(value))
        for gust in self.gusts:
            named |= gust.filter_values(named)
        return named

    def residual(self, e: np.ndarray) -> xr.Dataset:
        """Return innovations as a Dataset."""
        columns = {name: ("time", e[:, k]) for k, name in enumerate(self.model.outputs)}
        return xr.Dataset(columns, {"time": self.time})
