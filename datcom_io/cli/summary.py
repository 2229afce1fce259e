"""What a listing holds, at a glance."""

from __future__ import annotations

from collections import Counter
from itertools import chain
from typing import Any

import numpy as np

from datcom_io.cells import FLAGS, OK, SUSPECT
from datcom_io.listing import Case, Listing
from datcom_io.printout.content import Page


def case_summary_rows(listing: Listing) -> list[dict[str, Any]]:
    """Return one dict per case, of plain numbers and texts as printed.

    Keys: ``case ordinal run line dim deriv mach altitude alpha pages tables not_read missing
    suspect messages``.  ``mach`` and ``altitude`` are the printed values in order, ``alpha`` the
    smallest and largest [deg]; ``tables`` counts tables and groups of ``label = value`` by kind,
    ``not_read`` pages by kind on which nothing was understood, ``missing`` cells without a number
    by flag, ``suspect`` the number of cells that a fault of the program makes wrong.
    """
    return [_case(case) for case in listing]


def _case(case: Case) -> dict[str, Any]:
    printed = list(chain.from_iterable(page.printed for page in case.pages))
    flags: Counter[str] = Counter()
    for item in printed:
        flags.update(
            {
                FLAGS[code]: count
                for code, count in enumerate(np.bincount(item.flags.ravel()))
                if count and code != OK
            }
        )
    suspect = flags.pop(FLAGS[SUSPECT], 0)
    tables = list(chain.from_iterable(page.tables for page in case.pages))
    alphas: list[float] = []
    for table in tables:
        if table.columns[0].quantity == "alpha":
            alphas += table.values[:, 0].tolist()
    return {
        "case": case.name,
        "ordinal": case.ordinal,
        "run": case.run,
        "line": case.line,
        "dim": case.deck.dim,
        "deriv": case.deck.deriv,
        "mach": _printed(case, "mach"),
        "altitude": _printed(case, "h"),
        "alpha": [min(alphas), max(alphas)] if alphas else [],
        "pages": len(case.pages),
        "tables": dict(Counter(item.name for item in printed)),
        "not_read": dict(Counter(page.kind for page in case.pages if not page.parsed)),
        "missing": {name: int(count) for name, count in flags.items()},
        "suspect": int(suspect),
        "messages": [message._asdict() for message in case.messages],
    }


def _printed(case: Case, name: str) -> list[float]:
    values = dict.fromkeys(
        page.condition(name) for page in case.pages if page.conditions is not None
    )
    return [x for x in values if x == x]


def page_row(page: Page) -> dict[str, Any]:
    """Return the heading of a page as a dict: ``kind configuration mach altitude ground_height flap
    power tables lines``.
    """
    return {
        "kind": page.kind if page.parsed else f"{page.kind} (not read)",
        "configuration": page.configuration or " / ".join(page.heading[:1]),
        "mach": page.condition("mach"),
        "altitude": page.condition("h"),
        "ground_height": page.ground_height,
        "flap": page.flap,
        "power": page.power,
        "tables": [item.name for item in page.printed],
        "lines": f"{page.first}-{page.last}",
    }
