"""Plot files against the print of the same runs: every number to the half unit of the print, every
flag.
"""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import FILLED, NA, OK, SENTINEL, SUSPECT
from flightmech.errors import ParseError, SchemaError

CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
NAMES = ("plot_dump_namelist", "save_cascade")
DEG = np.pi / 180.0
# numbers of a static page, a downwash table, a control page that both files have
COUNTED = {"plot_dump_namelist": 80 + 24 + 180, "save_cascade": 372 + 24 + 90}

pytestmark = pytest.mark.skipif(
    not CORPUS.is_dir(), reason="needs the corpus ../shared/data/datcom"
)


@pytest.fixture(scope="module")
def printed():
    import functools

    return functools.cache(
        lambda name: datcom_io.read(CORPUS / name / f"{name}.out")[-1].to_datatree()
    )


@pytest.fixture(scope="module")
def plots():
    import functools

    return functools.cache(
        lambda name: datcom_io.exchange.read_plot(CORPUS / name / f"{name}.for013")["case 1"]
    )


def test_numbers_typed_from_the_file(plots):
    case = plots("plot_dump_namelist")
    body = case["static"].sel(configuration="DATCOM BODY ALONE", condition=0)
    np.testing.assert_allclose(
        body["CD"], [7.4344e-03, 7.0001e-03, 6.9508e-03, 7.4602e-03]
    )  # line 21
    np.testing.assert_allclose(
        body["CL_alpha"], np.array([2.7593e-03, 2.6506e-03, 3.5552e-03, 5.3096e-03]) / DEG
    )  # line 31
    tail = case["static"].sel(configuration="HORIZONTAL TAIL", condition=0)
    assert tail["Cm_flag"].values.tolist() == [OK, OK, OK, NA]  # line 65
    fin = case["static"].sel(configuration="VERTICAL TAIL", condition=0)
    assert fin["CY_beta_flag"].values.tolist() == [OK, FILLED, FILLED, FILLED]  # line 95
    np.testing.assert_allclose(fin["CY_beta"], -8.6768e-03 / DEG)
    np.testing.assert_allclose(
        case["downwash"]["epsilon"][0], np.array([1.5696e-01, 1.1099, 2.1157, 3.1724]) * DEG
    )  # line 243
    assert "VENTRAL FIN" not in case["static"]["configuration"].values  # the aeroplane has none
    np.testing.assert_allclose(
        case["zero_lift"]["CD0"].sel(condition=0, configuration="DATCOM BODY ALONE"), 6.9235e-03
    )  # line 251
    assert case.attrs["x_cg"] == pytest.approx(20.669 * 0.3048, rel=1e-12)
    assert case.attrs["S"] == pytest.approx(260.49 * 0.3048**2, rel=1e-12)
    np.testing.assert_allclose(case["static"]["mach"], [0.3, 0.5])
    np.testing.assert_allclose(
        case["symflp"]["delta"][4], 0.01 * DEG
    )  # zero, as the program writes it
    assert case["records"]["FLC"].values[159] == 2.0  # LOOP
    assert case["records"].sizes["F_index"] == 138


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_finer_numbers_round_to_the_printed_ones(name, printed, plots):
    fine = datcom_io.exchange.refine(printed(name), plots(name))
    count = 0
    for leaf in ("static", "downwash", "symflp"):
        for key in plots(name)[leaf].data_vars:
            if not key.endswith("_flag"):
                count += int(fine[leaf][key].attrs["refined"].split()[0])
                assert (
                    np.isfinite(fine[leaf][key].values).sum()
                    == np.isfinite(printed(name)[leaf][key].values).sum()
                )
    # refine leaves out what does not round or differs in its flag, so the count shows that
    # everything agrees
    assert count == sum(
        int(np.isin(printed(name)[leaf][f"{key}_flag"].values, (OK, FILLED, SUSPECT)).sum())
        for leaf in ("static", "downwash", "symflp")
        for key in plots(name)[leaf].data_vars
        if not key.endswith("_flag")
    )
    assert count == COUNTED[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_flags_are_those_of_the_print(name, printed, plots):
    for leaf in ("static", "symflp"):
        page, block = printed(name)[leaf].to_dataset(), plots(name)[leaf].to_dataset()
        if leaf == "static":
            block = block.sel(configuration=page["configuration"].values.tolist())
        for key in (key for key in block.data_vars if key.endswith("_flag")):
            wanted = page[key].where(
                page[key] != SUSPECT, OK
            )  # a plot file does not state its place in the run
            np.testing.assert_array_equal(
                block[key].transpose(*page[key].dims), wanted, err_msg=f"{leaf} {key}"
            )


def test_refined_drag_and_what_is_stated_of_it(printed, plots):
    fine = datcom_io.exchange.refine(printed("plot_dump_namelist"), plots("plot_dump_namelist"))
    np.testing.assert_array_equal(
        printed("plot_dump_namelist")["static"]["CD"][0], [0.016, 0.017, 0.022, 0.031]
    )
    np.testing.assert_allclose(
        fine["static"]["CD"][0], [0.016447, 0.017497, 0.022252, 0.031432], rtol=1e-12
    )
    assert (
        fine["static"]["CD"]
        .attrs["refined"]
        .startswith("8 of 8 numbers with five significant digits from plot_dump_namelist.for013")
    )
    assert "refined" not in fine["static"]["xcp"].attrs


@pytest.mark.slow
def test_refine_refuses_another_case(printed, plots):
    with pytest.raises(
        SchemaError, match=r"mach is 0\.3 0\.5 in the print, 0\.25 in the plot file"
    ):
        datcom_io.exchange.refine(printed("plot_dump_namelist"), plots("save_cascade"))
    tree = printed("save_cascade").copy(deep=True)
    tree["static"]["CD"][0, 0, 0] += 0.001
    with pytest.raises(
        SchemaError,
        match=r"CD is 0\.008 in the print, 0\.007136 in the plot file, condition 0, alpha 0",
    ):
        datcom_io.exchange.refine(tree, plots("save_cascade"))


def test_two_cases_in_a_file(tmp_path):
    text = "".join((CORPUS / name / f"{name}.for013").read_text() for name in NAMES)
    path = tmp_path / "for013.dat"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    tree = datcom_io.exchange.read_plot(path)
    assert list(tree.children) == ["case 1", "case 2"]
    assert tree["case 1/static"].sizes["condition"] == 2
    assert tree["case 2/static"].sizes["condition"] == 1
    assert tree["case 2"].attrs["line"] == 665


def test_cut_and_foreign_files(tmp_path):
    lines = (CORPUS / "save_cascade" / "save_cascade.for013").read_text().split("\n")
    path = tmp_path / "for013.dat"
    path.write_text("\n".join(lines[:100]))
    with pytest.raises(
        ParseError, match="line 100: found the end of the file after 0 numbers of VF"
    ):
        datcom_io.exchange.read_plot(path)
    path.write_text("\n".join([*lines[:50], lines[50][:60], *lines[51:]]))
    with pytest.raises(ParseError, match="line 51: found 5 fields in a line of WING"):
        datcom_io.exchange.read_plot(path)
    path.write_text(
        "\n".join([*lines[:50], lines[50][:12] + "  rubbish   " + lines[50][24:], *lines[51:]])
    )
    with pytest.raises(ParseError, match="line 51: found 'rubbish'"):
        datcom_io.exchange.read_plot(path)
    path.write_text("no plot file\n")
    with pytest.raises(ParseError, match="a plot file"):
        datcom_io.exchange.read_plot(path)


@pytest.mark.parametrize(("name", "numbers"), [("plot_dump_namelist", 48), ("save_cascade", 217)])
def test_unit_14_agrees_with_unit_13(name, numbers, plots):
    small = datcom_io.exchange.read_for014(CORPUS / name / f"{name}.for014")[
        "case 1/static"
    ].to_dataset()
    count = 0
    for i in range(small.sizes["run"]):
        run = small.isel(run=i)
        block = (
            plots(name)["static"].to_dataset().sel(configuration=str(run["configuration"].values))
        )
        block = block.isel(condition=block["mach"].values.tolist().index(float(run["mach"])))
        for key in ("CN", "Cm", "CA", "CY_beta", "Cn_beta", "Cl_beta"):
            known = run[f"{key}_flag"].values != SENTINEL
            scale = DEG if "beta" in key else 1.0
            # half of the fifth decimal, and as much for the fifth digit of unit 13 where the number
            # is near one
            half = 0.5e-5 + np.where(np.abs(block[key].values * scale) >= 0.1, 0.5e-5, 0.0)
            assert (
                np.abs(run[key].values - block[key].values)[known] * scale
                <= half[known] * (1 + 1e-9)
            ).all(), (i, key)
            count += int(known.sum())
    assert count == numbers


def test_unit_14_zero_is_no_number(tmp_path):
    small = datcom_io.exchange.read_for014(CORPUS / "save_cascade" / "save_cascade.for014")[
        "case 1/static"
    ]
    tail = small.isel(run=2)
    assert str(tail["configuration"].values) == "HORIZONTAL TAIL"
    assert tail["Cm_flag"].values.tolist() == [
        OK,
        OK,
        SENTINEL,
        SENTINEL,
    ]  # NA in the print: written as 0.00000
    assert np.isnan(tail["Cm"].values[2:]).all()
    path = tmp_path / "for014.dat"
    path.write_text("RUN   1  4  M BODY ALONE\n   0.25000  1767058.\n")
    with pytest.raises(ParseError, match="the end of a table of 4 rows"):
        datcom_io.exchange.read_for014(path)
    path.write_text("STOP\n")
    with pytest.raises(ParseError, match="line 1: found 'STOP'"):
        datcom_io.exchange.read_for014(path)


def test_every_record_against_the_dump():
    """The same run with DUMP CASE prints the common blocks themselves, six digits each: the plot
    file has them rounded to five.
    """
    blocks: dict[str, list[dict[str, float]]] = {}
    for _, group in datcom_io.read(CORPUS / NAMES[0] / f"{NAMES[0]}.out")[0].values("dump"):
        for label, value in zip(group.labels, group.values.tolist()):
            name, place = label.rstrip(")").split("(")
            found = blocks.setdefault(name, [])
            if not found or place.strip() in found[-1]:
                found.append({})
            found[-1][place.strip()] = value
    records = datcom_io.exchange.read_plot(CORPUS / NAMES[0] / f"{NAMES[0]}.for013")[
        "case 1/records"
    ]
    count = 0

    def compare(values, block, places):
        nonlocal count
        dumped = np.array([block[str(place)] for place in places])
        half = 0.5 * 10.0 ** (np.floor(np.log10(np.maximum(np.abs(dumped), 1e-45))) - 4)
        assert (
            np.abs(values - dumped) <= 1.1 * half
        ).all()  # a tenth for the sixth digit of the dump
        count += len(values)

    compare(records["SYNA"].values, blocks["SYNA"][0], range(1, 20))
    compare(records["OPT"].values, blocks["OPTI"][0], range(1, 5))
    early = [
        place for place in range(1, 161) if place not in (43, 137)
    ]  # Reynolds number and velocity are not yet set
    compare(records["FLC"].values[[place - 1 for place in early]], blocks["FLC"][0], early)
    for k in range(2):
        compare(records["F"].values[k], blocks["F"][k], range(1, 139))
        compare(records["DWASH"].values[k], blocks["DWSH"][k], range(1, 61))
        for name in ("BODY", "WING", "HT", "VT", "BW", "BH", "BV", "BWH", "BWV", "BWHV"):
            every = (
                2 if name in ("BODY", "WING") else 1
            )  # these two are printed again with the control tables in them
            compare(records[name].values[k], blocks[name][every * k], range(1, 201))
        for name in ("BODY", "WING"):
            compare(records[f"{name}_CONTROL"].values[k], blocks[name][2 * k + 1], range(1, 201))
    assert count == 19 + 4 + 158 + 2 * (138 + 60 + 10 * 200 + 2 * 200)
