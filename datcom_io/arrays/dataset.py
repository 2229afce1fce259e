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
    conditions, spots = arrange(case)
    stacker = Stacker(case, conditions, spots, fill_transonic)
    leaves = {name: make(stacker) for name, make in LEAVES.items()}
    root = xr.Dataset(attrs=_root_attrs(case))
    return xr.DataTree.from_dict({"/": root, **{name: leaf for name, leaf in leaves.items() if leaf is not None}}, name=case.name)


def listing_tree(cases: Iterable[PrintedCase], file: str, runs: int, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Listing.to_datatree`."""
    root = xr.DataTree(xr.Dataset(attrs={"file": file, "runs": runs}))
    for case in cases:
        tree, name = case_tree(case, fill_transonic=fill_transonic), case.name.replace("/", "|")
        if tree.children:
            root[f"{name} ({case.ordinal})" if name in root.children else name] = tree
    return root


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
