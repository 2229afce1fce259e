"""A case as xarray: SI, radians, canonical names, a flag for every value.

Dimensions of the leaves; configuration, power, height and deflection of the first three are left out where they have length one:

================  ============================================================================================================
``static``        configuration, power, condition, ground_height, delta_f (or delta_e), alpha
``downwash``      the same
``dynamic``       configuration, condition, alpha
``symflp``        condition, delta; ``dCDi``: condition, alpha, delta
``asyflp``        condition, delta_pair; ``Cn``: condition, alpha, delta_pair; of a tail: ``Cl``: condition, alpha, delta_pair
``spoiler``       condition, deflection
``tabs``          condition, alpha, delta
``trim``          condition, alpha; so ``trim_stabilizer``
``auxiliary``     condition; so ``increments``
``planform``      condition, surface, panel
``interference``  condition, surface; ``sidewash``: condition
``vortex``        condition, alpha; so ``canard_downwash``
``fairing``       condition, configuration; tables: condition, configuration, node and condition, drag_node
``section``       surface; ``CL_alpha`` and ``xac``: surface, mach
``coordinates``   surface, point
================  ============================================================================================================

LOOP=1 gives pairs of Mach number and altitude, so both are coordinates of ``condition``; `datcom_io.to_grid` unfolds a full grid.
"""

from __future__ import annotations

from collections.abc import Iterable

import xarray as xr

from ..printout.content import PrintedCase
from .conditions import arrange, reference
from .families import LEAVES
from .stacking import Stacker


def case_tree(case: PrintedCase, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Case.to_datatree`."""
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=_root_attrs(case)), **_leaves(case, fill_transonic)}, name=_node_name(case))


def listing_tree(cases: Iterable[PrintedCase], file: str, runs: int, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Listing.to_datatree`."""
    nodes = {"/": xr.Dataset(attrs={"file": file, "runs": runs})}
    for case in cases:
        if leaves := _leaves(case, fill_transonic):
            path = f"/{_node_name(case)}"
            path = f"{path} ({case.ordinal})" if path in nodes else path
            nodes[path] = xr.Dataset(attrs=_root_attrs(case))
            nodes |= {f"{path}/{leaf}": dataset for leaf, dataset in leaves.items()}
    return xr.DataTree.from_dict(nodes)


def _node_name(case: PrintedCase) -> str:
    """Return the name of a case without what makes a path of it."""
    return case.name.replace("/", "|") if case.name.strip(".") else f"case {case.ordinal}"


def _leaves(case: PrintedCase, fill_transonic: bool) -> dict[str, xr.Dataset]:
    """Return the leaves that the case has."""
    conditions, spots = arrange(case)
    stacker = Stacker(case, conditions, spots, fill_transonic)
    return {name: leaf.dataset() for name, make in LEAVES.items() if (leaf := make(stacker)) is not None}


def _root_attrs(case: PrintedCase) -> dict[str, str | float]:
    deck = case.deck
    return {
        **reference(case),
        "dim": deck.dim,
        "deriv": deck.deriv,
        "title": deck.caseid,
        "case": case.name,
        "file": case.file,
        "moment_centre": "x_cg aft and z_cg up from the drawing datum [m]",
        "messages": _messages(case),
    }


def _messages(case: PrintedCase) -> str:
    """Return the messages of a case, one line each; repeated ones once."""
    lines: dict[str, list[int]] = {}
    for message in case.messages:
        lines.setdefault(message.text, []).append(message.line)
    return "\n".join(f"line {at[0]}{f' and {len(at) - 1} more' if at[1:] else ''}: {text}" for text, at in lines.items())
