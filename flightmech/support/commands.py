"""Commands that are declared without loading the code that performs them.

A module of the command line declares the arguments and options of its commands.  The functions that
perform the commands are in another module, which imports NumPy, xarray and the packages.  That
module is imported when the command is called, so that ``--help`` needs neither of them.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

import click


def find_command(module: ModuleType, name: str) -> click.Command:
    """Return the command or group of a module that has a given name on the command line.

    Raises
    ------
    LookupError
        The module does not define a command of that name.
    """
    for value in vars(module).values():
        if isinstance(value, click.Command) and value.name == name:
            return value
    raise LookupError(f"{module.__name__} does not define the command {name!r}")


def performed_by(target: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """Return a decorator that has a command performed by a function of another module.

    Parameters
    ----------
    target : str
        ``package.module:function``.  The function takes the parameters of the command by name, and
        the context of click first if the command passes it.

    Notes
    -----
    The decorated function has the name and the help of the command; its body is not called.
    """
    module, _, function = target.partition(":")

    def decorate(declaration: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(declaration)
        def perform(*context: click.Context, **options: Any) -> Any:
            return getattr(importlib.import_module(module), function)(*context, **options)

        vars(perform)["performed_by"] = target
        return perform

    return decorate
