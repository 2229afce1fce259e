"""Import of a propeller file of JSBSim, ``<propeller>``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.propulsion.elements import (
    INERTIAS,
    LENGTHS,
    PLAIN,
    find_table,
    is_plane,
    need_table,
    read_line_table,
    read_plane_table,
    read_value,
)
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.terms import make_term
from flightmech.units import DEGREE, INCH

_RPM = 2.0 * np.pi / 60.0  # [rad s-1]
# The governor of JSBSim turns the blades by 1 deg/s per rpm of error, without a limit.
_GAIN, _RATE = DEGREE / _RPM, 1.0
_LARGEST = 10.0  # diameter of a propeller [m]


def import_jsbsim_propeller(
    path: str | Path, *, rotation: int = 1, p_factor: float = 0.0, engine_rpm: float = 0.0
) -> tuple[Propeller, list[str]]:
    """Read a propeller file of JSBSim.

    Parameters
    ----------
    path : path
        File with ``<propeller>``.
    rotation : int
        ``<sense>`` of the thruster: 1 clockwise seen from behind, -1 the other way.
    p_factor : float
        ``<p_factor>`` of the thruster, the shift of the thrust per angle of the inflow. [m rad-1]
    engine_rpm : float
        Rated speed of the engine, for a propeller without ``<maxrpm>``. [rad s-1]

    Returns
    -------
    propeller : Propeller
        Without what turns it: the engine adds its tables.  Tables that begin above J 0 continue to
        0 with their first values, as JSBSim does.  ``CM_prop`` is CT p_factor / D.
    remarks : list of str
        What is not read or differs from JSBSim.

    Raises
    ------
    ParseError
        The file is not a propeller file, or a number or table is missing or without meaning.
    SchemaError
        The tables leave advance ratios that flight reaches.
    """
    root = read_xml(path)
    if root.tag != "propeller":
        raise root.error(f"<{root.tag}>", "a propeller file of JSBSim, <propeller>")
    diameter = read_value(root, "diameter", LENGTHS)
    if diameter > _LARGEST:
        raise root.need("diameter").error(
            f"a diameter of {diameter:.4g} m, because JSBSim takes a number without a unit in feet",
            'the unit of the diameter, such as unit="IN"',
        )
    low, high = (read_value(root, f"{end}pitch", PLAIN, default=0.0) for end in ("min", "max"))
    turns = low != high
    tables = {
        "CT_prop": _read_coefficient(root, "C_THRUST", "ct_factor", mach="CT_MACH"),
        "CP_prop": _read_coefficient(root, "C_POWER", "cp_factor", mach="CP_MACH"),
    }
    for name in ("CT_prop", "CP_prop"):
        if turns and "blade_angle" not in tables[name].dims:
            raise root.error(
                "tables over J alone with minpitch and maxpitch that differ",
                "tables over J and the blade angle, or equal pitches",
            )
    if p_factor:
        shift = tables["CT_prop"].copy()
        shift["value"] = shift["value"] * (p_factor / diameter)
        tables["CM_prop"] = shift
    rated = read_value(root, "maxrpm", PLAIN, default=0.0) * _RPM or engine_rpm
    if not rated > 0.0:
        raise root.error("no <maxrpm> and no rated speed of an engine", "one of them")
    constant_speed = read_value(
        root, "constspeed", PLAIN, default=float(bool(root.first("maxrpm")))
    )
    propeller = Propeller(
        tables,
        diameter=diameter,
        inertia=read_value(root, "ixx", INERTIAS),
        rpm_high=rated,
        rpm_low=read_value(root, "minrpm", PLAIN, default=0.0) * _RPM,
        rotation=rotation,
        gear_ratio=read_value(root, "gearratio", PLAIN, default=1.0),
        low_pitch=low * DEGREE,
        high_pitch=high * DEGREE if turns else None,
        pitch_rate=_RATE,
        governor_gain=_GAIN,
        governed=turns and constant_speed != 0.0,
    )
    return propeller, list(_list_differences(root, propeller, p_factor))


def _list_differences(root: Element, propeller: Propeller, p_factor: float) -> list[str]:
    remarks = []
    if propeller.governed:
        remarks.append(f"the blades turn by at most {_RATE:g} rad/s, in JSBSim at any rate")
        remarks.append("feathering is not read; add feather_pitch and feather_rate")
    if root.first("reversepitch") is not None:
        remarks.append("<reversepitch> is not read; add a table low_stop over throttle")
    if p_factor:
        remarks.append("the P-factor is that of the free stream, in JSBSim that of the slipstream")
    if not _has_true_gyroscopic_moment(root):
        remarks.append(
            "the gyroscopic moment has the opposite sign in JSBSim, because the propeller file "
            'lacks version="1.1"; here it is -omega x H'
        )
    power = propeller.tables["CP_prop"]["value"].values
    if not (power < 0.0).any():
        remarks.append("C_POWER is never negative: the failed engine does not windmill")
    return remarks


def _has_true_gyroscopic_moment(root: Element) -> bool:
    """Return whether JSBSim applies -omega x H: for versions of the propeller file above 1.0."""
    try:
        return float(root.attributes.get("version", "nan")) > 1.0
    except ValueError:
        return False


def _read_coefficient(root: Element, name: str, factor: str, *, mach: str) -> xr.Dataset:
    """Return a coefficient as a term, with its factor over the Mach number of the tips."""
    table = need_table(root, name)
    scale = read_value(root, factor, PLAIN, default=1.0)
    if is_plane(table):
        ratios, angles, values = read_plane_table(table)
        axes = {"J": ratios, "blade_angle": angles * DEGREE}
    else:
        ratios, values = read_line_table(table)
        axes = {"J": ratios}
    if ratios[0] > 0.0:
        axes["J"] = np.concatenate([[0.0], ratios])
        values = np.concatenate([values[:1], values])
    K1 = None
    element = find_table(root, mach)
    if element is not None:
        points, factors = read_line_table(element)
        K1 = xr.DataArray(factors, {"tip_mach": points}, ("tip_mach",))
    return make_term(scale * values, axes, K1=K1, references=Path(root.file).name)


def shift_of_inches(inches: float) -> float:
    """Return ``<p_factor>`` in metres per radian; JSBSim adds it to a place in inches."""
    return inches * INCH
