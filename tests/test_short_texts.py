"""Texts of results at the prompt are short, `print` gives the report, and tables are tables."""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import datcom_io
import flightmech
import flighttest
import pom
from flightmech.short_text import MOST_LINES, ShortText, describe_fields
from flightmech.terms import make_term
from flighttest.remarks import TabledEstimates

ROOT = Path(__file__).parents[1]
C182 = ROOT / "data" / "c182"
PACKAGES = ("datcom_io", "aerodb", "flightmech", "flighttest", "pom")
# words of annotations of fields whose repr may have any length
LONG = ("Dataset", "DataTree", "DataFrame", "ndarray")
# classes of the inside of a package, that no call of a user returns by itself
INSIDE = {"PrintedTable", "Contact", "CoefficientOverGround", "LinearModel", "Eigenmotion"}


def public_classes():
    """Return all public dataclasses of the packages."""
    found = {}
    for stub in sorted(path for name in PACKAGES for path in (ROOT / name).rglob("__init__.pyi")):
        namespace = importlib.import_module(".".join(stub.parent.relative_to(ROOT).parts))
        for name in namespace.__all__:
            item = getattr(namespace, name)
            if isinstance(item, type) and dataclasses.is_dataclass(item):
                found[item.__name__] = item
    return found


@pytest.fixture(scope="module")
def fit():
    rng = np.random.default_rng(1)
    data = xr.Dataset(
        {"alpha": ("time", rng.normal(0.0, 0.1, 200))}, {"time": 0.02 * np.arange(200)}
    )
    data["CL"] = 0.3 + 5.0 * data["alpha"] + xr.DataArray(rng.normal(0.0, 0.01, 200), dims="time")
    return flighttest.regress(flighttest.RegressionModel.parse("CL = 1 + alpha"), data, name="one")


@pytest.mark.slow
def test_public_results_with_arrays_have_short_texts():
    """A dataclass with an array or a table prints all of it, unless it is a `ShortText`."""
    long_ones = set()
    for name, item in public_classes().items():
        texts = [str(entry.type) for entry in dataclasses.fields(item) if entry.repr]
        holds_arrays = any(word in text for word in LONG for text in texts)
        if holds_arrays and not issubclass(item, ShortText):
            long_ones.add(name)
    assert long_ones - INSIDE == set()


def test_print_of_a_fit_is_its_report(fit, capsys):
    print(fit)
    assert capsys.readouterr().out.rstrip("\n") == fit.report()
    lines = repr(fit).splitlines()
    assert lines[:2] == ["<Fit>", "one: CL = 1 + alpha"]
    assert len(lines) <= MOST_LINES


def test_estimates_are_a_table(fit):
    table = fit.to_dataframe()
    assert list(table.index) == ["1", "alpha"]
    assert table.loc["alpha", "estimate"] == fit.estimates["estimate"].sel(term="alpha").item()
    assert "covariance" not in table
    assert issubclass(flighttest.OutputError, TabledEstimates)


def test_an_aircraft_is_shown_with_units():
    text = repr(flightmech.read_aircraft(C182 / "aircraft.toml"))
    assert len(text.splitlines()) <= MOST_LINES
    assert "  S              16.1651 m2" in text
    assert "  mass           1034.19 kg" in text


def test_a_model_is_shown_by_its_inputs_and_terms():
    aircraft = flightmech.Aircraft("toy", 17.0, 1.7, 10.3, 2300.0, 10800.0, 8100.0, 15100.0)
    database = xr.DataTree.from_dict({"/CL/basic": make_term(0.3), "/CL/other": make_term(0.1)})
    model = flightmech.compile(aircraft, database)
    assert repr(model).startswith("<SimModel 'toy': ")
    assert "terms   2: CL 2>" in repr(model)
    table = model.to_dataframe()
    assert set(table["kind"]) == {"input", "output", "parameter", "state"}
    assert list(table.loc[table["name"] == "init.V", "units"]) == ["m s-1"]


def test_listings_decks_and_cases_are_shown_briefly():
    listing = datcom_io.read(C182 / "datcom" / "clean.out")
    case = pom.read_case(sorted((C182 / "cases").glob("*.toml"))[0])
    deck = datcom_io.read_deck(sorted((C182 / "datcom").glob("*.inp"))[0])
    for item in (listing, listing[0], deck, case):
        assert len(repr(item).splitlines()) <= MOST_LINES, item
        assert len(repr(item)) < 2000, item
    assert len(listing.to_dataframe()) == len(listing.cells())


@pytest.mark.nightly
def test_a_path_shows_the_beginning_of_its_report():
    record = flighttest.read(C182 / "flight" / "cruise.csv", C182 / "names.toml")
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    path = flighttest.reconstruct(record, aircraft, [("5 s", "0.25 min")], rate="50 Hz")
    lines = repr(path).splitlines()
    assert (lines[0], len(lines)) == ("<FlightPath>", MOST_LINES)
    assert lines[-1].endswith("more lines; print it for all")
    assert str(path) == path.report()
    table = path.to_dataframe()
    assert (len(table), table.index[0], table.index[-1]) == (501, 5.0, 15.0)


def test_a_result_that_cannot_report_shows_its_fields():
    @dataclasses.dataclass
    class Broken(ShortText):
        samples: np.ndarray
        table: pd.DataFrame
        name: str = "x"

        def report(self) -> str:
            raise ValueError

    text = repr(Broken(np.zeros((1000, 3)), pd.DataFrame({"a": range(100)})))
    assert text == (
        "<Broken>\n  samples  array (1000, 3)\n  table    DataFrame of 100 rows with 1: a\n"
        "  name     'x'"
    )


def test_a_result_of_many_fields_is_cut():
    names = [f"field_{k}" for k in range(60)]
    many = dataclasses.make_dataclass("Many", [(name, int, 1) for name in names])
    lines = describe_fields(many()).splitlines()
    assert (len(lines), lines[-1]) == (MOST_LINES, "... 37 more lines; read its fields for all")
