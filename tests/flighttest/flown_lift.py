"""Simulated records of a lift that follows four terms, with a disturbance of known colour; truth
known.
"""

import numpy as np
import xarray as xr
from scipy.signal import lfilter

from flighttest.regression.equation_error.model import RegressionModel

LIFT = RegressionModel.parse("CL = 1 + alpha + qhat + delta_e")
TRUTH = dict(zip(LIFT.terms, (0.3, 5.0, 8.0, 0.5)))
STEP = 0.02


def coloured_noise(rng, n, tau=0.3):
    c = np.exp(-STEP / tau)
    return lfilter([np.sqrt(1 - c * c)], [1, -c], rng.normal(size=n + 500))[500:]


def record(rng, duration=30.0, noise=0.01, offset=0.0, tau=0.3):
    """Three independent multisines up to 0.8 Hz, and a lift with coloured disturbance."""
    t = np.arange(0, duration, STEP)
    k = np.arange(2, 24)

    def multisine():
        return np.cos(2 * np.pi * np.outer(t, k) / 30 + rng.uniform(0, 2 * np.pi, len(k))).sum(
            axis=1
        ) / np.sqrt(len(k))

    elevator = 0.03 * multisine()
    alpha = 0.02 * multisine() + 0.3 * lfilter([0.05], [1, -0.95], elevator)
    qhat = 0.001 * multisine()
    X = np.stack([np.ones_like(t), alpha, qhat, elevator], axis=1)
    CL = X @ np.array(list(TRUTH.values())) + offset + noise * coloured_noise(rng, len(t), tau)
    columns = {"CL": CL, "alpha": alpha, "qhat": qhat, "delta_e": elevator}
    return xr.Dataset({k: ("time", v) for k, v in columns.items()}, coords={"time": t})
