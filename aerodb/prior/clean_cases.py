"""Cases of one aircraft: those of another one, copies, and chains over angles of attack.

The program takes at most 20 angles of attack a case. A deck over more of them is a chain of cases
that differ in ALSCHD alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_surface
from datcom_io.listing import Case
from flightmech.errors import SchemaError

# Namelists of the flight conditions and devices, in which cases of one aircraft may differ.
_OF_A_RUN = ("FLTCON", "GRNDEF", "SYMFLP", "ASYFLP", "CONTAB", "JETPWR", "PROPWR")
_SURFACES = {"WGPLNF": "wing", "HTPLNF": "horizontal tail"}
# Relative difference of the planforms of one aircraft, by the rounding of its cards.
_SAME_PLANFORM = 0.02
_MOST_VARIABLES = 3  # of a namelist in a message
_STABILIZER = (
    "a stabilizer that moves as a whole is one case with the card TRIM and its hinge HINAX in "
    "SYNTHS"
)


def case_label(case: Case) -> str:
    """Return file and number of a case, such as ``plus.out:2``."""
    return f"{case.file}:{case.ordinal}"


def comparable_cards(case: Case) -> dict[str, Any]:
    """Return the namelists of a case and its airfoil sections in comparable form."""
    # Cards by value: the order and the format of numbers in the deck do not count.
    meaning = case.deck.meaning()
    namelists: Any = meaning["namelists"]
    return {**namelists, "NACA": meaning["sections"]}


def require_one_aircraft(clean: Sequence[Case]) -> None:
    """Raise if the clean cases differ in their geometry."""
    for case in clean[1:]:
        differences = _geometry_differences(clean[0], case)
        if differences:
            advice = "give one with --clean FILE:CASE, or listings of one aircraft only"
            if any("ALIH" in text for text in differences):
                advice += f"; {_STABILIZER}"
            problem = (
                f"several aircraft: {case_label(clean[0])} {clean[0].name!r} and "
                f"{case_label(case)} {case.name!r} differ in {', '.join(differences)}; {advice}"
            )
            raise SchemaError("clean", [problem])


def _geometry_differences(first: Case, second: Case) -> list[str]:
    """Return the namelists of the geometry in which two cases differ, with the variables."""
    first_cards, second_cards = comparable_cards(first), comparable_cards(second)
    differences = []
    for name in dict.fromkeys([*first_cards, *second_cards]):
        one, two = first_cards.get(name), second_cards.get(name)
        if name in _OF_A_RUN or one == two:
            continue
        variables: list[str] = []
        if isinstance(one, Mapping) and isinstance(two, Mapping) and name != "NACA":
            for variable in dict.fromkeys([*one, *two]):
                if one.get(variable) != two.get(variable):
                    variables.append(str(variable))
        text = name
        if variables:
            more = " ..." if len(variables) > _MOST_VARIABLES else ""
            text += f" ({' '.join(variables[:_MOST_VARIABLES])}{more})"
        differences.append(text)
    return differences


def describe_other_aircraft(deck: Deck, aeroplane: Deck) -> str:
    """Return a clause on a surface that is not that of an aeroplane, empty if all are.

    The case of a device has fewer surfaces than the whole aeroplane; those of both must agree.
    """
    for name, what in _SURFACES.items():
        mine, its = measure_surface(deck, name), measure_surface(aeroplane, name)
        if mine is None or its is None or deck.dim != aeroplane.dim:
            continue
        for quantity in ("area", "span", "mean_chord"):
            one, two = getattr(mine, quantity), getattr(its, quantity)
            if abs(one / two - 1.0) > _SAME_PLANFORM:
                word = quantity.replace("_", " ")
                return f"the {word} of its {what} is {one:.4g}, that of the aeroplane {two:.4g}"
    return ""


def alphas_of(case: Case) -> set[float]:
    """Return the angles of attack of a case. [deg]"""
    return set(case.deck.schedule("FLTCON", "ALSCHD", "NALPHA"))


def join_chains(trees: Sequence[xr.DataTree]) -> list[xr.DataTree]:
    """Return the trees, those of the same conditions at other angles of attack as one tree.

    An angle that several trees have is taken from the first of them.
    """
    joined: list[xr.DataTree] = []
    for tree in trees:
        for k, earlier in enumerate(joined):
            if _is_continued(earlier, tree):
                joined[k] = _join_angles(earlier, tree)
                break
        else:
            joined.append(tree)
    return joined


def _is_continued(first: xr.DataTree, second: xr.DataTree) -> bool:
    """Return whether two trees have the same tables and conditions, and other angles of attack."""
    if set(first.children) != set(second.children) or "static" not in first.children:
        return False
    for name in first.children:
        one, two = first[name].to_dataset(), second[name].to_dataset()
        if not _has_same_axes(one, two):
            return False
    alphas = [tree["static"].coords.get("alpha") for tree in (first, second)]
    if alphas[0] is None or alphas[1] is None:
        return False
    return not set(alphas[1].values.tolist()) <= set(alphas[0].values.tolist())


def _has_same_axes(one: xr.Dataset, two: xr.Dataset) -> bool:
    """Return whether two leaves differ in their angles of attack alone."""
    if {name for name in one.dims if name != "alpha"} != {
        name for name in two.dims if name != "alpha"
    }:
        return False
    for name in (*one.dims, "mach", "h"):
        if name == "alpha" or name not in one.coords:
            continue
        if name not in two.coords or one[name].shape != two[name].shape:
            return False
        # Numbers that are not printed are equal to each other; texts have no NaN.
        if one[name].dtype.kind == "f" and not np.array_equal(
            one[name].values, two[name].values, equal_nan=True
        ):
            return False
        if one[name].dtype.kind != "f" and (one[name].values != two[name].values).any():
            return False
    return True


def _join_angles(first: xr.DataTree, second: xr.DataTree) -> xr.DataTree:
    """Return one tree over the angles of attack of two."""
    joined = first.copy()
    for name in first.children:
        one, two = first[name].to_dataset(), second[name].to_dataset()
        if "alpha" not in one.dims:
            continue
        names = [key for key in one.data_vars if key in two]
        rows = two[names].sel(alpha=~two["alpha"].isin(one["alpha"]))
        # Coordinates along other axes, such as lines of the print, stay those of the first.
        rows = rows.drop_vars([key for key in rows.coords if key not in rows.dims])
        along = [key for key in names if "alpha" in one[key].dims and "alpha" in rows[key].dims]
        table = xr.concat(
            [one[along].drop_vars(_lone_coordinates(one)), rows[along]], "alpha", join="outer"
        )
        table = table.sortby("alpha").assign_coords(
            {key: one[key] for key in one.coords if "alpha" not in one[key].dims}
        )
        for key in names:
            if key not in along and "alpha" not in one[key].dims:
                table[key] = one[key]
        table.attrs = one.attrs
        table["alpha"].attrs = one["alpha"].attrs
        joined[name].dataset = table
    return joined


def _lone_coordinates(leaf: xr.Dataset) -> list[str]:
    """Return the coordinates that are not axes."""
    return [str(name) for name in leaf.coords if name not in leaf.dims]


def require_one_reynolds_number(role: str, dataset: xr.Dataset) -> None:
    """Raise if pages without altitude have a Mach number at several Reynolds numbers."""
    machs = dataset["mach"].values
    repeated = sorted({mach for mach in machs if (machs == mach).sum() > 1})
    if repeated and np.isnan(dataset["h"].values).all():
        text = " ".join(f"{mach:g}" for mach in repeated)
        advice = "give one case for each Reynolds number and build from one of them, or write ALT"
        problem = f"Mach {text} is printed at several Reynolds numbers, and no altitude; {advice}"
        raise SchemaError(role, [problem])


def describe_copy(case: Case, used: Case, role: str) -> str:
    """Return the warning of a case that is left out of a role as a copy; empty for another one.

    Parameters
    ----------
    case, used : Case
        The case that is left out, and the one with its conditions.
    role : str
        Role in `from_datcom`.

    Returns
    -------
    str
        The names of the listings state other numbers, such as m0.1 and m0.2, and their pages print
        the same ones.
    """
    if not (_has_other_numbers(case, used) and _is_copy(case, used)):
        return ""
    return (
        f"{case_label(case)} is left out as {role}: it prints the same numbers as "
        f"{case_label(used)}; if it is a case of other conditions, its listing was copied over: "
        f"give the listing that DATCOM wrote for it, else delete the copy"
    )


def _has_other_numbers(one: Case, other: Case) -> bool:
    """Return whether the names of two listings state other numbers, such as m0.1 and m0.2.

    The print of another program may have the same numbers on its pages and in its name.
    """
    first, second = (re.findall(r"\d+(?:\.\d+)?", case.file) for case in (one, other))
    return first != second


def _is_copy(one: Case, other: Case) -> bool:
    """Return whether two cases print the same numbers on all pages."""
    tables = []
    for case in (one, other):
        values = []
        for page in case.pages:
            values += [table.values for table in page.tables]
        tables.append(values)
    pairs = zip(*tables, strict=False)
    return len(tables[0]) == len(tables[1]) and all(
        np.array_equal(first, second, equal_nan=True) for first, second in pairs
    )
