"""Plot files: the same tables as the print file, with five significant digits instead of three
decimals.

The blocks of all eleven configurations are in the file whether they are printed or not; what is no
part of the aeroplane holds nothing or what an earlier case left there, so the logicals of the case
decide which configurations are real.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import printed_name
from datcom_io.arrays.leaves import LONG_NAMES, LeafBuilder
from datcom_io.cells import ABSENT, BLANK, FILLED, OK, SUSPECT
from datcom_io.exchange.plot_records import CONFIGURATIONS, PlotCase, PlotRecord, read_records
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from flightmech.units import DEGREE, FOOT

_COLUMNS = {
    column.quantity: column
    for name in ("static", "downwash", "symflp")
    for column in BY_NAME[name].columns
}
_STATIC = ("CD", "CL", "Cm", "CN", "CA", "CL_alpha", "Cm_alpha", "CY_beta", "Cn_beta", "Cl_beta")
_DOWNWASH = ("q_ratio", "epsilon", "epsilon_alpha")
_SYMFLP = ("dCL", "dCm", "dCLmax", "dCDmin", "CL_alpha_delta", "Ch_alpha", "Ch_delta")
_DCDI = PrintedColumn("D(CDI)", 0, 0, "dCDi")
_CD0 = PrintedColumn("CDO", 0, 0, "CD0")
_SURFACES = {
    "BO": "body",
    "WGPL": "wing",
    "HTPL": "horizontal",
    "VTPL": "vertical",
    "VFPL": "fin",
    "TVTPAN": "panels",
}
_MADE_OF = dict(
    zip(
        CONFIGURATIONS,
        (
            "body",
            "wing",
            "horizontal",
            "vertical",
            "fin",
            "body wing",
            "body horizontal",
            "body upright",
        )
        + ("body wing horizontal", "body wing upright", "body wing horizontal upright"),
    )
)
_MOST = 20  # angles of attack in a block
_MOST_DELTAS = 10
_MOST_HEIGHTS = 10
_AREA = FOOT**2
# names of SYNA in the order of the file; lengths in feet, angles in degrees
_SYNTHESIS = (
    *(
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
    ),
    *("PHIV", "PHIF"),
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
        each with its flag.  A deflection of zero is written as 0.01 deg, as the program uses it. A
        case without a static page (hypersonic flap, transverse jet) has ``records`` of its flight
        conditions alone.

    Raises
    ------
    ParseError
        The file is no plot file, or ends within a record.
    """
    file = Path(path).name
    root = xr.DataTree(xr.Dataset(attrs={"file": file}))
    for number, case in enumerate(read_records(path), 1):
        root[f"case {number}"] = _case_tree(case, file, f"case {number}")
    return root


def _case_tree(case: PlotCase, file: str, name: str) -> xr.DataTree:
    if not case.pages:
        root = xr.Dataset(
            attrs={
                "case": name,
                "file": file,
                "line": case.line,
                "messages": f"line {case.line}: no static page in this case",
            }
        )
        return xr.DataTree.from_dict(
            {"/": root, "records": _records(case, "condition", [])}, name=name
        )
    leaves = {
        "static": _static(case),
        "zero_lift": _zero_lift(case),
        "downwash": _downwash(case),
        "symflp": _symflp(case),
    }
    leaves["ground"] = _ground(case)
    root = xr.Dataset(attrs=_attrs(case, file, name))
    made = {key: leaf.to_dataset() for key, leaf in leaves.items() if leaf is not None}
    records = {"records": _records(case, "condition", _conditions(case))}
    if "ground" in made:
        over_ground = [page for pages in _by_condition(case) for page in pages[1:]]
        records["ground_records"] = _records(case, "page", over_ground)
    return xr.DataTree.from_dict({"/": root, **made, **records}, name=name)


def _attrs(case: PlotCase, file: str, name: str) -> dict[str, str | float]:
    options, place = case.records["OPT"], dict(zip(_SYNTHESIS, range(1, 20)))
    synthesis = case.records["SYNA"]
    found: dict[str, str | float] = {
        "S": options.number(1) * _AREA,
        "cbar": options.number(2) * FOOT,
        "b": options.number(4) * FOOT,
        "roughness": options.number(3) * FOOT,
        "x_cg": synthesis.number(place["XCG"]) * FOOT,
        "z_cg": synthesis.number(place["ZCG"]) * FOOT,
        "case": name,
        "file": file,
        "line": case.line,
        "moment_centre": "x_cg aft and z_cg up from the drawing datum [m]",
        "logicals": " ".join(word for word, value in case.logicals.items() if value),
    }
    for word in _SYNTHESIS:
        value = synthesis.number(place[word])
        if word not in ("XCG", "ZCG", *_NO_LENGTH) and not np.isnan(value):
            found[word] = value * (DEGREE if word in _ANGLES else FOOT)
    count = len(_conditions(case))
    if len(_schedule(case)) != count:
        found["messages"] = (
            f"line {case.line}: {count} flight conditions are written, "
            f"{len(_schedule(case))} are specified by NMACH, NALT and LOOP; "
            "Mach number and altitude are left open"
        )
    return found


def _schedule(case: PlotCase) -> list[tuple[float, float]]:
    """Return Mach number and altitude [ft] in the order of the run."""
    flight = case.records["FLC"]
    counts = [flight.number(place) for place in (1, 159)]
    machs, heights = (
        flight.numbers(first, first + _MOST - 1)[0][: int(count) if 0 < count <= _MOST else 0]
        for first, count in zip((3, 97), counts)
    )
    loop = flight.number(160)
    if not len(heights):
        heights = np.full(len(machs) if loop not in (2.0, 3.0) else 1, np.nan)
    if loop == 2.0:
        return [(mach, height) for height in heights for mach in machs]
    if loop == 3.0:
        return [(mach, height) for mach in machs for height in heights]
    return list(zip(machs, heights))


def _heights(case: PlotCase) -> np.ndarray:
    """Return the heights over ground of the case. [ft]"""
    count = case.records["FLC"].number(63)
    return case.records["FLC"].numbers(64, 73)[0][: int(count) if 0 < count <= _MOST_HEIGHTS else 0]


def _by_condition(case: PlotCase) -> list[list[dict[str, PlotRecord]]]:
    """Return the pages of each flight condition: the one in free air, then deflection by deflection
    those over ground.
    """
    heights, count = len(_heights(case)), len(_schedule(case))
    each, rest = divmod(len(case.pages), count) if heights and count else (1, 0)
    if rest or each < 1 or (heights and (each - 1) % heights):
        each = 1
    return [case.pages[k : k + each] for k in range(0, len(case.pages), each)]


def _conditions(case: PlotCase) -> list[dict[str, PlotRecord]]:
    """Return the page in free air of each flight condition."""
    return [pages[0] for pages in _by_condition(case)]


def _coords(case: PlotCase) -> dict[str, xr.Variable]:
    count, schedule = len(_conditions(case)), _schedule(case)
    pairs = np.array(
        schedule if len(schedule) == count else [(np.nan, np.nan)] * count, float
    ).reshape(count, 2)
    return {
        "condition": xr.Variable("condition", np.arange(count)),
        "mach": xr.Variable("condition", pairs[:, 0], {"units": "1"}),
        "h": xr.Variable("condition", pairs[:, 1] * FOOT, {"units": "m"}),
        "line": xr.Variable(
            "condition", np.array([condition["BODY"].line for condition in _conditions(case)], int)
        ),
    }


def _alphas(case: PlotCase) -> np.ndarray:
    """Return the angles of attack. [deg]"""
    count = case.records["FLC"].number(2)
    return case.records["FLC"].numbers(23, 42)[0][: int(count) if 0 < count <= _MOST else 0]


def _alpha_coord(case: PlotCase) -> dict[str, xr.Variable]:
    return {
        "alpha": xr.Variable(
            "alpha",
            _alphas(case) * DEGREE,
            {"units": "rad", "sign": "ANU", "long_name": "angle of attack"},
        )
    }


def _real(case: PlotCase) -> dict[str, str]:
    """Return block and printed name of the configurations that the case has."""
    surfaces = [part for word, part in _SURFACES.items() if case.logicals[word]]
    upright = " ".join(part for part in surfaces if part in ("vertical", "fin", "panels"))
    found = {}
    for block, words in _MADE_OF.items():
        made_of = frozenset(words.replace("upright", upright).split())
        if made_of <= set(surfaces) and (upright or "upright" not in words):
            found[block] = printed_name(made_of)
    return found


def _si(column: PrintedColumn, values: np.ndarray) -> np.ndarray:
    factor = (
        DEGREE
        if column.units == "deg"
        else 1.0 / DEGREE
        if column.units in ("1/angle", "1/deg")
        else 1.0
    )
    return values * factor


def _filled(column: PrintedColumn, values: np.ndarray, flags: np.ndarray, transonic: bool) -> None:
    """Fill a column that is constant in alpha or deflection downwards, as for the print file."""
    if column.constant and len(flags) > 1 and (flags[1:] == BLANK).all() and not transonic:
        values[1:], flags[1:] = values[0], FILLED if flags[0] == OK else flags[0]


def _transonic(case: PlotCase) -> list[bool]:
    flight = case.records["FLC"]
    low, high = flight.number(94), flight.number(95)
    machs = [mach for mach, _ in _schedule(case)]
    return (
        [low < mach < high for mach in machs]
        if len(machs) == len(_conditions(case))
        else [True] * len(_conditions(case))
    )


def _static(case: PlotCase) -> LeafBuilder | None:
    real = _real(case)
    if not real:
        return None
    found = LeafBuilder(
        {
            **_coords(case),
            **_alpha_coord(case),
            "configuration": xr.Variable("configuration", list(real.values())),
        }
    )
    for name in _STATIC:
        value, flag = _stacked(case, name, [pages[:1] for pages in _by_condition(case)])
        found.add(
            _COLUMNS[name], ("configuration", "condition", "alpha"), value[:, :, 0], flag[:, :, 0]
        )
    return found


def _ground(case: PlotCase) -> LeafBuilder | None:
    """Return the coefficients over ground; those of the second and later deflections hold the
    ground effect of the ones before.
    """
    real, heights = _real(case), _heights(case)
    pages = [pages[1:] for pages in _by_condition(case)]
    if not real or not pages[0]:
        return None
    coords = {
        **_coords(case),
        **_alpha_coord(case),
        "configuration": xr.Variable("configuration", list(real.values())),
    }
    coords["ground_height"] = xr.Variable(
        "ground_height", heights * FOOT, {"units": "m", "long_name": LONG_NAMES["ground_height"]}
    )
    found, alphas = LeafBuilder(coords), len(_alphas(case))
    shape = (len(real), len(pages), len(pages[0]) // len(heights), len(heights), alphas)
    for name in _STATIC:
        value, flag = (part.reshape(shape) for part in _stacked(case, name, pages))
        later = flag[:, :, 1:]
        later[later == OK] = SUSPECT
        found.add(
            _COLUMNS[name],
            ("configuration", "condition", "deflection", "ground_height", "alpha"),
            value,
            flag,
        )
    return found


def _stacked(
    case: PlotCase, name: str, pages: list[list[dict[str, PlotRecord]]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a coefficient in SI and its flags (configuration, condition, page, alpha)."""
    real, count, transonic = _real(case), len(_alphas(case)), _transonic(case)
    shape, first = (len(real), len(pages), len(pages[0]), count), _MOST * _STATIC.index(name)
    value, flag = np.empty(shape), np.empty(shape, np.uint8)
    for i, block in enumerate(real):
        for j, of_condition in enumerate(pages):
            for k, page in enumerate(of_condition):
                part_value, part_flag = page[block].numbers(first + 1, first + count)
                _filled(_COLUMNS[name], part_value, part_flag, transonic[j])
                value[i, j, k], flag[i, j, k] = _si(_COLUMNS[name], part_value), part_flag
    return value, flag


def _zero_lift(case: PlotCase) -> LeafBuilder | None:
    real = _real(case)
    if not real:
        return None
    found = LeafBuilder(
        {**_coords(case), "configuration": xr.Variable("configuration", list(real.values()))}
    )
    places = [CONFIGURATIONS.index(block) for block in real]
    parts = [condition["CDO"].numbers(1, len(CONFIGURATIONS)) for condition in _conditions(case)]
    value, flag = (np.array([part[which][places] for part in parts]).T for which in (0, 1))
    found.add(_CD0, ("configuration", "condition"), value, flag)
    found["CD0"].attrs["long_name"] = "drag coefficient at zero lift"
    return found


def _downwash(case: PlotCase) -> LeafBuilder | None:
    if not (case.logicals["WGPL"] and case.logicals["HTPL"]):
        return None
    found, count = LeafBuilder({**_coords(case), **_alpha_coord(case)}), len(_alphas(case))
    for k, name in enumerate(_DOWNWASH):
        parts = [
            condition["DWASH"].numbers(_MOST * k + 1, _MOST * k + count)
            for condition in _conditions(case)
        ]
        value, flag = (np.array([part[which] for part in parts]) for which in (0, 1))
        found.add(_COLUMNS[name], ("condition", "alpha"), _si(_COLUMNS[name], value), flag)
    return found


def _symflp(case: PlotCase) -> LeafBuilder | None:
    """Return the control tables: WING(201...) holds one block of ten deflections per column,
    BODY(201...) D(CDI) alpha by alpha.
    """
    written = [condition for condition in _conditions(case) if "F" in condition]
    if not written or not case.logicals["SYMFP"]:
        return None
    count, deltas = written[0]["F"].number(16), written[0]["F"].numbers(1, _MOST_DELTAS)[0]
    deltas = deltas[: int(count) if 0 < count < _MOST_DELTAS else 0]
    coords = {
        **_coords(case),
        **_alpha_coord(case),
        "delta": xr.Variable("delta", deltas * DEGREE, {"units": "rad"}),
    }
    found, alphas = LeafBuilder(coords), len(_alphas(case))
    shape = (len(_conditions(case)), len(deltas))
    for k, name in enumerate(_SYMFLP):
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        for j, condition in enumerate(_conditions(case)):
            if "F" in condition:
                value[j], flag[j] = condition["WING_CONTROL"].numbers(
                    _MOST_DELTAS * k + 1, _MOST_DELTAS * k + len(deltas)
                )
                _filled(_COLUMNS[name], value[j], flag[j], transonic=False)
        found.add(_COLUMNS[name], ("condition", "delta"), _si(_COLUMNS[name], value), flag)
    value, flag = np.full((*shape, alphas), np.nan), np.full((*shape, alphas), ABSENT, np.uint8)
    for j, condition in enumerate(_conditions(case)):
        if "F" in condition:
            value[j], flag[j] = (
                part.reshape(shape[1], alphas)
                for part in condition["BODY_CONTROL"].numbers(1, shape[1] * alphas)
            )
    found.add(_DCDI, ("condition", "alpha", "delta"), value.swapaxes(1, 2), flag.swapaxes(1, 2))
    found["dCDi"].attrs["long_name"] = "increment of the induced-drag coefficient"
    surface = "tail" if case.logicals["WGPL"] and case.logicals["HTPL"] else "wing"
    return found.describe({}, surface=surface)


def _records(case: PlotCase, dim: str, pages: list[dict[str, PlotRecord]]) -> xr.Dataset:
    """Return every number of the case and of some of its pages as written; index 1 of the program
    is item 0.
    """
    found = LeafBuilder({dim: xr.Variable(dim, np.arange(len(pages)))})
    for name, record in case.records.items():
        _add_record(found, name, [record], ())
    for name in dict.fromkeys(name for page in pages for name in page):
        _add_record(found, name, [page.get(name) for page in pages], (dim,))
    return found.describe(
        {}, units="feet, pounds, degrees Rankine, degrees, per degree"
    ).to_dataset()


def _add_record(
    found: LeafBuilder, name: str, records: list[PlotRecord | None], outer: tuple[str, ...]
) -> None:
    size = next(len(record.values) for record in records if record is not None)
    value, flag = (
        np.full((len(records), size), np.nan),
        np.full((len(records), size), ABSENT, np.uint8),
    )
    for j, record in enumerate(records):
        if record is not None:
            value[j], flag[j] = record.values, record.flags
    shape = (len(records), size) if outer else (size,)
    dims = (*outer, f"{name}_index")
    found.variables[name] = xr.Variable(dims, value.reshape(shape))
    found.variables[f"{name}_flag"] = xr.Variable(dims, flag.reshape(shape))
