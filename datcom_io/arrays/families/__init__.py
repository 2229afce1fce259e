"""Leaves of the tree of a case, by subject.

Each function stacks one family of tables.  It returns None where the case does not have the tables.
"""

from __future__ import annotations

from collections.abc import Callable

from datcom_io.arrays.families import (
    auxiliary,
    clean,
    devices,
    fairing,
    sections,
    special,
    tabs,
    trim,
)
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.arrays.stacking import Stacker

_SUBJECTS = (clean, devices, tabs, trim, auxiliary, fairing, sections, special)

LEAVES: dict[str, Callable[[Stacker], LeafBuilder | None]] = {}
for _subject in _SUBJECTS:
    LEAVES |= _subject.LEAVES
