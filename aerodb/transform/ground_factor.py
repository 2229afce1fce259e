"""A table as a factor over one axis times a table over the others: K_GE(h) times an increment, LR-743 eq. (11)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import attrs


def factored(leaf: xr.Dataset, axis: str) -> tuple[xr.Dataset, float]:
    """Return a term whose table is split into a factor K1 over one axis and a table over the others.

    Parameters
    ----------
    leaf : Dataset
        A term without K1; `axis` is one of the axes of its table.
    axis : str
        Axis of the factor, such as ``h_agl``. K1 is one where the table is largest.

    Returns
    -------
    leaf : Dataset
        The split term: the product closest to the table, in least squares over all nodes (first singular pair).
    worst : float
        Largest difference of the product from the table. [unit of the table]

    Raises
    ------
    SchemaError
        The table does not have the axis, has no other one, or has a factor K1 already.

    Notes
    -----
    The standard error of a node is that at the breakpoint where K1 is one, with `worst` added in squares.
    """
    if "K1" in leaf or axis not in leaf["value"].dims or leaf["value"].ndim < 2:
        names = " ".join(map(str, leaf["value"].dims))
        raise SchemaError("factored", [f"needs a table over {axis} and another axis, without K1; this one goes over {names or 'nothing'}"])
    value = leaf["value"].transpose(axis, ...)
    matrix = value.values.reshape(value.sizes[axis], -1)
    left, size, right = np.linalg.svd(matrix, full_matrices=False)
    at = int(np.argmax(np.abs(left[:, 0])))
    K1, table = left[:, 0] / left[at, 0], left[at, 0] * size[0] * right[0]
    worst = float(np.abs(np.outer(K1, table) - matrix).max())
    rest = value.isel({axis: 0}, drop=True)
    axes = {str(name): rest[name].values for name in rest.dims}
    stderr = np.hypot(leaf["stderr"].transpose(axis, ...).values[at], worst) if "stderr" in leaf else None
    factor = xr.DataArray(K1, {axis: (axis, value[axis].values, attrs(axis))}, axis)
    made = _terms.make(table.reshape(rest.shape), axes, _terms.regressors(leaf), K1=factor, stderr=stderr, power=_terms.power(leaf))
    if "source" in leaf:
        source = leaf["source"].transpose(axis, ...).isel({axis: at}, drop=True)
        made["source"] = rest.dims, source.values, dict(leaf["source"].attrs)
    summary = f"factored: K1 over {axis}, largest difference {worst:.4g}"
    history = "\n".join(text for text in (str(leaf.attrs.get("history", "")), summary) if text)
    return made.assign_attrs({**leaf.attrs, "history": history}), worst
