"""Every command of the command line agrees with the function that performs it."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from dataclasses import fields

import click
import pytest

from aeromatch.cli.command import cli


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Command]]:
    """Yield all commands below a group with their full names."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield " ".join((*path, name)), command


def target_of(command: click.Command) -> str:
    """Return ``module:function`` of a command; empty if the command performs itself."""
    callback = inspect.unwrap(command.callback, stop=lambda f: hasattr(f, "performed_by"))
    return getattr(callback, "performed_by", "")


COMMANDS = dict(commands(cli))
SEPARATE = sorted(name for name, command in COMMANDS.items() if target_of(command))


def test_commands_are_listed():
    assert len(SEPARATE) > 50
    assert {"match", "db compare", "flight fit", "pom run"} <= set(SEPARATE)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEPARATE)
def test_the_function_takes_the_parameters_of_the_command(name):
    command = COMMANDS[name]
    module, _, function = target_of(command).partition(":")
    perform = getattr(importlib.import_module(module), function)
    signature = inspect.signature(perform)
    given = [parameter.name for parameter in command.params if parameter.expose_value]
    first = next(iter(signature.parameters), "")
    collected = getattr(perform, "collected_options", {})
    # the context of click, or an object of the group
    passed = () if first in given or first in collected else (None,)
    for option_class in collected.values():
        for item in fields(option_class):
            given.remove(item.name)  # raises ValueError if the command has no such option
    # raises TypeError if they do not agree
    signature.bind(*passed, **dict.fromkeys([*given, *collected]))
