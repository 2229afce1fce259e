"""Plot files (unit 13): tables of the print file, with five significant digits.

The blocks of all eleven configurations are in the file whether they are printed or not.  The block
of a configuration that the aeroplane does not have holds nothing, or numbers of an earlier case.
The logicals of the case therefore decide which configurations are real.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import xarray as xr

from datcom_io.arrays.leaves import LONG_NAMES, LeafBuilder, empty_cells
from datcom_io.cells import BLANK, FILLED, OK, SUSPECT
from datcom_io.exchange.plot_files.plot_cases import PlotCase, PlotPage, read_cases
from datcom_io.exchange.plot_files.plot_conditions import (
    alpha_coord,
    condition_coords,
    real_configurations,
    transonic_conditions,
)
from datcom_io.exchange.plot_files.plot_records import CONFIGURATIONS
from datcom_io.exchange.plot_files.plot_schedule import (
    MOST_ANGLES,
    angles_of_attack,
    ground_heights,
)
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from flightmech.units import DEGREE, FOOT

_COLUMNS: dict[str, PrintedColumn] = {}
for _name in ("static", "downwash", "symflp"):
    _COLUMNS |= {column.quantity: column for column in BY_NAME[_name].columns}
# Blocks of a configuration, of the downwash and of a control device, in the order of the file.
_STATIC = ("CD", "CL", "Cm", "CN", "CA", "CL_alpha", "Cm_alpha", "CY_beta", "Cn_beta", "Cl_beta")
_DOWNWASH = ("q_ratio", "epsilon", "epsilon_alpha")
_SYMFLP = ("dCL", "dCm", "dCLmax", "dCDmin", "CL_alpha_delta", "Ch_alpha", "Ch_delta")
_DCDI = PrintedColumn("D(CDI)", 0, 0, "dCDi")
_CD0 = PrintedColumn("CDO", 0, 0, "CD0")
_MOST_DELTAS = 10
_AREA = FOOT**2
# Names of SYNA in the order of the file; lengths in feet, angles in degrees.
_SYNTHESIS = (
    "XCG",
    "XW",
    "ZW",
    "ALIW",
    "ZCG",
    "XH",
    "ZH",
    "ALIH",
    "XV",
    "VERTUP",
    "HINAX",
    "XVF",
    "SCALE",
    "ZV",
    "ZVF",
    "YV",
    "YF",
    "PHIV",
    "PHIF",
)
_ANGLES = ("ALIW", "ALIH", "PHIV", "PHIF")
_NO_LENGTH = ("VERTUP", "SCALE")


def read_plot(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a plot file (unit 13).

    Parameters
    ----------
    path : path
        ``for013.dat``, written by a run with card PLOT.

    Returns
    -------
    DataTree
        One child per case, ``case 1`` ..., in SI and radians with flags, under the names of
        `Case.to_datatree`:

        ``static`` (configuration, condition, alpha) and ``zero_lift`` (configuration, condition)
        for every configuration the case has, printed or not; ``downwash`` (condition, alpha);
        ``symflp`` (condition, delta), ``dCDi`` (condition, alpha, delta); ``ground``
        (configuration, condition, deflection, ground_height, alpha): the coefficients over ground,
        from the second deflection on flagged ``suspect`` as in the print; ``records`` and
        ``ground_records``: all numbers as written, in feet, pounds, degrees Rankine and degrees,
        each with its flag.  A deflection of zero is written as 0.01 deg, as the program uses it.

        Conditions are all of the run in their order; a number that the file does not have of a
        condition is flagged ``absent``.  A case without logicals has ``records`` alone: its first
        condition has no static page, which is so with a hypersonic flap, a transverse jet, and
        ground heights or engines at a supersonic Mach number.

    Raises
    ------
    ParseError
        The file is not a plot file, ends within a record, or does not have the records that
        the switches of its cases state.
    """
    file = Path(path).name
    root = xr.DataTree(xr.Dataset(attrs={"file": file}))
    for number, case in enumerate(read_cases(path), 1):
        root[f"case {number}"] = _case_tree(case, file, f"case {number}")
    return root


def _case_tree(case: PlotCase, file: str, name: str) -> xr.DataTree:
    """Return the tree of one case."""
    pages = [condition.page | condition.control for condition in case.conditions]
    # The logicals state which configurations are real.
    if not case.logicals:
        message = (
            f"line {case.line}: no static page in the first condition of this case, so the file "
            f"does not state its parts"
        )
        attrs = {"case": name, "file": file, "line": case.line, "messages": message}
        nodes = {"/": xr.Dataset(attrs=attrs), "records": _record_leaf(case, "condition", pages)}
        return xr.DataTree.from_dict(nodes, name=name)
    nodes = {"/": xr.Dataset(attrs=_case_attrs(case, file, name))}
    leaves = {
        "static": _static_leaf(case),
        "zero_lift": _zero_lift_leaf(case),
        "downwash": _downwash_leaf(case),
        "symflp": _symflp_leaf(case),
        "ground": _ground_leaf(case),
    }
    for key, leaf in leaves.items():
        if leaf is not None:
            nodes[key] = leaf.to_dataset()
    # All numbers as written, for users who need other blocks.
    nodes["records"] = _record_leaf(case, "condition", pages)
    if "ground" in nodes:
        over_ground: list[PlotPage] = []
        for condition in case.conditions:
            over_ground += condition.ground
        nodes["ground_records"] = _record_leaf(case, "page", over_ground)
    return xr.DataTree.from_dict(nodes, name=name)


def _case_attrs(case: PlotCase, file: str, name: str) -> dict[str, str | float]:
    """Return reference quantities, positions and logicals of a case, in SI."""
    options = case.records["OPT"]
    # Positions of the parts of the aeroplane.
    record = case.records["SYNA"]
    synthesis = {word: record.number(k) for k, word in enumerate(_SYNTHESIS, 1)}
    attrs: dict[str, str | float] = {
        "S": options.number(1) * _AREA,
        "cbar": options.number(2) * FOOT,
        "b": options.number(4) * FOOT,
        "roughness": options.number(3) * FOOT,
        "x_cg": synthesis["XCG"] * FOOT,
        "z_cg": synthesis["ZCG"] * FOOT,
        "case": name,
        "file": file,
        "line": case.line,
        "moment_centre": "x_cg aft and z_cg up from the drawing datum [m]",
        "logicals": " ".join(word for word, value in case.logicals.items() if value),
    }
    for word, value in synthesis.items():
        if word in ("XCG", "ZCG", *_NO_LENGTH) or np.isnan(value):
            continue
        unit = FOOT
        if word in _ANGLES:
            unit = DEGREE
        attrs[word] = value * unit
    if case.is_cut:
        written = sum(condition.line > 0 for condition in case.conditions)
        attrs["messages"] = (
            f"line {case.line}: the file ends within this case, behind {written} of "
            f"{len(case.conditions)} flight conditions; run the program again"
        )
    return attrs


# Numbers of a column.


def _to_si(column: PrintedColumn, values: np.ndarray) -> np.ndarray:
    """Return written numbers in SI; the file is per degree whatever card DERIV states."""
    factor = 1.0
    if column.units == "deg":
        factor = DEGREE
    elif column.units in ("1/angle", "1/deg"):
        factor = 1.0 / DEGREE
    return values * factor


def _fill_constant(
    column: PrintedColumn, values: np.ndarray, flags: np.ndarray, transonic: bool
) -> None:
    """Fill a column that is constant in alpha or deflection downwards, as for the print file."""
    if not column.constant or transonic:
        return
    if len(flags) > 1 and (flags[1:] == BLANK).all():
        values[1:] = values[0]
        flags[1:] = FILLED if flags[0] == OK else flags[0]


def _stack_coefficient(
    case: PlotCase, name: str, pages: list[list[PlotPage]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a coefficient in SI and its flags (configuration, condition, page, alpha).

    `pages` holds the pages of each condition; where one is empty or has none, cells are absent.
    """
    blocks, count = real_configurations(case), len(angles_of_attack(case.flight))
    transonic = transonic_conditions(case)
    column = _COLUMNS[name]
    first = MOST_ANGLES * _STATIC.index(name)
    most = max(map(len, pages))
    value, flag = empty_cells((len(blocks), len(pages), most, count))
    for i, block in enumerate(blocks):
        for j, pages_of_condition in enumerate(pages):
            for k, page in enumerate(pages_of_condition):
                if block not in page:
                    continue
                numbers, codes = page[block].numbers(first + 1, first + count)
                _fill_constant(column, numbers, codes, transonic[j])
                value[i, j, k], flag[i, j, k] = _to_si(column, numbers), codes
    return value, flag


# Leaves.


def _static_leaf(case: PlotCase) -> LeafBuilder | None:
    """Return the coefficients in free air."""
    names = real_configurations(case)
    if not names:
        return None
    coords = {
        **condition_coords(case),
        "alpha": alpha_coord(case),
        "configuration": xr.Variable("configuration", list(names.values())),
    }
    leaf = LeafBuilder(coords)
    dims = ("configuration", "condition", "alpha")
    pages = [[condition.page] for condition in case.conditions]
    for name in _STATIC:
        value, flag = _stack_coefficient(case, name, pages)
        leaf.add(_COLUMNS[name], dims, value[:, :, 0], flag[:, :, 0])
    return leaf


def _ground_leaf(case: PlotCase) -> LeafBuilder | None:
    """Return the coefficients over ground.

    Those of the second and later deflections hold the ground effect of the deflections before.
    """
    names, heights = real_configurations(case), ground_heights(case.flight)
    pages = [condition.ground for condition in case.conditions]
    if not names or not any(pages):
        return None
    height_attrs = {"units": "m", "long_name": LONG_NAMES["ground_height"]}
    coords = {
        **condition_coords(case),
        "alpha": alpha_coord(case),
        "configuration": xr.Variable("configuration", list(names.values())),
        "ground_height": xr.Variable("ground_height", heights * FOOT, height_attrs),
    }
    leaf = LeafBuilder(coords)
    dims = ("configuration", "condition", "deflection", "ground_height", "alpha")
    # Pages over ground have height in the inner loop; only subsonic conditions have them, and the
    # last condition of a file that was cut may lack some.
    deflections = -(-max(map(len, pages)) // len(heights))
    shape = (len(names), len(pages), deflections, len(heights), len(angles_of_attack(case.flight)))
    pages = [[*written, *[{}] * (deflections * len(heights) - len(written))] for written in pages]
    for name in _STATIC:
        value, flag = _stack_coefficient(case, name, pages)
        value, flag = value.reshape(shape), flag.reshape(shape)
        later = flag[:, :, 1:]
        later[later == OK] = SUSPECT
        leaf.add(_COLUMNS[name], dims, value, flag)
    return leaf


def _zero_lift_leaf(case: PlotCase) -> LeafBuilder | None:
    """Return the drag at zero lift of each configuration."""
    names = real_configurations(case)
    if not names:
        return None
    configurations = xr.Variable("configuration", list(names.values()))
    leaf = LeafBuilder({**condition_coords(case), "configuration": configurations})
    # The record CDO has one number per configuration.
    indices = [CONFIGURATIONS.index(block) for block in names]
    values, flags = empty_cells((len(case.conditions), len(names)))
    for j, condition in enumerate(case.conditions):
        if condition.page:
            numbers, codes = condition.page["CDO"].numbers(1, len(CONFIGURATIONS))
            values[j], flags[j] = numbers[indices], codes[indices]
    leaf.add(_CD0, ("configuration", "condition"), values.T, flags.T)
    leaf["CD0"].attrs["long_name"] = "drag coefficient at zero lift"
    return leaf


def _downwash_leaf(case: PlotCase) -> LeafBuilder | None:
    """Return the downwash at the tail of a case with wing and horizontal tail."""
    if not (case.logicals["WGPL"] and case.logicals["HTPL"]):
        return None
    leaf = LeafBuilder({**condition_coords(case), "alpha": alpha_coord(case)})
    count = len(angles_of_attack(case.flight))
    for k, name in enumerate(_DOWNWASH):
        first = MOST_ANGLES * k
        value, flag = empty_cells((len(case.conditions), count))
        for j, condition in enumerate(case.conditions):
            if condition.page:
                value[j], flag[j] = condition.page["DWASH"].numbers(first + 1, first + count)
        leaf.add(_COLUMNS[name], ("condition", "alpha"), _to_si(_COLUMNS[name], value), flag)
    return leaf


def _symflp_leaf(case: PlotCase) -> LeafBuilder | None:
    """Return the control tables.

    WING(201...) holds one block of ten deflections per column, BODY(201...) holds D(CDI) with alpha
    in the inner loop.
    """
    pages = [condition.control for condition in case.conditions]
    written = [page["F"] for page in pages if page]
    if not written or not case.logicals["SYMFP"]:
        return None
    # F: 1 DELTA(10), 16 NDELTA.
    deltas = written[0].numbers(1, _MOST_DELTAS)[0][: written[0].count(16, _MOST_DELTAS - 1)]
    coords = {
        **condition_coords(case),
        "alpha": alpha_coord(case),
        "delta": xr.Variable("delta", deltas * DEGREE, {"units": "rad"}),
    }
    leaf, alphas = LeafBuilder(coords), len(angles_of_attack(case.flight))
    for k, name in enumerate(_SYMFLP):
        first = _MOST_DELTAS * k
        value, flag = empty_cells((len(pages), len(deltas)))
        for j, page in enumerate(pages):
            if page:
                numbers, codes = page["WING_CONTROL"].numbers(first + 1, first + len(deltas))
                _fill_constant(_COLUMNS[name], numbers, codes, transonic=False)
                value[j], flag[j] = numbers, codes
        leaf.add(_COLUMNS[name], ("condition", "delta"), _to_si(_COLUMNS[name], value), flag)
    value, flag = empty_cells((len(pages), len(deltas), alphas))
    for j, page in enumerate(pages):
        if page:
            numbers, codes = page["BODY_CONTROL"].numbers(1, len(deltas) * alphas)
            value[j] = numbers.reshape(len(deltas), alphas)
            flag[j] = codes.reshape(len(deltas), alphas)
    dims = ("condition", "alpha", "delta")
    leaf.add(_DCDI, dims, value.swapaxes(1, 2), flag.swapaxes(1, 2))
    leaf["dCDi"].attrs["long_name"] = "increment of the induced-drag coefficient"
    surface = "wing"
    if case.logicals["WGPL"] and case.logicals["HTPL"]:
        surface = "tail"
    return leaf.describe({}, surface=surface)


def _record_leaf(case: PlotCase, dim: str, pages: list[PlotPage]) -> xr.Dataset:
    """Return every number of the case and of some of its pages as written.

    Index 1 of the program is item 0.
    """
    leaf = LeafBuilder({dim: xr.Variable(dim, np.arange(len(pages)))})
    for name, record in case.records.items():
        index_dim = f"{name}_index"
        leaf.variables[name] = xr.Variable(index_dim, record.values)
        leaf.variables[f"{name}_flag"] = xr.Variable(index_dim, record.flags)
    names: dict[str, None] = {}
    for page in pages:
        names |= dict.fromkeys(page)
    for name in names:
        # Some conditions have no page, or no control device.
        sizes = [len(page[name].values) for page in pages if name in page]
        value, flag = empty_cells((len(pages), sizes[0]))
        for j, page in enumerate(pages):
            if name in page:
                value[j], flag[j] = page[name].values, page[name].flags
        dims = (dim, f"{name}_index")
        leaf.variables[name] = xr.Variable(dims, value)
        leaf.variables[f"{name}_flag"] = xr.Variable(dims, flag)
    units = "feet, pounds, degrees Rankine, degrees, per degree"
    return leaf.describe({}, units=units).to_dataset()
