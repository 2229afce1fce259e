"""The constants of a reconstruction: instrument errors, wind, reference pressure, with their prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

PER_RUN = ("wind_n", "wind_e", "wind_d", "p_reference")  # all others belong to the instruments and stay from run to run

CONTRADICTED = 4.0  # standard errors of its prior beyond which an estimate contradicts it


@dataclass(frozen=True)
class Constants:
    """Names, units and normal prior of the constants.

    Attributes
    ----------
    names, units : tuple of str
    mean : array (nc,)
    covariance : array (nc, nc)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def index(self, *names: str) -> np.ndarray:
        """Return the places of `names`."""
        return np.array([self.names.index(name) for name in names], int)

    def get(self, c: np.ndarray, name: str, default: float = 0.0) -> float:
        """Return the value of one constant in the vector `c`, or `default` when it is not estimated."""
        return float(c[self.names.index(name)]) if name in self.names else default

    def precision(self) -> np.ndarray:
        """Return the inverse of the prior covariance."""
        return inverse(self.covariance)

    def with_prior(self, prior: xr.Dataset) -> Constants:
        """Return these constants with the mean and covariance that another `biases` Dataset gives to the shared ones."""
        shared = [name for name in map(str, prior["parameter"].values) if name in self.names and name not in PER_RUN]
        mean, covariance = self.mean.copy(), self.covariance.copy()
        at = self.index(*shared)
        chosen = prior.sel(parameter=shared, parameter_=shared)
        se = chosen["stderr"].values
        covariance[at, :] = 0.0
        covariance[:, at] = 0.0
        covariance[np.ix_(at, at)] = chosen["correlation"].values * np.outer(se, se)
        mean[at] = chosen["estimate"].values
        return Constants(self.names, self.units, mean, covariance)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance, scaled first because the units of the constants differ by powers of ten."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)


def biases(constants: Constants, c: np.ndarray, covariance: np.ndarray, held: tuple[str, ...] = ()) -> xr.Dataset:
    """Return the estimates as a Dataset over ``parameter``.

    Returns
    -------
    Dataset
        ``estimate stderr prior prior_stderr unit held`` (parameter), ``correlation prior_correlation`` (parameter, parameter_).
    """
    se, prior_se = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(constants.covariance))
    square = ("parameter", "parameter_")
    names = list(constants.names)
    return xr.Dataset(
        {
            "estimate": ("parameter", c),
            "stderr": ("parameter", se),
            "prior": ("parameter", constants.mean),
            "prior_stderr": ("parameter", prior_se),
            "unit": ("parameter", list(constants.units)),
            "held": ("parameter", [name in held for name in names]),
            "correlation": (square, covariance / np.outer(se, se)),
            "prior_correlation": (square, constants.covariance / np.outer(prior_se, prior_se)),
        },
        coords={"parameter": names, "parameter_": names},
    )


def identifiability(found: xr.Dataset) -> list[str]:
    """Return in words what the data could not determine: constants that rest on their prior or contradict it, and pairs that do the same.

    Notes
    -----
    A posterior standard error above half the prior one means that the data contain little information; a correlation beyond 0.9 means
    that only a combination of the two is known.  An estimate beyond four standard errors of the prior, which chance brings once in 16 000,
    means that the prior is too narrow or a reading wrong: the estimate then lies between the two and its standard error is too small.
    """
    words = []
    ratio = (found["stderr"] / found["prior_stderr"]).values
    names = [str(name) for name in found["parameter"].values]
    for name, r in zip(names, ratio, strict=True):
        if r > 0.5:
            words.append(f"{name} rests on its prior: standard error {r:.0%} of the prior one")
    off = ((found["estimate"] - found["prior"]) / found["prior_stderr"]).values
    for name, z in zip(names, off, strict=True):
        if abs(z) > CONTRADICTED:
            words.append(
                f"{name} contradicts its prior: {abs(z):.1f} standard errors of the prior from it; give it a wider one"
                f"{' (wind_down_sigma of the record)' if name == 'wind_d' else ''} or look for a wrong reading"
            )
    correlation = found["correlation"].values
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > 0.9:
                kind = "sum" if correlation[i, j] < 0 else "difference"
                words.append(
                    f"{names[j]} and {names[i]} cannot be distinguished (correlation {correlation[i, j]:+.3f}): "
                    f"their weighted {kind} is known"
                )
    return words
