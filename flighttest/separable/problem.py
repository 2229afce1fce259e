"""Models and their samples as one least-squares problem in the shape parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from flightmech.errors import IdentificationError

from ..equation_error.samples import Samples
from ..expressions.functions import Pieces
from ..expressions.separable_model import SeparableModel, ShapeParameter
from ..uncertainty import collinearity
from .projection import Block, Projection, project

SAMPLES_PER_PARAMETER = 5


class Problem:
    """Models and their samples: the least-squares problem for given shape parameters and weights."""

    def __init__(self, models: Sequence[SeparableModel], samples: Sequence[Samples]):
        self.models, self.samples = models, samples
        self.pieces = [Pieces(*one.pieces()) for one in samples]
        self.quantities = [{name: one.data[name].values for name in model.variables} for model, one in zip(models, samples)]
        self.z = [one.data[model.target].values for model, one in zip(models, samples)]
        self.shape: dict[str, ShapeParameter] = {name: item for model in models for name, item in model.parameters.items()}
        self.names = list(self.shape)
        several = len(models) > 1
        self.terms = [[f"{model.target}: {term}" if several else term for term in model.terms] for model in models]
        self.weights = np.ones(len(models))
        for model, z, pieces in zip(models, self.z, self.pieces):
            count = len(model.terms) + len(model.parameters)
            if len(z) < SAMPLES_PER_PARAMETER * count:
                raise IdentificationError(f"{len(z)} samples for {count} parameters of {model}; at least {SAMPLES_PER_PARAMETER} each")
            if not model.parameters:
                collinearity.demand_rank(model.design(samples[0].data, {}, pieces)[0], model.terms)

    def designs(self, s: np.ndarray) -> list[tuple[np.ndarray, list[tuple[int, int, np.ndarray]]]]:
        """Regressors (samples, terms) of each quantity, and (parameter, term, derivative) where they change."""
        values = dict(zip(self.names, s))
        found = []
        for model, quantities, z, pieces in zip(self.models, self.quantities, self.z, self.pieces):
            A, slopes = model.columns(quantities, len(z), {name: values[name] for name in model.parameters}, pieces)
            found.append((A, [(self.names.index(name), j, slope) for name, j, slope in slopes]))
        return found

    def project(self, s: np.ndarray, prior: np.ndarray) -> Projection | None:
        """The weighted projection; `prior` holds the weight of the a-priori value of each parameter."""
        blocks = [
            Block(z * w, A * w, [(m, j, slope * w) for m, j, slope in slopes])
            for z, w, (A, slopes) in zip(self.z, self.weights, self.designs(s))
        ]
        means = np.array([self.shape[name].start or 0.0 for name in self.names])
        fixed = (prior * (s - means), np.diag(prior)) if prior.any() else None
        return project(blocks, len(s), fixed)

    def residuals(self, s: np.ndarray, coefficients: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus fitted, per quantity."""
        return [z - A @ c for z, (A, _), c in zip(self.z, self.designs(s), coefficients)]

    def fitted(self, j: int, s: np.ndarray, coefficients: np.ndarray) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
        """Return what model `j` makes of values of its variables, for `Samples.errors`."""
        model, values = self.models[j], dict(zip(self.names, s))
        parameters = {name: values[name] for name in model.parameters}
        return lambda data: model.design(data, parameters, self.pieces[j])[0] @ coefficients
