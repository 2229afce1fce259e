"""Page ``terms.md``, every term that a database can hold, what Digital DATCOM gives, and the
a-priori standard errors. The site has the page (`make_site`); ``python docs/scripts/make_terms.py``
prints it.

The rows are those of the scheme of LR-743, `aerodb.store.templates`, and of
`aerodb.prior.prior_errors`.
"""

from __future__ import annotations

from aerodb.prior.prior_errors import PRIOR_ERRORS, REGIME_FACTORS, method_class
from aerodb.store.templates import scheme_table

COLUMNS = ("axes", "regressors", "K1", "equation", "meaning", "from_datcom", "identified")
HEAD = """# Terms of a database

Every term of the scheme of LR-743 with its axes, the variables that multiply its table, its factor,
the equation of the report, what Digital DATCOM gives, and whether LR-743 (4.5) identified it in
flight. `aeromatch db scheme` prints the same. The equations: [the aerodynamic
model](../explanation/database/aero-model.md). Other names are accepted too, such as `qhat_gear`.

| term | axes | times | factor | equation | meaning | from DATCOM | identified |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""
ERRORS = """
## Standard errors before flight

Relative and absolute part in the subsonic regime, and the factor beyond it. `prior_errors.py` marks
the figures that come from the identification guide; all others are engineering judgement
([from DATCOM listings](../explanation/database/from-datcom.md#standard-errors)).

| term | relative | absolute | transonic | supersonic |
| --- | --- | --- | --- | --- |
"""


def page() -> str:
    """Return the page."""
    rows = ""
    for name, row in scheme_table().iterrows():
        cells = [f"`{name}`", *(str(row[column]) for column in COLUMNS)]
        rows += f"| {' | '.join(cells)} |\n"
    return HEAD + rows + ERRORS + "".join(_error_row(name) for name in PRIOR_ERRORS)


def _error_row(name: str) -> str:
    relative, absolute = PRIOR_ERRORS[name]
    transonic, supersonic = REGIME_FACTORS[method_class(name)]
    return f"| `{name}` | {relative:.0%} | {absolute:g} | x {transonic:g} | x {supersonic:g} |\n"


if __name__ == "__main__":
    print(page(), end="")
