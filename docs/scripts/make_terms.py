"""Page ``terms.md``, every term that a database can hold, and what Digital DATCOM gives. The site has
the page (`make_site`); ``python docs/scripts/make_terms.py`` prints it.

The rows are those of the scheme of LR-743, `aerodb.store.templates`.
"""

from __future__ import annotations

from aerodb.store.templates import scheme_table

COLUMNS = ("axes", "regressors", "K1", "equation", "meaning", "from_datcom", "identified")
HEAD = """# Terms of a database

Every term of the scheme of LR-743 with its axes, the variables that multiply its table, its factor, the
equation of the report, what Digital DATCOM gives, and whether LR-743 (4.5) identified it in flight.
`aeromatch db scheme` prints the same. The equations: [the aerodynamic
model](../explanation/database/aero-model.md). Other names are accepted too, such as `qhat_gear`.

| term | axes | times | factor | equation | meaning | from DATCOM | identified |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""


def page() -> str:
    """Return the page."""
    rows = ""
    for name, row in scheme_table().iterrows():
        cells = [f"`{name}`", *(str(row[column]) for column in COLUMNS)]
        rows += f"| {' | '.join(cells)} |\n"
    return HEAD + rows


if __name__ == "__main__":
    print(page(), end="")
