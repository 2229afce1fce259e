"""Warnings that a database keeps: in its history and in the root attribute `NOTICES`, one a line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import pandas as pd

NOTICES = "notices"
INCOMPATIBLE = 1e-6
"""Probability of chi-squared below which fits count as incompatible with each other and with the a-priori tables."""


def notices_of(attributes: Mapping) -> list[str]:
    """Return the warnings that root attributes of a database hold."""
    return str(attributes.get(NOTICES, "")).splitlines()


def with_notices(attributes: Mapping, more: Iterable[str]) -> dict[str, str]:
    """Return the root attribute `NOTICES` with more warnings, empty if there are none; a repeated
    one is kept once.
    """
    lines = [*notices_of(attributes), *(" ".join(text.split()) for text in more)]
    return {NOTICES: "\n".join(dict.fromkeys(lines))} if lines else {}


def incompatible_fits(compatibility: pd.DataFrame) -> list[str]:
    """Return the warning on coefficients whose fits are incompatible, one line, or none.

    Parameters
    ----------
    compatibility : DataFrame
        Of a `Tabulation`: index coefficient; ``chi2 count probability inflation``.
    """
    rows = compatibility[compatibility["probability"] < INCOMPATIBLE]
    words = [
        f"{coefficient} (chi-squared {row['chi2']:.4g} of {int(row['count'])} estimates, "
        f"probability {row['probability']:.1g})"
        for coefficient, row in rows.iterrows()
    ]
    if not words:
        return []
    return [
        f"incompatible fits: {', '.join(words)}: the fits contradict each other or the "
        f"a-priori tables by more than their standard errors; "
        "look for an effect that no table holds, a faulty record, or standard errors of the "
        "tables that are too small"
    ]
