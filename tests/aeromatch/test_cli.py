"""The face: help stays light, unknown commands are met with the near ones, bad input ends with exit code 2."""

import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "pandas", "xarray", "fmpy", "pydantic", "rich", "h5py"}


def run(*arguments, cwd=None):
    code = "import sys; from aeromatch.cli import main; sys.argv = ['aeromatch', *sys.argv[1:]]; main()"
    return subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=120)


def modules_after(*arguments):
    """Return the modules that a command has imported."""
    code = (
        "import sys\nfrom click.testing import CliRunner\nfrom aeromatch.cli import cli\n"
        f"done = CliRunner().invoke(cli, {list(arguments)!r})\nassert done.exit_code == 0, done.output\nprint(*sys.modules)"
    )
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_help_imports_nothing_heavy():
    assert not modules_after("--help") & HEAVY


@pytest.mark.parametrize("group", ["datcom", "db", "flight", "fmu", "pom"])
def test_group_help_imports_nothing_heavy(group):
    assert not modules_after(group, "--help") & HEAVY


def test_unknown_command_names_the_near_one():
    done = run("fligth")
    assert done.returncode == 2
    assert "did you mean 'flight'?" in done.stderr


def test_help_lists_every_group():
    done = run("--help")
    assert done.returncode == 0
    for name in ("datcom", "db", "flight", "fmu", "pom", "demo"):
        assert name in done.stdout
