"""Help texts of all commands and options stand alone: a noun phrase or a sentence, with a capital
and a period.
"""

import re

import click
import pytest

from aeromatch.cli.command import COMMANDS, cli

# first words of fragments, which need another text to be understood
FRAGMENTS = re.compile(
    r"(Also|And|As|At|By|For|From|In|Its?|Of|On|Or|Out|Than|That|The "
    r"same|Theirs?|Them|Those|To|Up|With|Without|"
    r"Are|Does|How|Is|What|When|Where|Whether|Which|Whose?|Why)\b"
)


def commands(command, context):
    """Yield path and command of everything below a command."""
    yield context.command_path, command
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            yield from commands(inner, click.Context(inner, info_name=name, parent=context))


EVERY = dict(commands(cli, click.Context(cli, info_name="aeromatch")))


def fault(text: str) -> str:
    """Return what is wrong with a help text; brackets at its end hold unit or default."""
    bare = re.sub(r"(\s*\[[^\]]*\])+$", "", text.strip())
    if not bare:
        return "no text"
    if not bare[0].isupper():
        return "does not start with a capital"
    if not bare.endswith("."):
        return "does not end with a period"
    first = FRAGMENTS.match(bare)
    return f"starts with {first.group()}" if first else ""


@pytest.mark.parametrize(
    "text",
    [
        "Of the draws.",
        "daveml: the file of the thrust.",
        "Seed of the draws",
        "",
        "Where it starts. [s]",
    ],
)
def test_fragments_are_faults(text):
    assert fault(text)


@pytest.mark.parametrize(
    "text",
    [
        "Seed of the random draws.",
        "Wall time per model and case. [s]",
        "Folder.  [default: that of FILE]",
    ],
)
def test_phrases_that_stand_alone_are_not(text):
    assert fault(text) == ""


def test_every_command_has_a_help_that_stands_alone():
    faults = {path: fault((command.help or "").split("\n\n")[0]) for path, command in EVERY.items()}
    assert len(faults) > 90
    assert {path: text for path, text in faults.items() if text} == {}
    assert {name: fault(text) for name, (_, text) in COMMANDS.items() if fault(text)} == {}


def test_every_option_has_a_help_that_stands_alone():
    options = {
        f"{path} {option.opts[0]}": option.help or ""
        for path, command in EVERY.items()
        for option in command.params
        if isinstance(option, click.Option)
    }
    assert len(options) > 500
    assert {name: text for name, text in options.items() if fault(text)} == {}
