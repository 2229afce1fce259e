"""Random decks: checker, program and reader agree on what runs and what does not."""

import importlib.util
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.decks.deck_file import deck_text

DECKS = 300
REFUSED = ("EXECUTION TERMINATING", "THIS CASE ABORTED", "THIS CASE NOT RUN")


def _random_deck():
    spec = importlib.util.spec_from_file_location(
        "random_decks", Path(__file__).parent / "random_decks.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.random_deck


def is_computed(listing):
    """Whether the program took the deck and printed a row of static coefficients."""
    refused = any(
        words in message.text for case in listing for message in case.messages for words in REFUSED
    )
    tables = [table for case in listing for _, table in case.tables("static")]
    rows = [
        np.isfinite(table.values[:, 0]) & np.isfinite(table.values[:, 1:]).any(axis=1)
        for table in tables
    ]
    return not refused and any(row.any() for row in rows)


@pytest.mark.slow
@pytest.mark.nightly
def test_checker_program_and_reader_agree(program, tmp_path):
    """An error of the checker is a deck that gives no numbers; all that is printed is read, and the
    echoed cards are those of the deck.
    """
    random_deck, counts, differing = _random_deck(), Counter(), []
    for seed in range(DECKS):
        text, flaw = random_deck(seed)
        path = tmp_path / f"{seed}.inp"
        path.write_text(text)
        errors = [
            finding.text for finding in datcom_io.check_deck(path) if finding.severity == "error"
        ]
        run = datcom_io.run_deck(path, program)
        listing, computed = run.listing, is_computed(run.listing)
        if bool(errors) == computed:
            differing.append(
                (
                    seed,
                    flaw,
                    errors,
                    [message.text for case in listing for message in case.messages],
                )
            )
        if computed:
            assert listing.unread == [], seed
            tree = listing[0].to_datatree()
            assert tree.children, seed
            if "for013" in run.files:
                datcom_io.exchange.refine(
                    tree, datcom_io.exchange.read_plot(run.files["for013"])["case 1"]
                )
            assert len(listing.cells()), seed
            assert listing[0].deck.meaning() == datcom_io.read_deck(path)[0].meaning(), seed
        counts[flaw, computed] += 1
    assert differing == []
    assert sum(count for (_, computed), count in counts.items() if computed) > DECKS / 2
    assert sum(count for (_, computed), count in counts.items() if not computed) > DECKS / 6


@pytest.mark.slow
@pytest.mark.nightly
def test_a_deck_that_is_written_gives_the_same_tables(program, tmp_path):
    """Write what was read, run both: every printed cell is the same."""
    random_deck, compared = _random_deck(), 0
    for seed in range(1000, 1040):
        (tmp_path / f"{seed}.inp").write_text(random_deck(seed)[0])
        deck = datcom_io.read_deck(tmp_path / f"{seed}.inp")
        if [finding for finding in datcom_io.check_deck(deck) if finding.severity == "error"]:
            continue
        (tmp_path / f"{seed}w.inp").write_text(deck_text(deck))
        ours, written = (
            datcom_io.run_deck(tmp_path / f"{seed}{end}.inp", program).listing for end in ("", "w")
        )
        assert ours.cells().drop(columns="line").equals(written.cells().drop(columns="line")), seed
        compared += 1
    assert compared > 15
