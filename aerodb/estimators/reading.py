"""Outputs of other estimators, recognised by their content."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from aerodb.estimators.coefficient_set import CoefficientSet, join_sets
from aerodb.estimators.column_map import ColumnMap
from aerodb.estimators.column_tables import read_table
from aerodb.estimators.programs.avl import is_avl, read_avl
from aerodb.estimators.programs.missile_datcom import is_missile_datcom, read_missile_datcom
from aerodb.estimators.programs.tornado import is_tornado, read_tornado
from aerodb.estimators.programs.vspaero import is_vspaero, read_vspaero
from aerodb.estimators.programs.xflr5 import is_xflr5, read_xflr5
from flightmech.errors import ParseError
from flightmech.support.input_files import demand_regular, demand_size

_READERS: dict[str, tuple[Callable[[str], bool], Callable[..., CoefficientSet]]] = {
    "AVL": (is_avl, read_avl),
    "VSPAERO": (is_vspaero, read_vspaero),
    "Missile DATCOM": (is_missile_datcom, read_missile_datcom),
    "Tornado": (is_tornado, read_tornado),
    "XFLR5": (is_xflr5, read_xflr5),
}
_EXPECTED = (
    "an output of AVL (.st, .sb, .ft), VSPAERO (.stab, .polar), XFLR5 or flow5 (polar or stability "
    "log), Missile DATCOM (for006.dat) or Tornado (-Cx.mat); a text table needs a column map "
    "(--columns)"
)
# Bytes that show the program, and greatest size: outputs of thousands of conditions have some MiB.
_HEAD, _LARGEST = 65_536, 64 << 20
# Outputs and inputs of other programs, by a text in their first lines.
_OTHERS = {
    "USAF STABILITY AND CONTROL  DIGITAL DATCOM": "a listing of Digital DATCOM, which "
    "`aeromatch db build` reads",
    "xflr5": "an export of XFLR5 that is neither a polar of a plane nor a stability log",
    "NumberOfControlGroups": "a set-up file of VSPAERO",
    "Solver Case:": "a history of VSPAERO (.history)",
    " + alpha_dot)": "an unsteady run of VSPAERO (.qstab), whose numbers are sums of a rate "
    "derivative and that of its angle's rate; the .stab has the rate derivatives",
    "CFx_p ": "an unsteady run of VSPAERO (.pstab); the .stab has the rate derivatives",
    "beta_dot)": "an unsteady run of VSPAERO (.rstab), whose numbers are sums of a rate "
    "derivative and that of its angle's rate; the .stab has the rate derivatives",
    "Surface Forces (referred to Sref": "surface forces of AVL (.fn)",
    "Vortex Lattice Output -- Strip Forces": "strip forces of AVL (.fs)",
    "Vortex Lattice Output -- Surface Forces": "surface forces of AVL (.fn)",
    "Vortex Lattice Output -- Element Forces": "element forces of AVL (.fe)",
    "%Tornado exported state data": "a state of Tornado, an input",
    "%Tornado exported geometry data": "a geometry of Tornado, an input",
    "'x_np_lateral'": "a dictionary of AeroSandbox, which states neither its method, angle of "
    "attack nor reference, and whose vortex lattice turns the aeroplane about the origin of the "
    "geometry: write CL CD CY Cl Cm Cn over alpha, beta and deflections as a table",
    '"x_np_lateral"': "a dictionary of AeroSandbox as JSON, whose vortex lattice turns the "
    "aeroplane about the origin of the geometry: write CL CD CY Cl Cm Cn over alpha, beta and "
    "deflections as a table",
    ",x_np_lateral,": "a table of AeroSandbox derivatives: write CL CD CY Cl Cm Cn over alpha, "
    "beta and deflections as a table",
}


def read_estimates(paths: Iterable[str | Path], columns: ColumnMap | None = None) -> CoefficientSet:
    """Return the coefficients in outputs of one program for one aeroplane.

    Parameters
    ----------
    paths : iterable of str or Path
        Files of AVL (``.st .sb .ft``), VSPAERO (``.stab .polar``), XFLR5 or flow5, Missile DATCOM
        (``for006.dat``) or Tornado (``-Cx.mat``).
    columns : ColumnMap, optional
        The files are text tables with these columns.

    Raises
    ------
    ParseError
        A file is damaged, or the output of another program, which is named.
    SchemaError
        The files are of different programs or aeroplanes.
    """
    if columns is not None:
        return join_sets([read_table(path, columns) for path in paths])
    return join_sets([read_estimate(path) for path in paths])


def read_estimate(path: str | Path) -> CoefficientSet:
    """Return the coefficients in one output; the program is recognised by the content."""
    file = Path(path)
    demand_regular(file, _EXPECTED)
    demand_size(file, _LARGEST, _EXPECTED)
    with file.open("rb") as opened:
        text = opened.read(_HEAD).decode("utf-8", errors="replace")
    for is_output, read in _READERS.values():
        if is_output(text):
            return read(file)
    found = repr(text[:60]) if text.strip() else "an empty file"
    for mark, name in _OTHERS.items():
        if mark in text[:5000]:
            found = name
            break
    raise ParseError(str(file), 1, found, _EXPECTED)
