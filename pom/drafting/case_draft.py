"""A case before it is written to a file."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Draft:
    """What goes into a new case file, and what its author has to know.

    Attributes
    ----------
    case : dict
        Table ``[case]``: key to value.
    drive : dict
        Table ``[drive]``.
    conditions : dict of str to str
        Values with units.
    events : dict of str to (time [s], whether it was found)
    remarks : list of str
        What the record does not show.
    """

    case: dict[str, object]
    drive: dict[str, object]
    conditions: dict[str, str] = field(default_factory=dict)
    events: dict[str, tuple[float, bool]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
