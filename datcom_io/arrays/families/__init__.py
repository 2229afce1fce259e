"""The leaves of a case's tree, by subject: each function stacks one family of tables, or returns
None where the case has none.
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
from datcom_io.arrays.stacking import LeafBuilder, Stacker

_SUBJECTS = (clean, devices, tabs, trim, auxiliary, fairing, sections, special)

LEAVES: dict[str, Callable[[Stacker], LeafBuilder | None]] = {
    name: make for subject in _SUBJECTS for name, make in subject.LEAVES.items()
}
