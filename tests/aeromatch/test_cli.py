"""The face: help stays light, unknown commands are met with the near ones, bad input ends with exit
code 2.
"""

import importlib
import json
import os
import subprocess
import sys
import warnings

import click
import pytest
from click.testing import CliRunner

import aerodb
from aeromatch.cli.command import cli
from flightmech import terms
from flightmech.errors import SchemaError

HEAVY = {"numpy", "scipy", "pandas", "xarray", "fmpy", "pydantic", "h5py"}


def run(*arguments, cwd=None):
    code = (
        "import sys; from aeromatch.cli import main; sys.argv = ['aeromatch', *sys.argv[1:]]; "
        "main()"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=1200,
    )


def modules_after(*arguments):
    """Return the modules that a command has imported."""
    code = (
        "import sys\nfrom click.testing import CliRunner\nfrom aeromatch.cli import cli\n"
        f"done = CliRunner().invoke(cli, {list(arguments)!r})\nassert done.exit_code == 0, "
        f"done.output\nprint(*sys.modules)"
    )
    return set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_help_imports_nothing_heavy():
    assert not modules_after("--help") & HEAVY


@pytest.mark.nightly
@pytest.mark.parametrize("group", ["datcom", "db", "flight", "fmu", "pom"])
def test_group_help_imports_nothing_heavy(group):
    assert not modules_after(group, "--help") & HEAVY


@pytest.mark.nightly
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_look_at_a_database_makes_no_dataset(tmp_path, options):
    about = {
        "title": "one term",
        "aircraft": "test",
        "S": 16.9,
        "cbar": 1.667,
        "b": 10.31,
        "x_ref": -3.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
    }
    leaf = terms.make_term([0.1, 0.9], {"alpha": [0.0, 0.2]}, source="datcom")
    aerodb.save(
        aerodb.make_database({"CL/basic": leaf}, **about, force_axes="stability"),
        tmp_path / "db.nc",
    )
    assert not modules_after("db", "show", str(tmp_path / "db.nc"), *options) & {
        "xarray",
        "pandas",
        "scipy",
        "pydantic",
    }


@pytest.mark.nightly
def test_a_look_at_a_record_imports_no_package_that_it_does_not_use(tmp_path):
    (tmp_path / "flight.csv").write_text(
        "time [s],alpha [rad],q [rad/s]\n0,0.1,0\n0.1,0.2,0.1\n0.2,0.1,0.2\n"
    )
    assert not modules_after("flight", "show", str(tmp_path / "flight.csv")) & {
        "scipy",
        "dask",
        "matplotlib",
    }


@pytest.mark.nightly
def test_unknown_command_names_the_near_one():
    done = run("fligth")
    assert done.returncode == 2
    assert "did you mean 'flight'?" in done.stderr


@pytest.mark.parametrize(
    ("name", "place"),
    [("reconstruct", "flight reconstruct"), ("maneuvers", "flight manoeuvres")],
)
def test_a_verb_of_a_group_is_named_with_its_group(name, place):
    with pytest.raises(click.UsageError, match=f"it is 'aeromatch {place}'"):
        cli.main([name, "record.csv"], standalone_mode=False)


@pytest.mark.parametrize(
    "words",
    [
        ["flight", "maneuvers"],
        ["flight", "controls", "--free-maneuver", "x"],
        ["package", "make", "--license", __file__],
    ],
)
def test_american_spellings_are_those_of_the_program(words, capsys):
    cli.main([*words, "--help"], standalone_mode=False)
    assert capsys.readouterr().out.startswith("Usage: ")


@pytest.mark.parametrize(
    "option",
    [["--actions", __file__], ["--samples", "20"], ["--compare-tables"], ["--resume", "x"]],
)
def test_paths_refuses_options_that_it_would_ignore(option, tmp_path):
    project = tmp_path / "aeromatch.toml"
    project.touch()
    words = ["match", str(project), "-o", str(tmp_path / "out"), "--paths", *option]
    with pytest.raises(click.UsageError, match=f"--paths and {option[0]} exclude each other"):
        cli.main(words, standalone_mode=False)


def test_a_folder_is_needed_for_all_but_the_plan(tmp_path):
    project = tmp_path / "aeromatch.toml"
    project.touch()
    with pytest.raises(click.UsageError, match="only --plan does without it"):
        cli.main(["match", str(project)], standalone_mode=False)
    # the plan reads the project, which is empty
    with pytest.raises(SchemaError):
        cli.main(["match", str(project), "--plan"], standalone_mode=False)


def test_help_lists_every_group():
    done = run("--help")
    assert done.returncode == 0
    for name in ("datcom", "db", "flight", "fmu", "pom", "demo"):
        assert name in done.stdout


def test_a_missing_file_is_named_without_a_number(tmp_path):
    done = run("match", "none.toml", "-o", "out", cwd=tmp_path)
    assert done.returncode == 2
    assert "none.toml" in done.stderr
    assert "Errno" not in done.stderr


@pytest.mark.nightly
@pytest.mark.parametrize(
    "command",
    [
        ("db", "show", "none.nc"),
        ("match", "none.toml", "-o", "out"),
        ("datcom", "read", "none.out"),
    ],
)
def test_failures_are_json_where_results_would_be(tmp_path, command):
    done = run(*command, "--json", cwd=tmp_path)
    assert done.returncode == 2
    (error,) = json.loads(done.stdout).values()
    assert error["kind"]
    assert "none" in error["text"] or "no such" in error["text"].lower()


@pytest.mark.parametrize("given", [None, "3"])
def test_one_thread_of_the_linear_algebra_unless_the_user_states_another(monkeypatch, given):
    main_module = importlib.import_module("aeromatch.cli.command")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    seen = []
    monkeypatch.setattr(
        main_module, "cli", lambda **_: seen.append(os.environ["OPENBLAS_NUM_THREADS"]) or 0
    )
    with pytest.raises(SystemExit):
        main_module.main()
    assert seen == [given or "1"]


def test_a_warning_of_the_package_is_one_line(capsys, monkeypatch):
    import click

    from aeromatch.cli import command as cli
    from flightmech.errors import AeromatchWarning

    @click.command()
    def warned():
        warnings.simplefilter("always")
        for _ in range(2):  # a file that is read twice warns twice
            warnings.warn("look twice", AeromatchWarning, stacklevel=1)

    monkeypatch.setattr(cli, "cli", warned)
    monkeypatch.setattr(sys, "argv", ["aeromatch"])
    before = warnings.showwarning
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    assert capsys.readouterr().err == "warning: look twice\n"
    assert warnings.showwarning is before


def test_a_worker_that_joblib_replaces_is_no_message(capsys, monkeypatch):
    main_module = importlib.import_module("aeromatch.cli.command")

    def command(**_):
        warnings.warn(
            "A worker stopped while some jobs were given to the executor.",
            UserWarning,
            stacklevel=1,
        )
        warnings.warn("another matter", UserWarning, stacklevel=1)

    monkeypatch.setattr(main_module, "cli", command)
    with pytest.raises(SystemExit):
        main_module.main()
    printed = capsys.readouterr().err
    assert "another matter" in printed
    assert "A worker stopped" not in printed


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["flight", "identify", "--model", "CL = 1", "--model", "Cm = 1"], "--model"),
        (["match", "-o", "one", "project.toml", "--output", "two"], "--output"),
        (["pom", "run", "-j1", "--jobs=2"], "--jobs"),
        (["--help", "match"], ""),
        (["match", "--json", "--json", "--help"], ""),
    ],
)
def test_an_option_with_one_value_is_refused_twice(words, option):
    """Of two models only the last one would be fitted, without a word."""
    result = CliRunner().invoke(cli, words)
    if not option:
        assert result.exit_code == 0
        return
    assert result.exit_code == 2
    assert f"{option}': given 2 times, and it has one value; give it once" in result.output


def test_the_end_of_a_command_does_not_search_its_memory():
    """The search of the interpreter for cycles would take 0.6 s after a match."""
    # the last function of atexit is the one that was registered first, before the command
    code = (
        "import atexit, gc, sys\nfrom aeromatch.cli import main\n"
        "atexit.register(lambda: print('frozen', gc.get_freeze_count() > 10_000))\n"
        "sys.argv = ['aeromatch', '--version']\nmain()"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.stdout.splitlines()[-1] == "frozen True"
