"""Sections of a project on models: new terms, fits and models from elsewhere."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from aeromatch.project.sections import RecordSelection
from flightmech import terms
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_models import Strict
from flightmech.units import DEGREE


class NewTerm(Strict):
    """A term that the listings cannot give, for the flights to identify.

    It is zero at first and has a wide standard error.
    """

    axes: dict[str, tuple[float | str, ...]] = Field(
        default={},
        description="Breakpoints by axis, SI or with units; without them one number.",
        examples=[{"delta_f": ["0 deg", "40 deg"]}],
    )
    regressors: tuple[str, ...] = Field(
        default=(), description="What the table is multiplied by.", examples=[["gear"]]
    )
    stderr: float | tuple[float, ...] = Field(
        description="Standard error of the zero it starts from: one for all nodes, or one each.",
        examples=[0.05],
    )
    comment: str = Field(
        default="", description="Why the term is there.", examples=["drag of the gear"]
    )

    def leaf(self) -> xr.Dataset:
        """Return the term, zero at every node.

        Raises
        ------
        SchemaError
            The number of standard errors is not 1 and not the number of nodes, or an angle without
            a unit is beyond 90 deg.
        """
        axes: dict[str, list[float]] = {}
        for name, points in self.axes.items():
            units = lookup(name).units
            axes[name] = [parse_quantity(point, units) for point in points]
            # A text has its unit; 0 and 6 are degrees that were taken for radians.
            bare = [abs(point) for point in points if not isinstance(point, str)]
            if units == "rad" and max(bare, default=0.0) > np.pi / 2.0:
                problem = (
                    f"axis {name} reaches {max(bare):g} rad, {max(bare) / DEGREE:.4g} deg; a "
                    f"number without a unit is in rad: write '{max(bare):g} deg'"
                )
                raise SchemaError("term", [problem])
        if not np.any(self.stderr):
            problem = (
                "stderr is 0: a term that is zero before flight would stay zero; give its a-priori "
                "error, about the size of the derivative, or delete the term"
            )
            raise SchemaError("term", [problem])
        value = np.zeros(tuple(len(points) for points in axes.values()))
        if np.ndim(self.stderr) and np.shape(self.stderr) != value.shape:
            problem = (
                f"stderr has {np.size(self.stderr)} values for {value.size} nodes; give "
                f"one for all, or one per node"
            )
            raise SchemaError("term", [problem])
        return terms.make_term(
            value,
            axes,
            self.regressors,
            stderr=self.stderr,
            source="judgement",
            comment=self.comment,
        )


class FitSection(RecordSelection):
    """Manoeuvres or windows of records, which each of some models fits together."""

    name: str = Field(description="Name of the fit, for the report.")
    models: tuple[str, ...] = Field(
        description="Models to fit, one for each coefficient: terms of the right-hand side are "
        "regressors."
    )

    @model_validator(mode="after")
    def _require_samples(self) -> FitSection:
        if not self.manoeuvres and not self.window:
            raise ValueError(
                "neither manoeuvres nor window; give one of them, as window = [start, end] "
                "in seconds of the record"
            )
        return self


class ThirdPartyModel(Strict):
    """A model from elsewhere that is replayed too, and its table of names (`pom.replay`)."""

    fmu: str = Field(
        description="The FMU, relative to this file.", examples=["other/simulator.fmu"]
    )
    names: str = Field(
        default="",
        description="Its table of names, when names, units or signs are not the canonical ones.",
        examples=["other/names.toml"],
    )
