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

    from ..store.templates import scheme_texts

    rows = scheme_texts()
    if coefficient is not None:
        known = dict.fromkeys(name.split("/")[0] for name in rows)
        if coefficient not in known:
            raise UnknownName(coefficient, known, "coefficient")
        rows = {name: row for name, row in rows.items() if name.split("/")[0] == coefficient}
    if as_json:
        document([{"term": name, **row} for name, row in rows.items()])
        return
    head = ["term", "K1", "axes", "times", "LR-743", "meaning", "from DATCOM", "identified (4.5)"]
    table(head, [[name, *(text or "-" for text in row.values())] for name, row in rows.items()])
