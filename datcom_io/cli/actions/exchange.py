"""Functions that perform the commands of `datcom_io.cli.exchange`."""

from __future__ import annotations

import click
import xarray as xr

from datcom_io.arrays.frames import write_tree
from datcom_io.exchange.file_types import content_rows, plot_case, read_other
from datcom_io.exchange.matlab_write import write_matlab
from datcom_io.exchange.refining import refine
from datcom_io.reading.reader import read
from flightmech.errors import SchemaError
from flightmech.support import console


def export_listing(file: str, output: str, zero: bool, partial: bool, as_json: bool) -> None:
    """Perform the command ``export``."""
    listing = read(file, partial=partial)
    left_out = write_matlab(listing, output, usenan=not zero)
    if as_json:
        console.print_json({"file": output, "cases": listing.case_names, "left_out": left_out})
        return
    click.echo(f"written: {output}; left out:")
    for text in left_out:
        click.echo(f"  {text}")


def plot_file(file: str, listing: str | None, output: str | None, as_json: bool) -> None:
    """Perform the command ``plot``."""
    tree = read_other(file, "DEG")
    if tree is None:
        raise SchemaError(
            file,
            [
                "is not a plot file; it is written in a run with card PLOT, as for013.dat or "
                "for014.dat"
            ],
        )
    if listing is None:
        if output:
            write_tree(tree, output)
        show_tree(tree, as_json)
        return
    printed = read(listing)
    fine = printed.to_datatree()
    refined: dict[str, dict[str, dict[str, str]]] = {}
    open_cases: dict[str, str] = {}
    places = {child.attrs["case"]: name for name, child in fine.children.items()}
    for case in printed:
        written = plot_case(printed, case, tree)
        # A case without pages is in the plot file, but not in the tree.
        if written is None or case.name not in places:
            continue
        name = places[case.name]
        finer = refine(fine.children[name], written)
        fine[name], refined[name] = finer, _refined(finer)
        if not refined[name]:
            open_cases[name] = str(written.attrs.get("messages", "no table that both files have"))
    if output:
        write_tree(fine, output)
    if as_json:
        console.print_json({"file": file, "listing": listing, "output": output, "refined": refined})
        return
    rows: list[tuple[str, str, str, str]] = []
    for name, leaves in refined.items():
        for leaf, texts in leaves.items():
            rows += [(name, leaf, variable, text) for variable, text in texts.items()]
    console.print_table(["case", "leaf", "variable", "numbers"], rows)
    for name, text in open_cases.items():
        click.echo(f"{name}: nothing is refined: {text}")
    if output:
        click.echo(f"written: {output}")


def _refined(case: xr.DataTree) -> dict[str, dict[str, str]]:
    """Return leaf and variable to what `refine` states of it."""
    found: dict[str, dict[str, str]] = {}
    for leaf, node in case.children.items():
        for name, variable in node.data_vars.items():
            if "refined" in variable.attrs:
                found.setdefault(leaf, {})[str(name)] = str(variable.attrs["refined"]).partition(
                    " with "
                )[0]
    return found


def show_tree(tree: xr.DataTree, as_json: bool) -> None:
    """Print what the groups of a tree hold."""

    rows = content_rows(tree)
    if as_json:
        console.print_json({**tree.attrs, "leaves": rows})
        return
    lines = []
    for row in rows:
        sizes = " ".join(f"{name} {size}" for name, size in row["sizes"].items())
        missing = " ".join(f"{name} {count}" for name, count in row["missing"].items())
        variables = " ".join(row["variables"])
        lines.append((row["case"], row["leaf"], sizes, variables, row["numbers"], missing))
    console.print_table(
        ["case", "leaf", "sizes", "variables", "numbers", "missing"],
        lines,
        title=f"{tree.attrs.get('file')}",
        right=["numbers"],
    )
