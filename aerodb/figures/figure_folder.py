"""Folder of figures that compare databases, written atomically."""

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
    folder: str | os.PathLike[str],
    format: str = "svg",
    *,
    coefficients: Sequence[str] = (),
    support: Conditions | None = None,
) -> list[Path]:
    """Draw every coefficient, and every term that databases share and in which they differ.

    A term of two axes has a difference map as well.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Two or more, the a-priori one first.
    folder : path
        A new or empty folder.  It appears after all figures are complete.  ``lift-basic.svg`` is
        CL/basic, ``lift-basic-map.svg`` its difference map, ``lift.svg`` the whole coefficient.
    format : {"svg", "png", "pdf"}
        File format of the figures.
    coefficients : sequence of str
        Coefficients to draw.  The default is all of them.
    support : mapping of str to array, optional
        Flight samples, as in `plot_comparison`. [SI]

    Returns
    -------
    list of Path
        The figures.

    Raises
    ------
    SchemaError
        The folder is not empty, only one database came, or the format is not allowed.
    FileNotFoundError
        The parent folder does not exist.
    """
    if len(databases) < 2:
        raise SchemaError("comparison", [f"{len(databases)} database came; give two or more"])
    if format not in FORMATS:
        raise SchemaError("figures", [f"the format is {format!r}; allowed: {', '.join(FORMATS)}"])
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        # Existing figures must not be overwritten.
        raise SchemaError(
            str(folder),
            ["is there and not empty; name a new folder for the figures, or remove the old one"],
        )
    names = []
    with folder_written_atomically(folder) as part:
        for stem, draw in _plan_figures(databases, coefficients, support):
            save_figure(draw(), part / f"{stem}.{format}")
            names.append(f"{stem}.{format}")
    return [folder / name for name in names]


Plan = Iterator[tuple[str, Callable[[], Figure]]]


def _plan_figures(
    databases: Mapping[str, xr.DataTree], coefficients: Sequence[str], support: Conditions | None
) -> Plan:
    """Yield file stem and maker of every figure: each coefficient, then its terms."""
    # Terms in the order of the databases, by name; each with its leaves in all databases.
    leaves_of: dict[str, list[xr.Dataset]] = {}
    for db in databases.values():
        for name, leaf in terms(db).items():
            leaves_of.setdefault(name, []).append(leaf)
    for coefficient in dict.fromkeys(name.split("/")[0] for name in leaves_of):
        if coefficients and coefficient not in coefficients:
            continue
        draw = partial(plot_comparison, databases, coefficient, support=support)
        yield file_stem(coefficient), draw
        for name, leaves in leaves_of.items():
            if name.split("/")[0] != coefficient or not _needs_figure(leaves):
                continue
            yield file_stem(name), partial(plot_comparison, databases, name, support=support)
            axes = set().union(*(leaf_breakpoints(leaf) for leaf in leaves))
            if len(axes) == 2:
                draw_map = partial(plot_difference, databases, name, support=support)
                yield f"{file_stem(name)}-map", draw_map


def _needs_figure(leaves: Sequence[xr.Dataset]) -> bool:
    """Return whether databases share a term that has curves, and differ in it."""
    if len(leaves) < 2 or not any(leaf_breakpoints(leaf) for leaf in leaves):
        return False
    # Tables with different regressors cannot be compared.
    if len({_terms.list_multipliers(leaf) for leaf in leaves}) > 1:
        return False
    first = _tables(leaves[0])
    return not all(_are_equal(first, _tables(leaf)) for leaf in leaves[1:])


def _tables(leaf: xr.Dataset) -> list[xr.DataArray]:
    return [leaf[name] for name in ("value", "K1", "K2", "stderr") if name in leaf]


def _are_equal(first: Sequence[xr.DataArray], second: Sequence[xr.DataArray]) -> bool:
    return len(first) == len(second) and all(map(xr.DataArray.equals, first, second))
