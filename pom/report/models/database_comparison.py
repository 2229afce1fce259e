"""Model against model: two or more databases term by term, as LR-743 sets its Figs. 1 to 4 against
Figs. 12 to 15.

Every panel holds one slice of a table, all databases over each other, with a band of one standard
error where a database states it.  Filled marks are nodes that flight has touched, open marks are
nodes as the prior gave them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from flightmech import terms
from flightmech.names import COEFFICIENTS
from flightmech.support.figures import (
    WIDTH,
    Frame,
    choose_ticks,
    clip_to_frame,
    draw_area,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_text,
    make_svg_figure,
    text_pieces,
)
from pom.report.presentation.quantities import (
    MISSING,
    fixed_decimals,
    format_number,
    quantity_label,
    short_number,
    symbol_parts,
    term_words,
)
from pom.report.submodels.section import Picture

# always shown, replaced or not: without them the rest cannot be judged
_ALWAYS = ("CL/basic", "CD/basic", "Cm/basic")
_COLUMNS, _HEIGHT, _LEFT, _TOP, _FOOT, _STRIP = 3, 140.0, 46.0, 36.0, 52.0, 58.0
_MOST_SLICES = 6
_ABSCISSA = ("alpha", "beta", "mach", "h_agl", "delta_e", "delta_a", "delta_r", "delta_f")
_FLIGHT = terms.SOURCES.index("flight")


def models_page(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return everything the template ``models.html`` needs: of `compare_for_report`, its figures ready to
    stand in the page.
    """
    drawn = [
        {
            **term,
            "figures": [
                make_svg_figure(one.height, one.body, one.words) for one in term["figures"]
            ],
        }
        for term in found["terms"]
    ]
    return {**found, "terms": drawn}


def compare_for_report(
    databases: Mapping[str, xr.DataTree],
    support: Mapping[str, pd.DataFrame],
    styles: Mapping[str, str],
) -> dict[str, Any]:
    """Return what page and paper show of databases: terms with their figures, changes, terms that
    are the same, titles and sources.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Name to database, the prior first.
    support : mapping of str to DataFrame
        Term to the points of the flight records that support it: columns named after the term's
        axes. [SI]
    styles : mapping of str to str
        Database name to the class of its line.
    """
    leaves = {name: aerodb.terms(db) for name, db in databases.items()}
    names = sorted(
        dict.fromkeys(term for found in leaves.values() for term in found), key=_place
    )  # of a set, ties would fall as they like
    drawn, same = [], []
    for term in names:
        holders = {name: found[term] for name, found in leaves.items() if term in found}
        changed = len(holders) < len(leaves) or not _alike(list(holders.values()))
        if changed or term in _ALWAYS:
            drawn.append(_term(term, holders, list(leaves), support.get(term), styles, changed))
        else:
            same.append(
                {
                    "term": term,
                    "words": term_words(term),
                    "leaf": _facts(next(iter(holders.values()))),
                }
            )
    roots = [_root(name, db, len(leaves[name])) for name, db in databases.items()]
    return {
        "terms": drawn,
        "changes": _changed(databases, drawn),
        "same": same,
        "databases": roots,
        "styles": styles,
    }


def _changed(
    databases: Mapping[str, xr.DataTree], drawn: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """Return what the last database changes in the first, term by term."""
    first, last = next(iter(databases)), list(databases)[-1]
    if first == last:
        return None
    table = aerodb.compare(databases[first], databases[last])
    rows = []
    for item in drawn:
        if item["term"] not in table.index or item["state"] == "unchanged":
            continue
        row = table.loc[item["term"]]
        errors = row["max_in_stderr"]
        rows.append(
            {
                **item,
                "change": format_number(row["max_difference"], 2),
                "errors": fixed_decimals(errors, 1) if np.isfinite(errors) else MISSING,
                "where": row["location"],
                "note": row["note"],
                "flown": item["facts"].get(last, {}).get("flown", ""),
            }
        )
    return {"first": first, "last": last, "rows": rows}


def _place(term: str) -> tuple[int, bool, str]:
    coefficient, _, name = term.partition("/")
    return (
        list(COEFFICIENTS).index(coefficient) if coefficient in COEFFICIENTS else 9,
        name != "basic",
        name,
    )


def _alike(leaves: Sequence[xr.Dataset]) -> bool:
    return all(
        set(leaf) & {"value", "K1", "K2"} == set(leaves[0]) & {"value", "K1", "K2"}
        and all(leaf[v].equals(leaves[0][v]) for v in ("value", "K1", "K2") if v in leaf)
        and terms.list_multipliers(leaf) == terms.list_multipliers(leaves[0])
        for leaf in leaves[1:]
    )


def _root(name: str, db: xr.DataTree, count: int) -> dict[str, Any]:
    words = {
        key: str(db.attrs.get(key, "")) for key in ("title", "source", "history", "references")
    }
    return {"name": name, "count": count, **words}


def _facts(leaf: xr.Dataset) -> dict[str, str]:
    shape = (
        ", ".join(f"{axis} {leaf.sizes[axis]}" for axis in map(str, leaf["value"].dims)) or "scalar"
    )
    source = flown = ""
    if "source" in leaf:
        count = np.bincount(leaf["source"].values.ravel().astype(int), minlength=len(terms.SOURCES))
        source = ", ".join(f"{n} {word}" for word, n in zip(terms.SOURCES, count, strict=True) if n)
        flown = f"{count[_FLIGHT]} of {count.sum()}"
    return {
        "shape": shape,
        "flown": flown,
        "regressors": " ".join(terms.list_multipliers(leaf)),
        "source": source or "not stated",
        **{key: str(leaf.attrs.get(key, "")) for key in ("references", "history", "comment")},
    }


def _term(term, holders, everyone, support, styles, changed) -> dict[str, Any]:
    lone = [name for name in everyone if name not in holders]
    state = f"not in {', '.join(lone)}" if lone else "replaced" if changed else "unchanged"
    factors = [symbol_parts(word) for word in terms.list_regressors(next(iter(holders.values())))]
    item: dict[str, Any] = {
        "term": term,
        "words": term_words(term),
        "state": state,
        "factors": factors,
        "facts": {n: _facts(x) for n, x in holders.items()},
    }
    shared = _shared(holders)
    tables = [quantity for quantity in ("value", "K1", "K2") if _has(holders, quantity)]
    if "value" not in tables:
        item["scalars"] = [
            (name, format_number(float(leaf["value"]), 4), _stderr(leaf))
            for name, leaf in holders.items()
        ]
    return {
        **item,
        "figures": [
            _figure(term, quantity, holders, shared, support, styles) for quantity in tables
        ],
    }


def _shared(holders: Mapping[str, xr.Dataset]) -> dict[str, list[str]]:
    """Return databases by the first of them that holds the very same leaf."""
    shared: dict[str, list[str]] = {}
    for name, leaf in holders.items():
        equal = next((first for first in shared if _identical(leaf, holders[first])), name)
        shared.setdefault(equal, []).append(name)
    return shared


def _identical(a: xr.Dataset, b: xr.Dataset) -> bool:
    return _alike([a, b]) and all(
        (v in a) == (v in b) and (v not in a or a[v].equals(b[v])) for v in ("stderr", "source")
    )


def _has(holders: Mapping[str, xr.Dataset], quantity: str) -> bool:
    return any(quantity in leaf and leaf[quantity].ndim for leaf in holders.values())


def _stderr(leaf: xr.Dataset) -> str:
    return format_number(float(leaf["stderr"]), 2) if "stderr" in leaf else ""


def _figure(term: str, quantity: str, holders, shared, support, styles) -> Picture:
    tables = {name: holders[name][quantity] for name in shared if quantity in holders[name]}
    axes_of = list(dict.fromkeys(str(d) for table in tables.values() for d in table.dims))
    x_axis = next((a for a in _ABSCISSA if a in axes_of), axes_of[0])
    slices, curves = _distinct(
        [
            (at, _curves(tables, holders, quantity, x_axis, at))
            for at in _slices(tables, [a for a in axes_of if a != x_axis])
        ]
    )
    changes = [_changes(found) for found in curves]
    strip = _STRIP if any(changes) else 0.0
    row_height, rows = _HEIGHT + strip + _FOOT, -(-len(slices) // _COLUMNS)
    width = (WIDTH - _LEFT * _COLUMNS - 10) / _COLUMNS
    parts = [_key(tables, shared, styles, bool(support is not None and len(support)))]
    for i, at in enumerate(slices):
        left, top = _LEFT + i % _COLUMNS * (width + _LEFT), _TOP + i // _COLUMNS * row_height
        frame = Frame(left, top, width, _HEIGHT, _x_range(tables, x_axis), _range(curves))
        name = f"term-{term.replace('/', '-')}-{quantity}-{i}"
        parts += [
            _slice_head(frame, term if quantity == "value" else quantity, at),
            draw_axes(frame, x_labels=not strip, x_most=5),
        ]
        parts += [
            clip_to_frame(frame, name, "".join(_trace(frame, c, styles) for c in curves[i])),
            _support(frame, support, x_axis, at, tables),
        ]
        if strip:
            frame = Frame(
                left, frame.bottom + 6, width, strip - 6, frame.x, _range(changes, zero=True)
            )
            parts += [draw_axes(frame, x_labels=True, x_most=5, y_ticks=choose_ticks(*frame.y, 3))]
            parts += [
                clip_to_frame(
                    frame, f"{name}-d", "".join(_trace(frame, c, styles) for c in changes[i])
                )
            ]
        parts.append(_abscissa(frame, x_axis))
    return Picture(
        "".join(parts),
        _TOP + rows * row_height - 16,
        f"{term} {quantity} against {x_axis} in {', '.join(tables)}",
    )


def _distinct(
    found: Sequence[tuple[dict[str, float], list[dict[str, Any]]]],
) -> tuple[list[dict[str, float]], list[list[dict[str, Any]]]]:
    """Return slices and their curves without those that show the same again."""
    kept: list[tuple[dict[str, float], list[dict[str, Any]]]] = []
    for at, curves in found:
        if not any(_same_curves(curves, before) for _, before in kept):
            kept.append((at, curves))
    return [at for at, _ in kept], [curves for _, curves in kept]


def _same_curves(ours: Sequence[Mapping[str, Any]], theirs: Sequence[Mapping[str, Any]]) -> bool:
    return all(
        np.array_equal(a[what], b[what])
        for a, b in zip(ours, theirs, strict=True)
        for what in ("x", "y", "stderr", "flown")
    )


def _changes(found: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return every later curve less the first one, on its own nodes; nothing when all are the same."""
    first, *others = found
    less = [
        {**c, "y": c["y"] - np.interp(c["x"], first["x"], first["y"]), "flown": None}
        for c in others
    ]
    return less if any(np.abs(c["y"]).max() > 0.0 for c in less) else []


def _slices(tables, others: Sequence[str]) -> list[dict[str, float]]:
    """Return the conditions of the panels: nodes of the other axes of the richest table, thinned to
    a handful.
    """
    slices: list[dict[str, float]] = [{}]
    for axis in others:
        nodes = max((t[axis].values for t in tables.values() if axis in t.dims), key=len)
        most = max(1, _MOST_SLICES // len(slices))
        chosen = nodes[
            np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), most)).round().astype(int))
        ]
        slices = [{**at, axis: float(v)} for at in slices for v in chosen]
    return slices


def _curves(tables, holders, quantity, x_axis, at) -> list[dict[str, Any]]:
    shown = quantity_label(x_axis)
    points = np.concatenate([t[x_axis].values for t in tables.values() if x_axis in t.dims])
    found = []
    for name, table in tables.items():
        leaf = holders[name]
        y = _cut(table, at)
        x = y[x_axis].values if x_axis in y.dims else np.array([points.min(), points.max()])
        nodal = quantity == "value" and x_axis in table.dims
        stderr = _cut(leaf["stderr"], at).values if nodal and "stderr" in leaf else None
        flown = (
            _cut(leaf["source"], at, nearest=True).values == _FLIGHT
            if nodal and "source" in leaf
            else None
        )
        found.append(
            {
                "name": name,
                "x": shown.shown(x),
                "y": np.broadcast_to(y.values, x.shape),
                "stderr": stderr,
                "flown": flown,
            }
        )
    return found


def _cut(table: xr.DataArray, at: Mapping[str, float], nearest: bool = False) -> xr.DataArray:
    """Return a table at given places of its other axes, held constant outside as the simulation
    does.
    """
    for axis, value in at.items():
        if axis not in table.dims:
            continue
        nodes = table[axis].values
        value = float(np.clip(value, nodes[0], nodes[-1]))
        on_node = nearest or len(nodes) == 1 or value in nodes
        table = (
            table.sel({axis: value}, method="nearest") if on_node else table.interp({axis: value})
        )
    return table


def _range(curves, zero: bool = False) -> tuple[float, float]:
    values = [
        y
        for found in curves
        for c in found
        for y in (c["y"], *(_edges(c) if c["stderr"] is not None else ()))
    ]
    finite = np.concatenate([v[np.isfinite(v)] for v in values] + [np.zeros(int(zero))])
    low, high = float(finite.min()), float(finite.max())
    pad = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return low - pad, high + pad


def _edges(c) -> tuple[np.ndarray, np.ndarray]:
    return c["y"] - c["stderr"], c["y"] + c["stderr"]


def _x_range(tables, x_axis: str) -> tuple[float, float]:
    points = np.concatenate([t[x_axis].values for t in tables.values() if x_axis in t.dims])
    shown = quantity_label(x_axis).shown(points)
    low, high = float(shown.min()), float(shown.max())
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _trace(frame: Frame, c, styles) -> str:
    css = styles[c["name"]]
    body = (
        draw_area(frame, c["x"], *_edges(c), f"error {css}-area") if c["stderr"] is not None else ""
    )
    body += draw_curve(frame, c["x"], c["y"], f"trace {css}")
    if c["flown"] is not None:
        body += draw_dots(frame, c["x"], c["y"], f"node {css}") + draw_dots(
            frame, c["x"], np.where(c["flown"], np.nan, c["y"]), "node hollow"
        )
    return body


def _slice_head(frame: Frame, name: str, at: Mapping[str, float]) -> str:
    where = ", ".join(
        f"{_plain(a)} = {short_number(float(quantity_label(a).shown(v)), 3)} {quantity_label(a).unit}".strip()
        for a, v in at.items()
    )
    return draw_text(frame.left, frame.top - 6, f"{name} at {where}" if where else name, "title")


def _abscissa(frame: Frame, x_axis: str) -> str:
    shown = quantity_label(x_axis)
    pieces = [
        (shown.base, "symbol"),
        *([(shown.sub, "sub")] if shown.sub else []),
        (f", {shown.unit}" if shown.unit else "", "caption"),
    ]
    return text_pieces(frame.left + frame.width / 2, frame.bottom + 25, pieces, "middle")


def _plain(axis: str) -> str:
    base, sub = symbol_parts(axis)
    return base + (f"_{sub}" if sub else "")


def _key(tables, shared, styles, supported: bool) -> str:
    parts, x = [], _LEFT
    for name in tables:
        words = " = ".join(shared[name])
        parts += [
            draw_line(x, 10, x + 30, 10, f"trace {styles[name]}"),
            draw_text(x + 35, 13.5, words, "caption"),
        ]
        x += 52 + 6.4 * len(words)
    if supported:
        parts += [
            draw_line(x + 4, 4, x + 4, 14, "rug"),
            draw_text(x + 12, 13.5, "flight sample", "caption"),
        ]
    return "".join(parts)


def _support(
    frame: Frame, support: pd.DataFrame | None, x_axis: str, at: Mapping[str, float], tables
) -> str:
    """Return a tick under the curve for every supporting sample that is nearest to this slice."""
    if support is None or x_axis not in support:
        return ""
    near = np.ones(len(support), bool)
    for axis, value in at.items():
        if axis in support:
            nodes = max((t[axis].values for t in tables.values() if axis in t.dims), key=len)
            near &= nodes[np.abs(support[axis].to_numpy()[:, None] - nodes).argmin(axis=1)] == value
    places = np.unique(
        np.round(frame.px(quantity_label(x_axis).shown(support[x_axis].to_numpy()[near])) * 2) / 2
    )
    places = places[(places >= frame.left) & (places <= frame.right)]
    return "".join(
        draw_line(float(x), frame.bottom - 7, float(x), frame.bottom, "rug") for x in places
    )
