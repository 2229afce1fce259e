"""``aeromatch store``: what ``match`` keeps of its stages."""

from __future__ import annotations

import click

from flightmech.support.console import json_option, performed_by


@click.group("store")
def store() -> None:
    """Show or clear the store, which keeps the results of the stages of `match`.

    It lies in the user's cache, or where AEROMATCH_STORE states; AEROMATCH_STORE=off switches it
    off, AEROMATCH_STORE_LIMIT is its size.
    """


@store.command("info")
@json_option
@performed_by("aeromatch.cli.actions.store:store_info")
def store_info_command() -> None:
    """Show where the store lies and what it holds, by stage."""


@store.command("clear")
@click.option(
    "--to",
    "size",
    metavar="SIZE",
    help="Keep what was used last, up to this size, such as 500MB; without it nothing.",
)
@performed_by("aeromatch.cli.actions.store:run_clear")
def clear_command() -> None:
    """Clear the store; the next match computes what is gone."""
