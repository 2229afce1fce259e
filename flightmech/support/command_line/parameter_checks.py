"""Values of the command line that the types of click accept, and no command can use."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import click


def check_parameters(context: click.Context, values: Mapping[str, Any]) -> None:
    """Refuse numbers that are not finite, files that are given twice, and outputs over others.

    `float` and the ranges of click accept nan and inf. A record that is given twice would count
    twice, with standard errors that are too small. An output over another one or over an input,
    also over the file of ``NAME=FILE`` or ``FILE:CASE``, would lose it. Only a `NewFile` with
    `may_replace` may be the single input of its command, which it then replaces by its edited form.

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
    own: dict[str, str] = {}  # inputs that some outputs may replace
    for option in sorted(context.command.params, key=_is_output):  # inputs first
        value = values.get(option.name or "")
        number = _find_non_finite(value)
        if number is not None:
            text = f"{number} is not a number to compute with; give a finite one"
            raise click.BadParameter(text, context, option)
        is_file = isinstance(option.type, click.Path) and option.type.exists
        if _is_several(option) and not isinstance(option.type, click.Path):
            for file in _named_files(value or ()):
                taken[os.path.realpath(file)] = f"the input {file}"
        elif is_file and not _is_several(option):
            if value and os.path.isfile(value):
                own[os.path.realpath(value)] = f"the input {value!s}"
        elif is_file:
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
        elif _is_output(option) and value:
            place = os.path.realpath(value) if isinstance(value, str | os.PathLike) else ""
            others = taken if getattr(option.type, "may_replace", False) else own | taken
            if place in others:
                text = f"{value!s} is {others[place]}, too; give another name"
                raise click.BadParameter(text, context, option)
            taken |= {place: f"the output of {option.opts[-1]}"} if place else {}


def refuse_repeated_options(
    context: click.Context, command: click.Command, arguments: Sequence[str]
) -> None:
    """Refuse an option with one value that is given more than once.

    click takes the last value and drops the others: of two models only one would be fitted.

    Parameters
    ----------
    context : click.Context
        Of the group that calls the command.
    command : click.Command
        A verb, or a group of verbs, which is followed to the verb.
    arguments : sequence of str
        Of the command, as typed.

    Raises
    ------
    click.BadParameter
        The option, and what to do.
    """
    inner = command.context_class(command, info_name=command.name, parent=context)
    try:
        _, others, order = command.make_parser(inner).parse_args(list(arguments))
    except click.UsageError:
        # the command itself states this error when it reads its arguments
        return
    for option in dict.fromkeys(order):
        is_single = isinstance(option, click.Option) and not (
            option.multiple or option.is_flag or option.count
        )
        count = order.count(option)
        if is_single and count > 1:
            text = f"given {count} times, and it has one value; give it once"
            raise click.BadParameter(text, inner, option)
    if isinstance(command, click.Group) and others:
        normalise = inner.token_normalize_func or str
        verb = command.get_command(inner, normalise(others[0]))
        if verb is not None:
            refuse_repeated_options(inner, verb, others[1:])


def _find_non_finite(value: Any) -> float | None:
    """Return the first number that is nan or infinite, also in tuples of tuples."""
    if isinstance(value, tuple | list):
        found = (_find_non_finite(item) for item in value)
        return next((number for number in found if number is not None), None)
    if isinstance(value, float) and not math.isfinite(value):
        return value
    return None


def _is_output(option: click.Parameter) -> bool:
    """Return whether an option is a file or folder to write, as `NewFile` and `NewFolder` are."""
    return isinstance(option.type, click.Path) and not option.type.exists


def _named_files(values: Iterable[Any]) -> Iterator[str]:
    """Yield the files that texts name: ``FILE``, ``NAME=FILE`` or ``FILE:CASE``."""
    for value in values:
        text = str(value[0] if isinstance(value, tuple) else value)
        for part in (text, text.partition("=")[2], text.rpartition(":")[0]):
            if os.path.isfile(part):
                yield part


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
