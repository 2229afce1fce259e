"""Rules of a valid database, and its construction from terms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aerodb.store.templates import HINGE as HINGE
from aerodb.store.templates import lr743
from flightmech import terms as _terms
from flightmech.build_up import evaluation_levels
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.array_files.netcdf_trees import GROUPS

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

FORCE_AXES = {
    "stability": ("CL", "CD", "CY", "Cl", "Cm", "Cn"),
    "wind": ("CL", "CD", "CY", "Cl", "Cm", "Cn"),
    "body": ("CX", "CY", "CZ", "Cl", "Cm", "Cn"),
}
_TEXTS = ("title", "aircraft", "force_axes")
_NUMBERS = ("S", "cbar", "b", "x_ref", "y_ref", "z_ref")
_NAME = re.compile(r"^[A-Za-z][A-Za-z0-9_]*$")

# Names of the terms of the build-up.  The root attribute ``absent`` lists those without a source.
SCHEME = tuple(lr743())


def terms(db: xr.DataTree) -> dict[str, xr.Dataset]:
    """Return the terms of a database by name, ``{"CL/basic": leaf, ...}``.

    They have the order of the tree.  The groups `GROUPS` do not contain terms.
    """
    leaves: dict[str, xr.Dataset] = {}
    # Level by level, as `DataTree.subtree`.  The latter forms each path from all parents.
    level = [(db.path.strip("/"), db)]
    while level:
        next_level = []
        for name, node in level:
            is_leaf = bool(name) and (node.has_data or not node.children)
            if is_leaf and name.split("/")[0] not in GROUPS:
                leaves[name] = node.to_dataset(inherit=False)
            for key, child in node.children.items():
                next_level.append((f"{name}/{key}".lstrip("/"), child))
        level = next_level
    return leaves


def make_database(leaves: Mapping[str, xr.Dataset], **attributes: str | float) -> xr.DataTree:
    """Return a checked database made of terms.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        Terms by name, ``"CL/basic"``.
    **attributes : str or float
        Root attributes: ``title``, ``aircraft``, ``S`` [m2], ``cbar``, ``b`` [m], ``x_ref``,
        ``y_ref``, ``z_ref`` (moment reference point from the drawing datum, body directions) [m],
        ``force_axes``, and any of ``source``, ``history``, ``references``, ``comment``, ``absent``.

    Raises
    ------
    SchemaError
        The database is not valid; all faults.
    """
    import xarray as xr

    nodes = {"/": xr.Dataset(attrs=attributes)}
    for name, leaf in leaves.items():
        nodes[f"/{name}"] = leaf
    tree = xr.DataTree.from_dict(nodes)
    require_valid(tree)
    return tree


def make_prior_database(
    aircraft: Aircraft,
    leaves: Mapping[str, xr.Dataset],
    point: Sequence[float],
    **attributes: str | float,
) -> xr.DataTree:
    """Return a checked a-priori database of an aircraft, its terms in the order of the scheme.

    Parameters
    ----------
    aircraft : Aircraft
        Its name and reference quantities are those of the database.
    leaves : mapping of str to Dataset
        Terms by name, forces in stability axes.
    point : sequence of float
        Moment reference point from the drawing datum, body directions. [m]
    **attributes : str or float
        Further root attributes: ``source``, the programs that the terms come from, ``history``, and
        others.

    Raises
    ------
    SchemaError
        As `make_database`.
    """
    x_ref, y_ref, z_ref = map(float, point)
    return make_database(
        {name: leaves[name] for name in sorted(leaves, key=scheme_order)},
        title=f"{aircraft.name}: a-priori database from {attributes['source']}",
        aircraft=aircraft.name,
        S=float(aircraft.S),
        cbar=float(aircraft.cbar),
        b=float(aircraft.b),
        x_ref=x_ref,
        y_ref=y_ref,
        z_ref=z_ref,
        force_axes="stability",
        **attributes,
        absent=" ".join(name for name in SCHEME if name not in leaves),
    )


def scheme_order(name: str) -> tuple[int, str]:
    """Return the sort key of a term: its position in the scheme, terms outside it last."""
    if name in SCHEME:
        return SCHEME.index(name), name
    return len(SCHEME), name


def check(db: xr.DataTree) -> list[str]:
    """Return every fault of a database as a text; an empty list means it is sound."""
    problems = _root_faults(db.attrs)
    if db.data_vars:
        problems.append(
            f"root holds the variables {', '.join(map(str, db.data_vars))}; tables belong "
            f"into leaves such as CL/basic"
        )
    # With unknown force axes every coefficient is allowed: the root fault is reported alone.
    axes = FORCE_AXES.get(str(db.attrs.get("force_axes")))
    allowed: tuple[str, ...] = ()
    if axes is not None:
        allowed = (*axes, *HINGE)
    leaves = terms(db)
    if not leaves:
        problems.append("holds no term; a database has leaves such as CL/basic")
    for name, leaf in leaves.items():
        faults = _name_faults(name, allowed) + _terms.check_term(leaf)
        problems += [f"{name}: {fault}" for fault in faults]
    # Loops between coefficients can only be searched in sound terms.
    if axes is not None and not problems:
        problems += evaluation_levels(leaves, str(db.attrs["force_axes"]))[1]
    return problems


def require_valid(db: xr.DataTree) -> None:
    """Raise a `SchemaError` with all faults of a database, if there are any."""
    problems = check(db)
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", problems)


def find_leaf(db: xr.DataTree, name: str) -> xr.Dataset:
    """Return one term; raise `UnknownName` with similar names if there is none."""
    leaves = terms(db)
    if name not in leaves:
        raise UnknownName(name, leaves, "term")
    return leaves[name]


def database_coefficients(db: xr.DataTree) -> tuple[str, ...]:
    """Return the six coefficients of force and moment for the force axes of a database.

    Hinge moments (`HINGE`) are allowed with any axes.
    """
    return FORCE_AXES[str(db.attrs["force_axes"])]


def _root_faults(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the faults of the root attributes."""
    # Texts, finite numbers, positive lengths, known axes, storable attributes.
    problems = []
    for key in _TEXTS:
        if not isinstance(attributes.get(key), str):
            problems.append(f"root attribute {key} is {attributes.get(key)!r}; a text is needed")
    for key in _NUMBERS:
        item = attributes.get(key)
        if not isinstance(item, int | float | np.integer | np.floating) or not np.isfinite(item):
            problems.append(f"root attribute {key} is {item!r}; a finite number in SI is needed")
        elif key in ("S", "cbar", "b") and item <= 0:
            problems.append(f"root attribute {key} is {item!r}; it must be positive")
    if isinstance(attributes.get("force_axes"), str) and attributes["force_axes"] not in FORCE_AXES:
        problems.append(
            f"root attribute force_axes is {attributes['force_axes']!r}; allowed: "
            f"{', '.join(FORCE_AXES)}"
        )
    for key, item in attributes.items():
        if key not in _TEXTS + _NUMBERS and not isinstance(
            item, str | int | float | np.integer | np.floating
        ):
            problems.append(
                f"root attribute {key} is a {type(item).__name__}; only text and numbers "
                f"survive in a file"
            )
    return problems


def _name_faults(name: str, allowed: tuple[str, ...]) -> list[str]:
    """Return the faults of the name of a term; any coefficient is allowed if `allowed` is empty."""
    parts = name.split("/")
    if len(parts) != 2:
        return ["a term stands at <coefficient>/<contribution>, two levels, no more and no less"]
    faults = []
    if allowed and parts[0] not in allowed:
        faults.append(
            f"unknown coefficient {parts[0]!r}; with these force_axes allowed: {', '.join(allowed)}"
        )
    if not _NAME.match(parts[1]):
        faults.append(f"contribution {parts[1]!r} is not a word of letters, digits and underscores")
    return faults
