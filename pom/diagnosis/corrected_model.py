"""The corrected model: the a-priori model with the terms and parts that the cases need."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.flown_samples import with_flown_samples
from pom.diagnosis.term_swaps import swap_terms


def corrected_terms(diagnoses: Iterable[pd.DataFrame]) -> list[str]:
    """Return the terms and parts that diagnoses need, by the share that each explains alone.

    Parameters
    ----------
    diagnoses : iterable of DataFrame
        From `diagnose` or `join_diagnoses`.

    Returns
    -------
    list of str
        The largest share in any diagnosis comes first.
    """
    # Largest share of each needed term over the cases.
    largest: dict[str, float] = {}
    for table in diagnoses:
        alone = _explained_by_term(table, "single")
        for name in [*_terms_of_stage(table, "sequence"), *_terms_of_stage(table, "joint")]:
            # fmax ignores NaN, the share of a term in a case without a gap.
            share = np.fmax(largest.get(name, -np.inf), alone.get(name, 0.0))
            largest[name] = float(share)
    return sorted(largest, key=lambda name: -largest[name])


def joint_terms(diagnoses: Mapping[str, pd.DataFrame]) -> dict[str, list[str]]:
    """Return the terms added because corrections of different cases interact, by case.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `join_diagnoses`.
    """
    joint = {}
    for case, table in diagnoses.items():
        names = _terms_of_stage(table, "joint")
        if names:
            joint[case] = names
    return joint


def correction_reasons(diagnoses: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Return why the corrected model has each term or part: the cases, and what it explains there.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose` or `join_diagnoses`.
    """
    needs: dict[str, list[str]] = {}
    for case, table in diagnoses.items():
        # Share of the gap that a term explains alone, and its Shapley share if it has one.
        alone = _explained_by_term(table, "single")
        share = _explained_by_term(table, "share")
        for name in _terms_of_stage(table, "sequence"):
            # Without a gap between the models there is no share of it.
            if not np.isfinite(alone[name]):
                needs.setdefault(name, []).append(case)
                continue
            text = f"{case} (alone {100.0 * alone[name]:z.0f} % of the gap"
            if name in share:
                text += f", share {100.0 * share[name]:z.0f} %"
            needs.setdefault(name, []).append(f"{text})")
    reasons = {name: f"needed by {'; '.join(texts)}" for name, texts in needs.items()}
    # A joint term is not in the sequence of any case.
    for case, names in joint_terms(diagnoses).items():
        text = (
            f"added for {case}, which does not pass with only the terms that the cases need one "
            f"by one"
        )
        reasons |= dict.fromkeys(names, text)
    return {name: reasons[name] for name in corrected_terms(diagnoses.values())}


def _terms_of_stage(table: pd.DataFrame, stage: str) -> list[str]:
    return [name for name in table.loc[table["stage"] == stage, "term"] if name]


def _explained_by_term(table: pd.DataFrame, stage: str) -> dict[str, float]:
    rows = table[table["stage"] == stage]
    return dict(zip(rows["term"], rows["explained"], strict=True))


def corrected_database(
    prior: xr.DataTree, final: xr.DataTree, diagnoses: Mapping[str, pd.DataFrame], source: str = ""
) -> xr.DataTree:
    """Return the a-priori database with only the final terms that the cases need.

    This is the corrected model of LR-743, 5.2. The history of every replaced term states its
    source and the cases that need it.

    Parameters
    ----------
    prior, final : DataTree
        The databases that were diagnosed.
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose`.
    source : str, optional
        Name of `final` in the history; its title without it.
    """
    title = str(final.attrs.get("title", "the final database"))
    reasons = _history_lines(diagnoses, source or title)
    corrected = swap_terms(prior, final, reasons, why=reasons)
    corrected.attrs |= with_flown_samples(prior.attrs, final.attrs)
    corrected.attrs["title"] = (
        f"{prior.attrs['aircraft']}: a-priori database with the terms that the diagnosis needs"
    )
    return corrected


def corrected_aircraft(
    apriori: Aircraft, final: Aircraft, diagnoses: Mapping[str, pd.DataFrame], source: str = ""
) -> Aircraft:
    """Return the a-priori aircraft with only the final parts that the cases need.

    The history of the aircraft states the reason for every part.

    Parameters
    ----------
    apriori, final : Aircraft
        The aircraft before and after the flights.
    diagnoses, source
        As in `corrected_database`.
    """
    reasons = _history_lines(diagnoses, source or final.name)
    parts: list[str] = []
    history: list[str] = []
    if apriori.history:
        history.append(apriori.history)
    for name in different_parts(apriori, final):
        if name in reasons:
            parts.append(name)
            history.append(f"{name}: {reasons[name]}")
    if not parts:
        return apriori
    corrected = swap_parts(apriori, final, parts)
    return replace(corrected, history="\n".join(history))


def _history_lines(diagnoses: Mapping[str, pd.DataFrame], source: str) -> dict[str, str]:
    """Return the line for the history of every corrected term or part."""
    lines = {}
    for name, reason in correction_reasons(diagnoses).items():
        lines[name] = f"pom diagnose: from {source}, {reason}"
    return lines
