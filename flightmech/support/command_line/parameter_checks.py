"""Values of the command line that the types of click accept, and no command can use."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import click


def check_parameters(context: click.Context, values: Mapping[str, Any]) -> None:
    """Refuse numbers that are not finite, files that are given twice, and outputs over others.

    `float` and the ranges of click accept nan and inf. A record that is given twice would count
    twice, with standard errors that are too small. An output over another one, or over a file of
    an argument or option that takes several, would lose it. The file of an option or argument
    that takes one may be replaced by its edited form.

    Parameters
    ----------
    context : click.Context
        Of the command.
    values : mapping
        Parameters of the command by name.

    Raises
    ------
    click.BadParameter
        The parameter, what came, and what to do.
    """
    taken: dict[str, str] = {}
    # inputs first
    for option in sorted(context.command.params, key=lambda option: not _is_several(option)):
        value = values.get(option.name or "")
        number = _find_non_finite(value)
        if number is not None:
            text = f"{number} is not a number to compute with; give a finite one"
            raise click.BadParameter(text, context, option)
        is_file = isinstance(option.type, click.Path) and option.type.exists
        if is_file and _is_several(option):
            files = tuple(value or ())
            may_repeat = getattr(option.type, "may_repeat", False)
            file = "" if may_repeat else _find_repeated(files, taken)
            if file:
                text = f"{file!r} is given twice; give each file once"
                raise click.BadParameter(text, context, option)
            for item in files:
                # the folder of an option may also be that of the result: init mine --records mine
                if option.nargs == -1 or os.path.isfile(item):
                    taken[os.path.realpath(item)] = f"the input {item}"
        elif isinstance(option.type, click.Path) and not option.type.exists and value:
            # an output, as `NewFile` and `NewFolder` are
            place = os.path.realpath(value) if isinstance(value, str | os.PathLike) else ""
            if place in taken:
                text = f"{value!s} is {taken[place]}, too; give another name"
                raise click.BadParameter(text, context, option)
            taken |= {place: f"the output of {option.opts[-1]}"} if place else {}


def _find_non_finite(value: Any) -> float | None:
    """Return the first number that is nan or infinite, also in tuples of tuples."""
    if isinstance(value, tuple | list):
        found = (_find_non_finite(item) for item in value)
        return next((number for number in found if number is not None), None)
    if isinstance(value, float) and not math.isfinite(value):
        return value
    return None


def _is_several(option: click.Parameter) -> bool:
    """Return whether an argument or option takes any number of values."""
    return option.nargs == -1 or bool(getattr(option, "multiple", False))


def _find_repeated(files: tuple[Any, ...], taken: Iterable[str]) -> str:
    """Return the first file that was given before, also by another name, or an empty text."""
    given = {_identity(file) for file in taken}
    for file in files:
        identity = _identity(file)
        if identity in given:
            return str(file)
        given.add(identity)
    return ""


def _identity(file: str | os.PathLike[str]) -> tuple[int, int]:
    """Return device and number of a file, which all its names share."""
    status = os.stat(file)
    return status.st_dev, status.st_ino
