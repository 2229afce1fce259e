"""Whether the samples reach the nodes of a table of hinge moments.

A fit of straight lines between nodes continues its first and last line as far as the samples go,
and gives every node a value.  The database holds the value of an end node beyond it.  So samples
beyond the nodes are fitted by a model that is not that of the database, and a node without samples
is an extrapolation, whatever its standard error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightmech.names import value_text
from flighttest.remarks import Remark
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.windows import PreparedRecord

# Distance of an end node from the samples, and of an inner one, in the shorter interval next to it.
_END, _INNER = 0.25, 0.5
# Distance of a sample beyond the end nodes, in the interval at the end, and share of such samples.
_MARGIN, _FEW = 0.1, 0.01


def find_unsupported(nodes: Sequence[float], samples: np.ndarray) -> np.ndarray:
    """Return for each node whether no sample is near enough to give its value, (nodes,)."""
    x, at = np.asarray(nodes, float), samples[np.isfinite(samples)]
    intervals = np.diff(x)
    shorter = np.minimum(np.append(intervals, np.inf), np.append(np.inf, intervals))
    reach = _INNER * shorter
    reach[[0, -1]] = _END * shorter[[0, -1]]
    if not len(at):
        return np.ones(len(x), bool)
    # An end node between samples is reached, whatever lies next to it.
    distance = np.abs(x[:, None] - at[None, :]).min(axis=1)
    is_outside = (x < at.min()) | (x > at.max())
    is_end = np.isin(np.arange(len(x)), (0, len(x) - 1))
    return (distance > reach) & (is_outside | ~is_end)


def list_coverage_remarks(
    variable: str, nodes: Sequence[float], samples: np.ndarray
) -> list[Remark]:
    """Return remarks on samples beyond the nodes, and on nodes without samples near them.

    Parameters
    ----------
    variable : str
        Variable of the table.
    nodes : sequence of float
        Its nodes, rising. [SI]
    samples : array (sample,)
        Values of the variable in the samples of the fit. [SI]
    """
    at = samples[np.isfinite(samples)]

    def text(value: float) -> str:
        return value_text(variable, float(value))

    if not len(at):
        return [Remark("range", f"no sample has {variable}", variable, severity="error")]
    span = f"the samples have {variable} {text(at.min())} to {text(at.max())}"
    remarks = []
    low = nodes[0] - _MARGIN * (nodes[1] - nodes[0])
    high = nodes[-1] + _MARGIN * (nodes[-1] - nodes[-2])
    share = float(((at < low) | (at > high)).mean())
    if share > _FEW:
        reason = (
            f"{share:.0%} of the samples lie beyond the nodes {text(nodes[0])} to "
            f"{text(nodes[-1])}: {span}, and the database holds the last value there; move the end "
            f"nodes to the ends of the samples, or leave these records out"
        )
        remarks.append(
            Remark("range", reason, variable, value=share, threshold=_FEW, severity="error")
        )
    for node, is_far in zip(nodes, find_unsupported(nodes, at), strict=True):
        if is_far:
            reason = (
                f"no samples near the node {variable} {text(node)}: {span}, and its values are "
                f"extrapolated; leave the node out, or fly there"
            )
            remarks.append(Remark("range", reason, variable, float(node), severity="error"))
    return remarks


def hinge_table_samples(
    loading: ControlLoading, records: Sequence[PreparedRecord]
) -> np.ndarray | None:
    """Return the variable of the tables of hinge moments in the samples of records."""
    if loading.over is None:
        return None
    variable, _ = loading.over
    samples = []
    for record in records:
        values = record.moved[variable].values
        # Driven records have a mask of samples; windows of free motion use all of theirs.
        samples.append(values if isinstance(record.used, list) else values[record.used])
    return np.concatenate(samples)
