"""Layouts of all printed tables, by subject.

A new kind of table is one entry in one of these modules.
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
from datcom_io.printout.layouts.clean import CONDITIONS as CONDITIONS
from datcom_io.printout.tables import PrintedBlock, TableLayout

_SUBJECTS = (clean, devices, tabs, trim, special, diagnostics, auxiliary, fairing, sections)


def _collect() -> tuple[tuple[TableLayout, ...], tuple[PrintedBlock, ...]]:
    """Return the layouts and blocks of all subjects, in their order."""
    layouts: list[TableLayout] = []
    blocks: list[PrintedBlock] = []
    for subject in _SUBJECTS:
        layouts += subject.LAYOUTS
        blocks += getattr(subject, "BLOCKS", ())
    return tuple(layouts), tuple(blocks)


def _kind_names() -> tuple[str, ...]:
    """Return the names of all kinds of tables and groups, each once."""
    names = [*BY_NAME]
    for block in BLOCKS:
        names += block.names
    return tuple(dict.fromkeys([*names, *notes.NAMES]))


LAYOUTS, BLOCKS = _collect()
BY_HEADING = {layout.heading: layout for layout in LAYOUTS if layout.heading}
BY_NAME = {layout.name: layout for layout in (CONDITIONS, *LAYOUTS)}
NAMES = _kind_names()
"""All kinds of table."""
