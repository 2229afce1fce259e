"""Tables of an engine: structure file, form of estimation, and result with joint covariance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import scipy
import xarray as xr
from pydantic import BeforeValidator, Field, WithJsonSchema

from flightmech.errors import AeromatchError, IdentificationError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, file_schema, validate_content
from flightmech.support.toml_quantities import quantity_schema
from flightmech.terms import basis, make_term


def _breakpoints(item: Any) -> dict[str, tuple[float, ...]]:
    """Return breakpoints in SI units by their axis."""
    if not isinstance(item, dict):
        raise ValueError(
            'a table of axes and their breakpoints is needed, such as { h = ["0 ft", "20000 ft"] }'
        )
    try:
        breakpoints = {}
        for axis, points in item.items():
            units = lookup(str(axis)).units
            breakpoints[str(axis)] = tuple(parse_quantity(point, units) for point in points)
    except (AeromatchError, TypeError) as error:
        raise ValueError(str(error)) from error
    for axis, points in breakpoints.items():
        if len(points) < 2 or any(b <= a for a, b in pairwise(points)):
            raise ValueError(
                f"{axis} = {list(points)}: at least two breakpoints, rising, are needed"
            )
    return breakpoints


Breakpoints = Annotated[
    dict[str, tuple[float, ...]],
    BeforeValidator(_breakpoints),
    WithJsonSchema(
        {
            "type": "object",
            "additionalProperties": {
                "type": "array",
                "minItems": 2,
                "items": quantity_schema("of the axis"),
            },
        }
    ),
]


class EngineStructure(Strict):
    """Structure of an engine: what its tables depend on, for `identify_engine`.

    Attributes
    ----------
    height : str or None
        As for `engine_channels`.
    throttle, n2, limits, fan, over
        As for `identify_spools`.
    tables : dict of str to dict of str to tuple of float
        Tables of steady performance from whole flights, with their axes and breakpoints, as for
        `steady_table`. [SI]
    thrust_scale : float
        Standard error of the factor of the recorded thrust, common to all records.
    """

    height: str | None = Field(
        default=None,
        description="Channel of the height; without it the first of h, h_baro and h_gps.",
    )
    throttle: tuple[float, ...] | None = Field(
        default=None,
        description="Breakpoints of the schedule over the lever; without them where the lever "
        "rested.",
    )
    n2: tuple[float, ...] | None = Field(
        default=None,
        description="Breakpoints of time constants and limits over the speed of the gas generator.",
    )
    limits: bool = Field(
        default=False, description="Whether acceleration and deceleration have rate limits."
    )
    fan: Literal["n2", "lever"] = Field(
        default="n2", description="What the fan speed follows: n2, or the lever."
    )
    over: Breakpoints = Field(
        default_factory=dict,
        description="Axes with which schedule and dynamics change, and their breakpoints.",
    )
    tables: dict[str, Breakpoints] = Field(
        default_factory=dict,
        examples=[{"corrected_thrust": {"corrected_n2": [0.6, 0.8, 1.0]}}],
        description="Tables that whole flights identify: axes and breakpoints of each.",
    )
    thrust_scale: float = Field(
        default=0.0, ge=0.0, description="Standard error of the factor of the recorded thrust."
    )


def read_structure(path: str | Path) -> EngineStructure:
    """Return the structure of a TOML file.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all faults of the keys.
    """
    return validate_content(EngineStructure, read_toml(path), str(path))


def structure_schema() -> dict[str, Any]:
    """Return the JSON schema of such files."""
    return file_schema(
        EngineStructure,
        "What the tables of an engine depend on, for the identification of the engine.",
    )


FINE = 0.01  # distance of the nodes, in throttle and in speed
_STEP = 1e-6  # of a difference


class EngineTable2D:
    """Table over the lever or a speed x, and over the flight condition c, d ...

        y = p(x) + sum_c [ (1 - s) a_c + s b_c ],      s = (x - x_low) / (x_high - x_low)

    p is a monotone cubic through knots.  At the first breakpoint of each condition a_c = b_c = 0,
    so p holds there.

    Parameters
    ----------
    axis : str
        ``throttle`` or ``n2``.
    knots : array (knot,)
    over : mapping of str to sequence of float
        Breakpoints of the flight condition, at least two each.
    spacing : float
        Largest distance of the nodes between which the table is linear; infinite for nodes at the
        knots alone.

    Attributes
    ----------
    axes : dict of str to array
        Breakpoints of the table: knots and evenly between them, and the flight condition.
    count : int
        Unknowns: values at the knots, then a and b of each breakpoint.
    size : int
        Nodes of the table.
    """

    def __init__(
        self,
        axis: str,
        knots: np.ndarray,
        over: Mapping[str, Sequence[float]] | None = None,
        spacing: float = FINE,
    ):
        self.knots = knots
        self.over = {name: np.array(points, float) for name, points in (over or {}).items()}
        short = [name for name, points in self.over.items() if len(points) < 2]
        if short:
            raise IdentificationError(f"one breakpoint over {' '.join(short)}; give at least two")
        self.axes = {axis: refine_knots(knots, spacing), **self.over}
        self.size = int(np.prod([len(points) for points in self.axes.values()]))
        self.count = len(knots) + 2 * sum(len(points) - 1 for points in self.over.values())

    def names(self, table: str) -> list[str]:
        """Return the names of the unknowns."""
        axis = next(iter(self.axes))
        names = [f"{table} at {axis} {x:.4g}" for x in self.knots]
        ends = [f"{axis} {x:.4g}" for x in (self.knots[0], self.knots[-1])]
        # Order of `nodes`: a and b of each breakpoint but the first, one condition after the other.
        for name, v in self.over.items():
            for x in v[1:]:
                for end in ends:
                    names.append(f"{table} from {name} {v[0]:.4g} to {x:.4g} at {end}")
        return names

    def start(self, at_knots: np.ndarray) -> np.ndarray:
        """Return the unknowns of a table that no condition changes."""
        return np.append(at_knots, np.zeros(self.count - len(self.knots)))

    def nodes(self, theta: np.ndarray) -> np.ndarray:
        """Return the nodes, one dimension per axis, from the unknowns (count,)."""
        x, *_ = self.axes.values()
        s = (x - x[0]) / (x[-1] - x[0])
        start = len(self.knots)
        value = scipy.interpolate.PchipInterpolator(self.knots, theta[:start])(x).reshape(
            -1, *[1] * len(self.over)
        )
        for k, points in enumerate(self.over.values()):
            # Rows (a, b) of the breakpoints of condition k; zero at the first one.
            unknowns = theta[start : start + 2 * (len(points) - 1)].reshape(-1, 2)
            ends = np.vstack([np.zeros(2), unknowns])
            change = np.outer(1.0 - s, ends[:, 0]) + np.outer(s, ends[:, 1])
            shape = [1] * len(self.over)
            shape[k] = len(points)
            value = value + change.reshape(len(x), *shape)
            start += 2 * (len(points) - 1)
        return value


@dataclass(frozen=True)
class EngineCurve:
    """An identified table.

    Attributes
    ----------
    leaf : Dataset
        ``value`` and ``stderr``.
    covariance : array (node, node)
        Nodes in the order of ``value`` with its last axis running fastest.
    """

    leaf: xr.Dataset
    covariance: np.ndarray

    @classmethod
    def of(
        cls,
        axes: Mapping[str, np.ndarray],
        nodes: Callable[[np.ndarray], np.ndarray],
        theta: np.ndarray,
        C: np.ndarray,
    ) -> EngineCurve:
        """Return the table from unknowns with their covariance.

        Parameters
        ----------
        axes : mapping of str to array
            Breakpoints.
        nodes : callable
            Nodes, one dimension per axis, from the unknowns (unknown,).
        theta, C : array (unknown,), (unknown, unknown)
        """
        value = nodes(theta)
        # First-order covariance of the nodes, from central differences.
        differences = []
        for step in _STEP * np.eye(len(theta)):
            differences.append((nodes(theta + step) - nodes(theta - step)).ravel())
        slopes = np.column_stack(differences) / (2.0 * _STEP)
        covariance = slopes @ C @ slopes.T
        stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(value.shape)
        outside = "linear" if list(axes) == ["throttle"] else "hold"
        return cls(
            make_term(value, dict(axes), stderr=stderr, source="flight", outside=outside),
            covariance,
        )

    def lines(self, name: str, rows: int = 12) -> list[str]:
        """Return some of the nodes as lines of text, for each flight condition of the table."""
        axis, *conditions = (str(dim) for dim in self.leaf["value"].dims)
        indices = np.unique(np.linspace(0, self.leaf.sizes[axis] - 1, rows).round().astype(int))
        lines = []
        for index in np.ndindex(*(self.leaf.sizes[dim] for dim in conditions)):
            heading = f"{name}: {axis:>12}{'value':>12}{'stderr':>10}"
            for dim, k in zip(conditions, index):
                heading += f"  {dim} {float(self.leaf[dim][k]):.4g}"
            lines.append(heading)
            part = self.leaf.isel(dict(zip(conditions, index))).isel({axis: indices})
            nodes = zip(part[axis].values, part["value"].values, part["stderr"].values)
            lines += [f"{x:>{len(name) + 14}.4f}{v:>12.5g}{s:>10.2g}" for x, v, s in nodes]
        return lines

    def at(self, place: float, **condition: float) -> tuple[float, float]:
        """Return value and standard error at a point inside the table.

        Parameters
        ----------
        place : float
            Lever or speed.
        **condition : float
            Flight condition, for a table over it.

        Raises
        ------
        IdentificationError
            A point outside the table, or a missing condition.
        """
        dims = [str(dim) for dim in self.leaf["value"].dims]
        point = {dims[0]: place, **condition}
        missing = [dim for dim in dims if dim not in point]
        if missing:
            raise IdentificationError(
                f"the table depends on {' '.join(missing)} as well; give it by name"
            )
        for dim in dims:
            points = self.leaf[dim].values
            if not points[0] - 0.01 <= point[dim] <= points[-1] + 0.01:
                raise IdentificationError(
                    f"identified for {dim} from {points[0]:.4g} to {points[-1]:.4g}; "
                    f"{point[dim]:.4g} is outside"
                )
        rows = {dim: np.array([point[dim]]) for dim in dims}
        w = basis(self.leaf, rows, outside="clamp").toarray()[0]
        return float(w @ self.leaf["value"].values.ravel()), float(np.sqrt(w @ self.covariance @ w))


def refine_knots(knots: np.ndarray, spacing: float = FINE) -> np.ndarray:
    """Return nodes at and evenly between the knots, at most `spacing` apart."""
    if len(knots) < 2:
        raise IdentificationError(
            "one position of the lever, or one speed; add records at other powers"
        )
    parts = [
        np.linspace(a, b, max(int(np.ceil((b - a) / spacing)), 1), endpoint=False)
        for a, b in pairwise(knots)
    ]
    return np.append(np.concatenate(parts), knots[-1])
