"""Recognition of the format of a database file by its content."""

from __future__ import annotations

import re
from pathlib import Path

from aerodb.exchange.tables.csv_terms import INDEX
from flightmech.errors import ParseError
from flightmech.support.input_files import demand_regular

# Bytes in which the first element of an XML file must begin. Comments and document type precede it.
HEAD = 65_536
_BEFORE = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^\[>]*(\[.*?\]\s*)?>", re.DOTALL)
_ELEMENT = re.compile(rb"<(?:[\w.-]+:)?([\w.-]+)")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_ROOTS = {b"DAVEfunc": "daveml", b"fdm_config": "jsbsim"}
_KNOWN = (
    "a database (netCDF-4), a MAT file, a JSBSim or DAVE-ML file, or a folder of CSV files "
    "with their index"
)


def recognise_own_format(path: Path) -> str:
    """Return the format of a file or folder: netcdf, matlab, jsbsim, daveml or csv.

    Raises
    ------
    ParseError
        The file has another format.
    """
    if path.is_dir():
        if (path / INDEX).is_file():
            return "csv"
        raise ParseError(str(path), 0, f"a folder without {INDEX}", _KNOWN)
    demand_regular(path, _KNOWN)
    with path.open("rb") as file:
        head = file.read(HEAD)
    # A netCDF-4 file is an HDF5 file.
    if head.startswith(b"\x89HDF\r\n\x1a\n"):
        return "netcdf"
    if head.startswith(b"MATLAB "):
        return "matlab"
    root = _root_element(head.removeprefix(_BYTE_ORDER_MARK))
    if root in _ROOTS:
        return _ROOTS[root]
    if root:
        raise ParseError(str(path), 0, f"the XML element {root.decode(errors='replace')!r}", _KNOWN)
    if path.name == INDEX:
        raise ParseError(
            str(path), 0, "the index of a folder of CSV files", "the name of the folder"
        )
    raise ParseError(str(path), 0, f"the bytes {head[:16]!r}", _KNOWN)


def _root_element(head: bytes) -> bytes:
    """Return the name of the first element of an XML text; empty if there is none."""
    position = 0
    while match := _BEFORE.match(head, position):
        position = match.end()
    element = _ELEMENT.match(head, position)
    return element[1] if element else b""
