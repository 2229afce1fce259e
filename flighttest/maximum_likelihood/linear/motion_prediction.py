"""Prediction of a record by the derivatives of a linear motion from other records."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.maximum_likelihood.linear.motion_fit import STEADY, demand_signals
from flighttest.maximum_likelihood.linear.motions import (
    derivative_names,
    linear_motion,
    motion_of,
    start_values,
    steady_condition,
    trim_of,
)
from flighttest.maximum_likelihood.linear.output_error import linear_output_error
from flighttest.maximum_likelihood.linear.state_space import LinearModel
from flighttest.maximum_likelihood.result import OutputError

_MOVES = 1e-6  # change of a control that counts as a movement [rad]
_OF_RECORD = ("init.", "drift.", "sensor.")  # unknowns that every record has for itself


class MotionPrediction(NamedTuple):
    """Response of a linear motion to the controls of a record.

    Attributes
    ----------
    measured, predicted : Dataset (time,)
        Outputs of the motion. [SI]
    remarks : tuple of str
    """

    measured: xr.Dataset
    predicted: xr.Dataset
    remarks: tuple[str, ...]


def predict_motion(fit: OutputError, record: xr.Dataset) -> MotionPrediction:
    """Return the response of the fitted motion to the controls of another record.

    The derivatives are held.  First state, constants of the rates and constant of the accelerometer
    belong to the record and are estimated from it, as [Jategaonkar]_ does for a validation.

    Parameters
    ----------
    fit : OutputError
        Fit of `fit_motion`, or its file read again.
    record : Dataset (time,)
        Signals as of `fit_motion`. [SI]

    Raises
    ------
    SchemaError
        A fit without the name of its motion.
    UnknownName, SchemaError, IdentificationError
        As `fit_motion`.

    References
    ----------
    .. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 11.
    """
    about = fit.estimates.attrs
    if "motion" not in about:
        raise SchemaError(
            "output error",
            ["the file does not name its motion; make it again with aeromatch flight fit-linear"],
        )
    kind = motion_of(str(about["motion"]))
    values = fit.parameters
    names = derivative_names(kind, kind.controls)
    derivatives = {name: values[name] for name in names if name in values}
    controls = []
    for control in kind.controls:
        if any(names[name][1] == control for name in derivatives):
            controls.append(control)
    demand_signals([record], ("V", "alpha", "theta", *kind.states, kind.force, *kind.controls))
    steady = steady_condition([record])
    remarks = []
    change = abs(steady.V / float(about["V"]) - 1.0)
    if change > STEADY:
        remarks.append(
            f"V is {steady.V:.1f} m/s, that of the fit {float(about['V']):.1f} m/s: dimensional "
            f"derivatives change with it"
        )
    for control in kind.controls:
        if control not in controls and np.ptp(record[control].values) > _MOVES:
            remarks.append(f"{control} moves, and the fit has no derivative of it")
    if any(name.startswith(("process.", "gust.")) for name in values):
        remarks.append("simulated without the disturbance of the fit")
    motion = linear_motion(kind, steady, controls, trim_of(kind, controls, [record]))
    wanted = {}
    for name, unknown in start_values(motion, kind, [record]).items():
        if name.startswith(_OF_RECORD):
            wanted[name] = unknown
    with warnings.catch_warnings():
        # A disturbance of a record that is not fitted is part of its residual.
        warnings.simplefilter("ignore")
        response = linear_output_error(_hold(motion, derivatives), record, wanted)
    if not response.estimates.attrs["converged"]:
        remarks.append("first state and constants of the record did not converge")
    residual = response.residuals[0]
    measured = record[list(motion.outputs)]
    predicted = {}
    for name in motion.outputs:
        predicted[name] = ("time", measured[name].values - residual[name].values)
    return MotionPrediction(
        measured, xr.Dataset(predicted, {"time": record["time"].values}), tuple(remarks)
    )


def _hold(model: LinearModel, derivatives: Mapping[str, float]) -> LinearModel:
    """Return a model whose derivatives are not parameters any more."""

    def matrices(values: Mapping[str, float]) -> list[np.ndarray]:
        return list(model.matrices({**derivatives, **values}))

    return LinearModel(
        model.states,
        model.inputs,
        model.outputs,
        matrices=matrices,
        parameters=(),
        reference=dict(model.reference),
    )
