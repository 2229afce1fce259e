"""Steady states of a compiled model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from .library import OUTPUT, PARAMETER
from .simulation import attributes, constant_inputs, prepared

if TYPE_CHECKING:
    from .compiler import SimModel


def trim(sim: SimModel, parameters: Mapping[str, float] | None = None) -> xr.Dataset:
    """Trim to a steady flight: wings level unless the parameters say otherwise.

    ``init.V gamma phi psi h p q r`` are held; angle of attack, sideslip, elevator, aileron, rudder and power are sought so that
    the accelerations take the values ``init.u_dot ... init.r_dot`` (zero).  Power is the throttle, or the thrust when a
    recorded thrust drives or an engine has no table.  Where controls cannot do it, the smallest accelerations are left.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    parameters : mapping of str to float, optional
        Parameters and inputs: ``{"init.V": 90.0, "init.h": 1500.0, "delta_f": 0.6}``. [SI]

    Returns
    -------
    Dataset
        All outputs in the trimmed state, without dimension: ``alpha``, ``theta``, ``applied.delta_e``; ``trim.delta_e`` is what the
        trim added to the input, ``trim.u_dot ... trim.r_dot`` what is left of the accelerations.

    Raises
    ------
    UnknownName
        A parameter or input that the model does not have.
    SimulationError
        A parameter has no meaning, e.g. no speed.
    """
    y = trimmed_outputs(sim, parameters or {})
    return xr.Dataset({row.name: ((), y[i], attributes(row)) for i, row in enumerate(sim.entries(OUTPUT))}, attrs={"title": sim.title})


def trimmed_outputs(sim: SimModel, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the outputs (outputs,) of `trim` as the kernel gives them, for many trims in a row."""
    values = {"mode.trim": _seek(sim, parameters), **parameters}
    return prepared(sim, values, constant_inputs(sim, values)).outputs()


def _seek(sim: SimModel, parameters: Mapping[str, float]) -> float:
    engines = any(name.startswith("engine1/") for name in sim.terms)
    mode = next(row.value for row in sim.entries(PARAMETER) if row.name == "mode.engine")
    return 2.0 if engines and parameters.get("mode.engine", mode) == 0.0 else 1.0
