"""A folder of figures that sets databases against each other, written atomically."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import xarray as xr

from aerodb.comparison.conditions import Conditions, leaf_breakpoints
from aerodb.figures.comparison_figures import plot_difference
from aerodb.figures.drawing import FORMATS, Figure, save_figure
from aerodb.figures.figures import plot_comparison
from aerodb.figures.symbols import file_stem
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import folder_written_atomically


def write_comparison(
    databases: Mapping[str, xr.DataTree],
    folder: str | os.PathLike,
    format: str = "svg",
    *,
    coefficients: Sequence[str] = (),
    support: Conditions | None = None,
) -> list[Path]:
    """Draw every term family that databases share and in which they differ, every coefficient, and
    maps of two-axis terms.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Two or more, the a-priori one first.
    folder : path
        A new or empty folder; it appears once all figures are in it. ``lift-basic.svg`` is
        CL/basic, ``lift-basic-map.svg`` its difference map, ``lift.svg`` the whole coefficient.
    format : {"svg", "png", "pdf"}
    coefficients : sequence of str
        Only these; all without.
    support : mapping of str to array, optional
        Flight samples, as in `plot_comparison`. [SI]

    Returns
    -------
    list of Path
        The figures.

    Raises
    ------
    SchemaError
        The folder holds something, one database only, or another format.
    FileNotFoundError
        The folder above it is not there.
    """
    if len(databases) < 2:
        raise SchemaError("comparison", [f"{len(databases)} database came; give two or more"])
    if format not in FORMATS:
        raise SchemaError("figures", [f"the format is {format!r}; allowed: {', '.join(FORMATS)}"])
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SchemaError(
            str(folder),
            ["is there and not empty; name a new folder for the figures, or remove the old one"],
        )
    names = []
    with folder_written_atomically(folder) as part:
        for stem, draw in _plan(databases, coefficients, support):
            save_figure(draw(), part / f"{stem}.{format}")
            names.append(f"{stem}.{format}")
    return [folder / name for name in names]


Plan = Iterator[tuple[str, Callable[[], Figure]]]


def _plan(
    databases: Mapping[str, xr.DataTree], coefficients: Sequence[str], support: Conditions | None
) -> Plan:
    """Yield name and maker of every figure: each coefficient, then its terms."""
    found = [terms(db) for db in databases.values()]
    order = list(dict.fromkeys(name for leaves in found for name in leaves))
    for coefficient in dict.fromkeys(name.split("/")[0] for name in order):
        if coefficients and coefficient not in coefficients:
            continue
        yield (
            file_stem(coefficient),
            partial(plot_comparison, databases, coefficient, support=support),
        )
        for name in order:
            shared = [leaves[name] for leaves in found if name in leaves]
            if name.split("/")[0] != coefficient or len(shared) < 2 or not _drawable(shared):
                continue
            yield file_stem(name), partial(plot_comparison, databases, name, support=support)
            if len({axis for leaf in shared for axis in leaf_breakpoints(leaf)}) == 2:
                yield (
                    f"{file_stem(name)}-map",
                    partial(plot_difference, databases, name, support=support),
                )


def _drawable(leaves: Sequence[xr.Dataset]) -> bool:
    """Whether a term has curves, the same regressors everywhere, and something that differs."""
    if (
        not any(leaf_breakpoints(leaf) for leaf in leaves)
        or len({_terms.list_multipliers(leaf) for leaf in leaves}) > 1
    ):
        return False
    tables = [
        [leaf[name] for name in ("value", "K1", "K2", "stderr") if name in leaf] for leaf in leaves
    ]
    first, *others = tables
    return not all(
        len(other) == len(first) and all(map(xr.DataArray.equals, first, other)) for other in others
    )
