"""A Proof-of-Match case: one row of the tolerance table, one window of one flight record, and how the model is driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from .criteria import Criterion


@dataclass(frozen=True)
class Drive:
    """How the model is driven; see the table ``[drive]`` of the case file."""

    surfaces: str = "recorded"
    engine: str = "thrust"
    trim: bool = True


@dataclass(frozen=True)
class PomCase:
    """A case, resolved: defaults filled in, criteria looked up, windows in seconds of the record's clock.

    Attributes
    ----------
    name, title, description : str
    id, standard, edition : str
        Row of the tolerance table.
    path, record, names, aircraft : str
        The case file, the flight record, its name map and the aircraft; files named in the case file are relative to it.
    window : tuple of float
        Start and end of the replay. [s]
    drive : Drive
    conditions : dict of str to float
        What the case file says against the record. [SI]
    events : dict of str to float
        Marked instants that bound windows: ``input_end``, ``change_start`` ... [s]
    features : tuple of str
        What the aircraft has or the test uses, for rows with a condition, e.g. ``reversible_controls``.
    show : tuple of str
        Further channels to show.
    criteria : tuple of Criterion
    """

    name: str
    title: str
    id: str
    standard: str
    edition: str
    path: str
    record: str
    window: tuple[float, float]
    description: str = ""
    names: str = ""
    aircraft: str = ""
    drive: Drive = Drive()
    conditions: dict[str, float] = field(default_factory=dict)
    events: dict[str, float] = field(default_factory=dict)
    features: tuple[str, ...] = ()
    show: tuple[str, ...] = ()
    criteria: tuple[Criterion, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the case as plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> PomCase:
        """Rebuild a case from `to_dict`."""
        return cls(
            **{
                **item,
                "window": (item["window"][0], item["window"][1]),
                "drive": Drive(**item["drive"]),
                "features": tuple(item["features"]),
                "show": tuple(item["show"]),
                "criteria": tuple(Criterion.from_dict(c) for c in item["criteria"]),
            }
        )
