"""A flown case as the check of a condition sees it: signals, facts, travel of the controls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from pom.cases.case import PomCase
from pom.cases.case_facts import file_facts
from pom.cases.case_file import CONDITIONS
from pom.judging.signals import RunSignals
from pom.tolerances.bands import RowRemark
from pom.tolerances.criteria import Criterion

_ROUNDING = 1e-9  # [s] an end of an interval belongs to it


class NotChecked(Exception):
    """A condition cannot be checked; the text states what is missing.

    `is_ours`: the program has no check of it.  Otherwise record, case or aircraft lack what the
    check needs, so the case does not show the condition.
    """

    def __init__(self, reason: str, *, is_ours: bool = False):
        super().__init__(reason)
        self.is_ours = is_ours

    def remark(self, text: str, name: str) -> RowRemark:
        """Return the remark on the condition `text`: a departure unless the check is missing."""
        if self.is_ours:
            return RowRemark("not_checked", f"not checked: {text} ({self})", name)
        return RowRemark("departure", f"departure: not shown: {text} ({self})", name)


@dataclass(frozen=True)
class FlownCase:
    """What the check of a condition looks at.

    Attributes
    ----------
    case : PomCase
        With its criteria fitted to the flight.
    flight : RunSignals
        Signals of the flight inside the window of the case. [SI]
    """

    case: PomCase
    flight: RunSignals

    def channel(self, *names: str) -> np.ndarray:
        """Return the first of several channels that the record has, or that the case states
        (time,).

        Raises
        ------
        NotChecked
            The record has none of them, and the case states none. [SI]
        """
        for name in names:
            if name in self.flight:
                return np.asarray(self.flight[name], float)
        for name in names:
            # a configuration that is not recorded is stated in the case file
            if name in self.case.conditions:
                return np.full(self.flight.time.size, self.case.conditions[name])
        remedy = ""
        if any(name in CONDITIONS for name in names):
            remedy = ": record it, or state it in [conditions] of the case"
        raise NotChecked(f"the record has no {' or '.join(names)}{remedy}")

    def inside(self, start: float, stop: float) -> np.ndarray:
        """Return the samples between two instants (time,)."""
        time = self.flight.time
        return (time >= start - _ROUNDING) & (time <= stop + _ROUNDING)

    def judged(self) -> list[Criterion]:
        """Return the criteria of the table that apply."""
        return [item for item in self.case.criteria if item.applies and item.parameter]

    def fact(self, name: str) -> float:
        """Return a fact of the aircraft. [SI]

        Raises
        ------
        NotChecked
            It is not known.
        """
        value = self.case.facts.get(name)
        if value is None:
            raise NotChecked(f"{name} is not stated in [facts] of the aircraft file")
        return float(value)


def control_travel(case: PomCase, control: str) -> float:
    """Return the larger travel of a control by the aircraft file. [SI]

    Raises
    ------
    NotChecked
        The file has no limits of it.
    """
    stated = file_facts(case.aircraft)
    limits = stated.limits.get(control) if stated is not None else None
    if not isinstance(limits, list) or len(limits) != 2:
        raise NotChecked(f"the aircraft file has no limits of {control}")
    try:
        values = [parse_quantity(limit, lookup(control).units) for limit in limits]
    except AeromatchError as error:
        raise NotChecked(f"limits of {control}: {error}") from None
    return max(map(abs, values))
