"""Actions of the verb that copies an example."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import click

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import folder_written_atomically
from flightmech.support.console import (
    print_json,
)

INPUTS = ("README.md", "datcom", "flight")


def example_folder(name: str) -> Path:
    """Return the folder of an example: in the installed package, or in the checkout that is
    installed as editable.

    Raises
    ------
    SchemaError
        The example is in neither.
    """
    places = (Path(__file__).parents[2] / "data" / name, Path(__file__).parents[3] / "data" / name)
    for place in places:
        if (place / "aeromatch.toml").is_file():
            return place
    raise SchemaError(
        "example",
        [f"no {name} in {places[0].parent} or {places[1].parent}; install the package again"],
    )


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
        raise SchemaError(
            "example", [f"{folder} exists and is not an empty folder; name a new one"]
        )
    folder.parent.mkdir(parents=True, exist_ok=True)
    if folder.exists() and folder.resolve() in (Path.cwd(), *Path.cwd().parents):
        # the current folder must stay
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            made = Path(scratch)
            _copy_items(source, made, inputs_only)
            for item in list(made.iterdir()):
                os.replace(item, folder / item.name)
    else:
        with folder_written_atomically(folder) as made:
            _copy_items(source, made, inputs_only)
    return sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file())


def _copy_items(source: Path, folder: Path, inputs_only: bool) -> None:
    """Copy the files of an example into a folder."""
    for item in sorted(source.iterdir()):
        if item.name == "__pycache__" or (inputs_only and item.name not in INPUTS):
            continue
        if item.is_dir():
            shutil.copytree(item, folder / item.name)
        else:
            shutil.copy(item, folder / item.name)


def run_example(name: str, folder: Path, inputs_only: bool, as_json: bool) -> None:
    """Perform the command ``example``."""
    files = copy_example(name, folder, inputs_only)
    if as_json:
        print_json(
            {"name": name, "folder": str(folder), "files": [file.as_posix() for file in files]}
        )
        return
    size = sum((folder / file).stat().st_size for file in files)
    click.echo(f"written: {folder}, {len(files)} files, {size / 1e6:.1f} MB")
