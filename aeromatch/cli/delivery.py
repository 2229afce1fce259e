"""``aeromatch package make | key | verify | diff``: the data package of a project."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import FileOrFolder, InputFile, json_option, performed_by

_PACKAGE = click.Path(exists=True, path_type=Path)
_MODEL = click.Choice(["datcom", "prior", "corrected", "final"])


@click.group()
def package() -> None:
    """Make, verify and compare data packages: models, database, aircraft, proof and check cases in
    one folder or zip.
    """


@package.command("make")
@click.argument("project", type=InputFile(path_type=Path))
@click.argument("match", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder to write, or a file ending in .zip.",
)
@click.option(
    "--recordings",
    is_flag=True,
    help="Put the flight recordings into the package; without it their SHA-256 only.",
)
@click.option("--licence", type=InputFile(path_type=Path), help="Text of the licence.")
@click.option("--revision", default="", help="Revision of the package.")
@click.option(
    "--sign",
    type=InputFile(path_type=Path),
    help="Private key that signs the package (aeromatch package key).",
)
@json_option
@performed_by("aeromatch.cli.actions.delivery:make_package")
def make_package_command() -> None:
    """Write the data package of a PROJECT file from the folder that aeromatch MATCH wrote; the same
    bytes when made again.
    """


@package.command("key")
@click.argument("path", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path))
@json_option
@performed_by("aeromatch.cli.actions.delivery:write_key")
def write_key_command() -> None:
    """Write a new private key to FILE and its public key to FILE.pub, to sign packages with."""


@package.command("verify")
@click.argument("package_file", metavar="PACKAGE", type=_PACKAGE)
@click.option(
    "--trusted-key",
    "trusted_keys",
    type=InputFile(path_type=Path, may_repeat=True),
    multiple=True,
    help="Public key of a known maker; the package must be signed by one of them.",
)
@click.option(
    "--fly-foreign",
    is_flag=True,
    help="Fly the FMU too if its code is not that of this installation.",
)
@json_option
@click.pass_context
@performed_by("aeromatch.cli.actions.delivery:run_verify_package")
def verify_package_command() -> None:
    """Verify a PACKAGE (folder or zip) in stages: structure, signature, hashes, verdicts judged
    again, check cases through every format; exit code 1 on a difference.

    Exit code 0 states that the package is consistent with itself. Who made it is proven with
    --trusted-key alone: a package without a signature by one of these keys then has exit code 1.

    A package with a changed file is not read further. Its files are read, and its models flown, in
    child processes with limits, and in a sandbox where bubblewrap is installed.
    """


@package.command("diff")
@click.argument("one", metavar="A", type=_PACKAGE)
@click.argument("other", metavar="B", type=_PACKAGE)
@click.option("--model", type=_MODEL, default="final", show_default=True, help="Model of A.")
@click.option("--against", type=_MODEL, help="Model of B.  [default: that of A]")
@json_option
@performed_by("aeromatch.cli.actions.delivery:compare_packages")
def compare_packages_command() -> None:
    """State what changed from package A to B, or between two models of one: terms, parts, cases,
    verdicts.
    """


@click.command("view")
@click.argument("project", type=FileOrFolder(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Working folder: reconstructed records, fits, match, log of the actions.  [default: "
    "workbench, next to the project file]",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port on 127.0.0.1.  [default: a free one]",
)
@click.option("--no-browser", is_flag=True, help="Print the address only.")
@performed_by("aeromatch.cli.actions.delivery:open_workbench")
def open_workbench_command() -> None:
    """Open the workbench of a PROJECT in the browser: records, identification, database, match.

    For a new project, PROJECT is a folder: files are dropped into its page and drafted there.
    It is served on this machine alone, to who has the printed address. What changes a file is a
    verb of this command line; the log actions.jsonl in the working folder is replayed by aeromatch
    match --actions.
    """
