"""The layout of every printed table, by subject; a new kind of table is one entry in one of these
modules.
"""

from __future__ import annotations

from datcom_io.printout.layouts import (
    auxiliary,
    clean,
    devices,
    diagnostics,
    fairing,
    notes,
    sections,
    special,
    tabs,
    trim,
)
from datcom_io.printout.layouts.clean import CONDITIONS
from datcom_io.printout.tables import PrintedBlock, TableLayout

_SUBJECTS = (clean, devices, tabs, trim, special, diagnostics, auxiliary, fairing, sections)

LAYOUTS: tuple[TableLayout, ...] = tuple(
    layout for subject in _SUBJECTS for layout in subject.LAYOUTS
)
BLOCKS: tuple[PrintedBlock, ...] = tuple(
    block for subject in _SUBJECTS for block in getattr(subject, "BLOCKS", ())
)
BY_HEADING = {layout.heading: layout for layout in LAYOUTS if layout.heading}
BY_NAME = {layout.name: layout for layout in (CONDITIONS, *LAYOUTS)}
NAMES = tuple(
    dict.fromkeys((*BY_NAME, *(name for block in BLOCKS for name in block.names), *notes.NAMES))
)
"""All kinds of table."""
