"""Every command of the command line agrees with the function that performs it."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import click
import pytest

from aeromatch.cli import command as command_line
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


def unguarded_floats(source: str) -> Iterator[int]:
    """Yield lines of functions that take a text for a number, and nan and inf with it.

    A function that catches the ValueError of `float` reads texts; one with `isfinite` or an upper
    bound of infinity judges them.
    """
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        text = ast.unparse(function)
        if "isfinite" in text or "< math.inf" in text:
            continue
        for block in ast.walk(function):
            if isinstance(block, ast.Try) and "ValueError" in ast.unparse(block.handlers):
                nodes = [node for part in block.body for node in ast.walk(part)]
                calls = [node for node in nodes if isinstance(node, ast.Call)]
                heads = ("float(", "map(float,")
                yield from (call.lineno for call in calls if ast.unparse(call).startswith(heads))


def test_numbers_in_texts_of_the_command_line_are_finite():
    """click refuses nan and inf for its own numbers only; `finite_number` does for texts."""
    guarded = "def f(t):\n try:\n  return float(t)\n except ValueError:\n  return {}\n"
    assert list(unguarded_floats(guarded.format("0"))) == [3]
    assert list(unguarded_floats(guarded.format("math.isfinite(0)"))) == []
    root = Path(__file__).parents[1]
    found = []
    for file in root.glob("*/cli/**/*.py"):
        found += [f"{file}:{line}" for line in unguarded_floats(file.read_text())]
    assert len(list(root.glob("*/cli/**/*.py"))) > 50
    assert found == []


def test_a_lack_of_memory_is_one_line(monkeypatch, capsys):
    def allocate(**_):
        raise MemoryError("Unable to allocate 927. GiB for an array")

    monkeypatch.setattr(command_line, "cli", allocate)
    with pytest.raises(SystemExit) as end:
        command_line.main()
    assert end.value.code == 2
    text = "error: not enough memory (Unable to allocate 927. GiB for an array); give less data, or"
    assert capsys.readouterr().err.startswith(text)
