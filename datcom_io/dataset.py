"""A case as xarray: SI, radians, house names, a flag beside every value.

Dimensions of the leaves, those of length one left out except ``condition`` and ``alpha``:

============  =====================================================================================
``static``    configuration, power, condition, ground_height, delta_f (or delta_e), alpha
``downwash``  the same
``dynamic``   configuration, condition, alpha
``symflp``    condition, delta; ``dCDi``: condition, alpha, delta
``asyflp``    condition, delta_pair; ``Cn``: condition, alpha, delta_pair
============  =====================================================================================

LOOP=1 gives pairs of Mach number and altitude, so both are coordinates of ``condition``; `datcom_io.to_grid` unfolds a full grid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import ParseError
from flightmech.names import VOCABULARY, attrs
from flightmech.units import DEGREE

from .arrange import Condition, Spot, arrange, control_surface, reference
from .blocks import BY_NAME, Column
from .cells import ABSENT, BLANK, FILLED, FLAGS, OK
from .listing import Case, Listing, Page, Table

_HALF_UNIT = 0.0501  # of the axes, printed with one decimal [deg]
_CONDITION_UNITS = {"mach": "1", "h": "m", "V": "m s-1", "p_static": "Pa", "temperature": "K", "reynolds_per_m": "m-1"}
_LONG_NAMES = {
    "CN": "normal-force coefficient, body axes",
    "CA": "axial-force coefficient, body axes, positive aft",
    "xcp": "centre of pressure forward of the moment centre, in chords: CM/CN, and CMA/CLA from the first row without CM or CN on",
    "ground_height": "height of the drawing datum (z = 0) over the ground, infinite in free air",
    "q_ratio": "dynamic pressure at the horizontal tail over that of the free stream",
    "epsilon": "downwash angle at the horizontal tail",
    "epsilon_alpha": "slope of the downwash angle with alpha",
    "dCL": "increment of the lift coefficient, constant in alpha",
    "dCm": "increment of the pitching-moment coefficient",
    "dCLmax": "increment of the largest lift coefficient",
    "dCDmin": "increment of the smallest drag coefficient",
    "dCDi": "increment of the induced-drag coefficient",
    "CL_alpha_delta": "lift-curve slope of the surface with the device deflected",
    "Ch_alpha": "hinge-moment coefficient per alpha, on twice the area moment of the control about its hinge line",
    "Ch_delta": "hinge-moment coefficient per deflection, on twice the area moment of the control about its hinge line",
}
_FLAG_ATTRS = {"flag_values": " ".join(map(str, range(len(FLAGS)))), "flag_meanings": " ".join(FLAGS)}


class Axis(NamedTuple):
    """A dimension with its coordinate in SI."""

    name: str
    values: Sequence
    units: str = ""


def case_tree(case: Case, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Case.to_datatree`."""
    conditions, spots = arrange(case)
    maker = _Maker(case, conditions, spots, fill_transonic)
    leaves = {
        "static": maker.over_alpha("static"),
        "downwash": maker.over_alpha("downwash"),
        "dynamic": maker.over_alpha("dynamic"),
        "symflp": maker.symflp(),
        "asyflp": maker.asyflp(),
    }
    root = xr.Dataset(attrs=_root_attrs(case))
    return xr.DataTree.from_dict({"/": root, **{name: leaf for name, leaf in leaves.items() if leaf is not None}}, name=case.name)


def listing_tree(listing: Listing, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Listing.to_datatree`."""
    root = xr.DataTree(xr.Dataset(attrs={"file": listing.file, "runs": listing.runs}))
    for case in listing:
        tree, name = case_tree(case, fill_transonic=fill_transonic), case.name.replace("/", "|")
        if tree.children:
            root[f"{name} ({case.ordinal})" if name in root.children else name] = tree
    return root


def _root_attrs(case: Case) -> dict[str, str | float]:
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


def _messages(case: Case) -> str:
    """Return the messages of a case, one line each; repeated ones once."""
    lines: dict[str, list[int]] = {}
    for message in case.messages:
        lines.setdefault(message.text, []).append(message.line)
    return "\n".join(f"line {at[0]}{f' and {len(at) - 1} more' if at[1:] else ''}: {text}" for text, at in lines.items())


class _Maker:
    """Stacks the printed tables of one case into arrays."""

    def __init__(self, case: Case, conditions: list[Condition], spots: dict[int, Spot], fill_transonic: bool):
        self.case, self.conditions, self.spots, self.fill_transonic = case, conditions, spots, fill_transonic

    def placed(self, name: str) -> list[tuple[Spot, Page, Table]]:
        return [(self.spots[page.first], page, table) for page, table in self.case.tables(name) if page.first in self.spots]

    def over_alpha(self, name: str) -> xr.Dataset | None:
        """Stack the tables of a kind that have one row per alpha and one page per configuration."""
        placed = self.placed(name)
        if not placed:
            return None
        device = "delta_e" if control_surface(self.case.deck) == "tail" else "delta_f"
        axes = [Axis("configuration", list(dict.fromkeys(page.configuration for _, page, _ in placed)))]
        if name != "dynamic":
            axes.append(Axis("power", list(dict.fromkeys(page.power for _, page, _ in placed))))
        axes.append(self._condition_axis())
        if name != "dynamic":
            axes.append(Axis("ground_height", sorted({spot.ground_height for spot, _, _ in placed}), "m"))
            axes.append(Axis(device, sorted({spot.delta for spot, _, _ in placed}), "deg"))
        items = []
        for spot, page, table in placed:
            key = {
                "configuration": page.configuration,
                "power": page.power,
                "condition": spot.condition,
                "ground_height": spot.ground_height,
                device: spot.delta,
            }
            items.append(([list(axis.values).index(key[axis.name]) for axis in axes], page, table))
        found = self._stack(BY_NAME[name].columns[1:], axes, self._axis(placed, "alpha", self._alphas()), items)
        found = found.squeeze([axis.name for axis in axes if axis.name != "condition" and len(axis.values) == 1])
        return found if self.case.deck.values("SYMFLP", "DELTA") else found.drop_vars(device, errors="ignore")

    def symflp(self) -> xr.Dataset | None:
        """Stack the increments of a symmetrical device, hinge moments and induced drag."""
        placed = self.placed("symflp")
        if not placed:
            return None
        deltas = self._axis(placed, "delta", self.case.deck.schedule("SYMFLP", "DELTA", "NDELTA"))
        items = [([spot.condition], page, table) for spot, page, table in placed]
        found = self._stack(BY_NAME["symflp"].columns[1:], [self._condition_axis()], deltas, items)
        if drag := self.placed("dcdi"):
            found = self._with_two_way(found, drag, deltas)
        words = placed[0][1].configuration.split(None, 1)
        surface = words[0].lower() if words and words[0] in ("WING", "TAIL") else control_surface(self.case.deck)
        return found.assign_attrs(surface=surface, device=words[1].lower() if len(words) > 1 else "")

    def asyflp(self) -> xr.Dataset | None:
        """Stack rolling and yawing moment of ailerons."""
        placed = self.placed("asyflp_roll")
        if not placed:
            return None
        sides = []
        for k, (name, variable) in enumerate((("delta_left", "DELTAL"), ("delta_right", "DELTAR"))):
            sides.append(self._axis(placed, name, self.case.deck.schedule("ASYFLP", variable, "NDELTA"), column=k))
        pairs = Axis("delta_pair", list(range(len(sides[0].values))))
        items = [([spot.condition], page, table) for spot, page, table in placed]
        found = self._stack(BY_NAME["asyflp_roll"].columns[2:], [self._condition_axis()], pairs, items)
        if yaw := self.placed("asyflp_cn"):
            difference = [left - right for left, right in zip(sides[0].values, sides[1].values)]
            # each angle is rounded, so their difference may be off by two half units
            found = self._with_two_way(found, yaw, pairs, difference, 2 * _HALF_UNIT)
        for side in sides:
            found = found.assign_coords({side.name: ("delta_pair", np.array(side.values) * DEGREE, {"units": "rad", "sign": "TED"})})
        words = placed[0][1].configuration
        surface = "tail" if "STABILIZER" in words else "wing"
        return found.assign_attrs(surface=surface, device=words.removeprefix("WING ").lower())

    def _with_two_way(
        self,
        found: xr.Dataset,
        placed: list[tuple[Spot, Page, Table]],
        across: Axis,
        printed: Sequence[float] | None = None,
        half_unit: float = _HALF_UNIT,
    ) -> xr.Dataset:
        """Add two-way tables as a variable (condition, alpha, across); `printed` are the heading values when they are not the axis."""
        column = placed[0][2].layout.across
        assert column is not None
        wanted = across.values if printed is None else printed
        for _, _, table in placed:
            assert table.across is not None
            self._demand(column.name, table.across, wanted, [table.across_line] * len(table.across), half_unit)
        alphas = self._axis(placed, "alpha", self._alphas())
        shape = (len(self.conditions), len(alphas.values), len(across.values))
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        lines = np.full(shape[0], "", dtype=object)
        for spot, _, table in placed:
            rows, count = len(table.rows), len(table.columns) - 1
            flag[spot.condition, :rows, :count] = table.flags[:, 1:]
            value[spot.condition, :rows, :count] = np.where(table.flags[:, 1:] == OK, table.values[:, 1:], np.nan)
            lines[spot.condition] = f"{table.lines[0]}-{table.lines[-1]}"
        found = found.assign_coords({"alpha": self._coords([alphas])["alpha"]})
        _add(found, column.cell, ["condition", "alpha", across.name], value, flag)
        return found.assign_coords({f"lines_{column.cell.house}": ("condition", lines.astype(str))})

    def _stack(self, columns: Sequence[Column], axes: list[Axis], rows: Axis, items: list[tuple[list[int], Page, Table]]) -> xr.Dataset:
        """Return tables as arrays (axes..., rows); `items` holds index along the axes, page and table."""
        outer = tuple(len(axis.values) for axis in axes)
        lines = np.full(outer, "", dtype=object)
        for where, _, table in items:
            if lines[tuple(where)]:
                found = f"a second {table.name} table for the place of the one at lines {lines[tuple(where)]}"
                raise ParseError(self.case.file, table.lines[0], found, "one table per configuration, condition, height and deflection")
            lines[tuple(where)] = f"{table.lines[0]}-{table.lines[-1]}"
        stacked = xr.Dataset(coords=self._coords([*axes, rows]))
        for column in columns:
            value, flag = np.full((*outer, len(rows.values)), np.nan), np.full((*outer, len(rows.values)), ABSENT, np.uint8)
            for where, page, table in items:
                part_value, part_flag = self._column(column, page, table)
                value[tuple(where)][: len(part_value)], flag[tuple(where)][: len(part_flag)] = part_value, part_flag
            _add(stacked, column, [axis.name for axis in (*axes, rows)], value, flag)
        return stacked.assign_coords(lines=([axis.name for axis in axes], lines.astype(str)))

    def _column(self, column: Column, page: Page, table: Table) -> tuple[np.ndarray, np.ndarray]:
        """Return a printed column in SI and its flags, a constant column filled downwards where that is allowed."""
        at = table.columns.index(column)
        flag = table.flags[:, at].copy()
        per = page.per or self.case.deck.deriv.lower()
        per_degree = column.units == "1/deg" or (column.units == "1/angle" and per == "deg")
        factor = DEGREE if column.units == "deg" else 1.0 / DEGREE if per_degree else 1.0
        value = np.where(flag == OK, table.values[:, at] * factor, np.nan)
        transonic = self.case.deck.regime(page.condition("mach")) == "transonic"
        if column.constant and len(flag) > 1 and (flag[1:] == BLANK).all() and (self.fill_transonic or not transonic):
            value[1:] = value[0]
            flag[1:] = FILLED if flag[0] == OK else flag[0]
        return value, flag

    def _alphas(self) -> list[float]:
        return self.case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")

    def _condition_axis(self) -> Axis:
        return Axis("condition", list(range(len(self.conditions))))

    def _axis(self, placed: list[tuple[Spot, Page, Table]], name: str, exact: Sequence[float], column: int = 0) -> Axis:
        """Return a row axis: the deck's values, or the printed ones without a deck; all tables must agree with it. [deg]"""
        longest = max((table for _, _, table in placed), key=lambda table: len(table.rows))
        values = list(exact) or [float(x) for x in longest.values[:, column]]
        for _, _, table in placed:
            self._demand(table.columns[column].name, table.values[:, column], values, table.lines)
        return Axis(name, values, "deg")

    def _demand(self, name: str, printed: np.ndarray, exact: Sequence[float], lines: Sequence[int], half_unit: float = _HALF_UNIT) -> None:
        """Raise when printed axis values are not the deck's, to the half unit of the print."""
        if len(printed) > len(exact):
            raise ParseError(self.case.file, lines[-1], f"{len(printed)} values of {name}", f"{len(exact)} as in the input cards")
        for line, shown, wanted in zip(lines, printed, exact):
            if not abs(shown - wanted) <= half_unit:
                raise ParseError(self.case.file, line, f"{name} = {shown:g} deg", f"{wanted:g} deg as in the input cards of the case")

    def _coords(self, axes: Sequence[Axis]) -> Mapping[str, object]:
        coords: dict[str, object] = {}
        for axis in axes:
            values = np.array(axis.values) * DEGREE if axis.units == "deg" else np.array(axis.values)
            units = {"deg": "rad"}.get(axis.units, axis.units)
            known = attrs(axis.name) if axis.name in VOCABULARY else {"units": units} if units else {}
            if axis.name in _LONG_NAMES:
                known["long_name"] = _LONG_NAMES[axis.name]
            coords[axis.name] = (axis.name, values, known)
        for name, units in _CONDITION_UNITS.items():
            coords[name] = ("condition", np.array([getattr(condition, name) for condition in self.conditions]), {"units": units})
        count = len(self.conditions)
        coords["case"] = ("condition", np.array([self.case.name] * count, dtype=str))
        coords["file"] = ("condition", np.array([self.case.file] * count, dtype=str))
        return coords


def _add(dataset: xr.Dataset, column: Column, dims: Sequence[str], value: np.ndarray, flag: np.ndarray) -> None:
    """Put a variable and its twin of flags into a Dataset."""
    known = attrs(column.house) if column.house in VOCABULARY else {"units": "rad" if column.units == "deg" else "1"}
    if column.house in _LONG_NAMES:
        known["long_name"] = _LONG_NAMES[column.house]
    if column.units in ("1/angle", "1/deg"):
        known["per"] = "radian"
    dataset[column.house] = (dims, value, {**known, "printed_as": column.name})
    dataset[f"{column.house}_flag"] = (dims, flag, dict(_FLAG_ATTRS))
