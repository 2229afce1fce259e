"""The examples that come with the product, and ``aeromatch example NAME FOLDER``, which copies one."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import click

from flightmech.errors import SchemaError
from flightmech.support.console import document, json_option

EXAMPLES = {
    "c182": "light aircraft with a propeller, the one of the tutorial: CSV recordings in kt, ft, deg and lbf",
    "t37": "jet trainer: complete programme with flaps, engine, landing gear and control forces, the one of aeromatch demo",
}

INPUTS = ("README.md", "datcom", "flight")
"""What a project starts from; aircraft file, name map, project file and cases are made from it."""


def example_folder(name: str) -> Path:
    """Return the folder of an example: in the installed package, or in the checkout that is installed as editable.

    Raises
    ------
    SchemaError
        The example is in neither.
    """
    places = (Path(__file__).parent / "data" / name, Path(__file__).parents[1] / "data" / name)
    for place in places:
        if (place / "aeromatch.toml").is_file():
            return place
    raise SchemaError("example", [f"no {name} in {places[0].parent} or {places[1].parent}; install the package again"])


def copy_example(name: str, folder: Path, inputs_only: bool = False) -> list[Path]:
    """Copy an example into a new folder, all of it or nothing.

    Parameters
    ----------
    name : str
        Of `EXAMPLES`.
    folder : Path
        Does not exist, or is empty.
    inputs_only : bool
        Listings, decks, recordings and their description alone, without the files of the project.

    Returns
    -------
    list of Path
        The files, relative to `folder`.

    Raises
    ------
    SchemaError
        There is something in the folder, or the example is missing.
    """
    source = example_folder(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SchemaError("example", [f"{folder} exists and is not an empty folder; name a new one"])
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        made = Path(scratch) / name
        made.mkdir()
        for item in sorted(source.iterdir()):
            if item.name == "__pycache__" or (inputs_only and item.name not in INPUTS):
                continue
            if item.is_dir():
                shutil.copytree(item, made / item.name)
            else:
                shutil.copy(item, made / item.name)
        if folder.exists():  # and is empty; it may be the current one, which must stay
            for item in list(made.iterdir()):
                os.replace(item, folder / item.name)
        else:
            os.replace(made, folder)
    return sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file())


@click.command(epilog="  ".join(f"{name}: {text}." for name, text in EXAMPLES.items()))
@click.argument("name", type=click.Choice(list(EXAMPLES)))
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--inputs-only", is_flag=True, help="Listings and recordings alone, what a project starts from.")
@json_option
def example(name: str, folder: Path, inputs_only: bool, as_json: bool) -> None:
    """Copy an example that comes with the product into FOLDER, which is new or empty."""
    files = copy_example(name, folder, inputs_only)
    if as_json:
        document({"name": name, "folder": str(folder), "files": [file.as_posix() for file in files]})
        return
    size = sum((folder / file).stat().st_size for file in files)
    click.echo(f"written: {folder}, {len(files)} files, {size / 1e6:.1f} MB")
