"""The verb ``scheme`` of ``aeromatch db``."""

from __future__ import annotations

import click

from flightmech.support.console import document, json_option, table


@click.command()
@click.argument("coefficient", required=False)
@json_option
def scheme(coefficient: str | None, as_json: bool) -> None:
    """Print the build-up of LR-743, equations (1) to (11): what each term is and where it can come from."""
    from flightmech.errors import UnknownName

    from ..store.templates import scheme_table

    rows = scheme_table()
    of = rows.index.str.split("/").str[0]
    if coefficient is not None:
        if coefficient not in of:
            raise UnknownName(coefficient, dict.fromkeys(of), "coefficient")
        rows = rows[of == coefficient]
    if as_json:
        document(rows)
        return
    head = ["term", "K1", "axes", "times", "LR-743", "meaning", "from DATCOM", "identified (4.5)"]
    table(head, [[str(name), *(text or "-" for text in row)] for name, row in zip(rows.index, rows.itertuples(index=False))])
