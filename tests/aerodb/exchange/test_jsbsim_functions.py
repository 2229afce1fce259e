"""Functions of JSBSim files one by one: units, signs, sums, products, sampling, the polar."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import aerodb
from flightmech.errors import AeromatchWarning, ParseError, SchemaError
from flightmech.terms import make_term
from flightmech.units import DEGREE, FOOT, INCH

HERE = Path(__file__).parent


def loaded(name):
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


writing = loaded("test_jsbsim_write")
S, CBAR, B = 200.0, 5.0, 30.0  # ft2, ft, ft
METRICS = f"""<metrics><wingarea unit="FT2">{S}</wingarea><wingspan unit="FT">{B}</wingspan>
<chord unit="FT">{CBAR}</chord>
<htailarea unit="FT2">40</htailarea><location name="AERORP" unit="IN"><x>100</x><y>2</y><z>-5</z>
</location></metrics>"""
FORCE = "<property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>"
LINE = "<table><independentVar>{}</independentVar><tableData>\n0 1\n1 3\n</tableData></table>"
ALPHA = LINE.format("aero/alpha-rad")


def file(folder, body, more="", metrics=METRICS):
    path = folder / "some.xml"
    path.write_text(
        f"<fdm_config name='some'>{metrics}<aerodynamics>{more}{body}</aerodynamics></fdm_config>"
    )
    return path


def lift(folder, *parts, more="", name="aero/coefficient/CLx", **options):
    """Return the database of one lift function, a product of dynamic pressure, area and `parts`."""
    body = (
        f"<axis name='LIFT'><function "
        f"name='{name}'><product>{FORCE}{''.join(parts)}</product></function></axis>"
    )
    return aerodb.exchange.import_jsbsim(file(folder, body, more), **options)


def prop(name):
    return f"<property>{name}</property>"


def value(db, **conditions):
    return float(aerodb.evaluate(db, "CL", outside="clamp", **conditions))


def test_units_and_reduced_rates(tmp_path):
    """Degrees, feet and knots become SI; a rate over 2V/b is the reduced one, a rate alone
    stays.
    """
    assert value(
        lift(tmp_path, prop("fcs/elevator-pos-deg"), "<value>0.01</value>"), delta_e=10 * DEGREE
    ) == pytest.approx(0.1)
    assert value(
        lift(tmp_path, LINE.format("aero/alpha-deg")), alpha=0.5 * DEGREE
    ) == pytest.approx(2.0)
    assert value(lift(tmp_path, LINE.format("position/h-sl-ft")), h=0.25 * FOOT) == pytest.approx(
        1.5
    )
    assert value(
        lift(tmp_path, LINE.format("aero/h_b-mac-ft")), h_agl=0.5 * B * FOOT
    ) == pytest.approx(2.0)
    assert value(lift(tmp_path, prop("velocities/vt-fps")), V=7 * FOOT) == pytest.approx(7.0)
    assert (
        value(lift(tmp_path, prop("aero/ci2vel"), prop("velocities/q-rad_sec")), qhat=0.01) == 0.01
    )
    assert value(
        lift(tmp_path, prop("aero/bi2vel"), prop("velocities/q-rad_sec")), qhat=0.01
    ) == pytest.approx(0.01 * B / CBAR)
    assert value(lift(tmp_path, prop("velocities/p-aero-rad_sec")), p=0.3) == 0.3
    # alpha-dot exists reduced only: alphadot = alphadothat 2V/c
    assert value(
        lift(tmp_path, prop("aero/alphadot-rad_sec")), alphadothat=0.02, V=100.0
    ) == pytest.approx(0.02 * 200 / (CBAR * FOOT))
    assert value(lift(tmp_path, prop("metrics/Sh-sqft")), alpha=0.0) == 40.0


def test_signs(tmp_path):
    """The left aileron, a minus before a property, AXIAL and NORMAL, and X and Z of the stability
    frame, which are drag and lift.
    """
    left = lift(tmp_path, prop("fcs/left-aileron-pos-rad"))
    assert value(left, delta_a=0.2) == -0.2
    assert (
        left.attrs["comment"]
        == "both ailerons are taken to move by the same angle, left = -delta_a and right = delta_a"
    )
    assert value(lift(tmp_path, prop("-aero/alpha-rad")), alpha=0.2) == -0.2
    table = lift(tmp_path, LINE.format("fcs/left-aileron-pos-rad"))
    assert value(table, delta_a=-0.5) == 2.0
    assert value(table, delta_a=0.5) == 1.0
    function = f"<function><product>{FORCE}<value>2</value></product></function>"
    axes = "".join(f"<axis name='{name}'>{function}</axis>" for name in ("AXIAL", "SIDE", "NORMAL"))
    db = aerodb.exchange.import_jsbsim(file(tmp_path, axes))
    assert db.attrs["force_axes"] == "body"
    assert [float(aerodb.evaluate(db, name)) for name in ("CX", "CY", "CZ")] == [-2.0, 2.0, -2.0]
    axes = "".join(f"<axis name='{name}' frame='STABILITY'>{function}</axis>" for name in "XYZ")
    db = aerodb.exchange.import_jsbsim(file(tmp_path, axes))
    assert db.attrs["force_axes"] == "stability"
    assert [float(aerodb.evaluate(db, name)) for name in ("CD", "CY", "CL")] == [2.0, 2.0, 2.0]
    assert [db.attrs[f"{axis}_ref"] for axis in "xyz"] == pytest.approx(
        [-100 * INCH, 2 * INCH, 5 * INCH], rel=1e-15
    )


def test_sums_become_terms(tmp_path):
    """Products of sums are multiplied out, differences and constant quotients too; names are
    numbered.
    """
    sum_ = f"<sum><value>0.5</value><product>{ALPHA}{prop('aero/beta-rad')}</product></sum>"
    ratio = (
        "<quotient><difference><property>velocities/mach</property><value>1</value>"
        "</difference><value>4</value></quotient>"
    )
    db = lift(tmp_path, sum_, ratio)
    assert set(aerodb.terms(db)) == {"CL/CLx", "CL/CLx_2", "CL/CLx_3", "CL/CLx_4"}
    at = {"alpha": 0.3, "beta": 0.2, "mach": 0.6}
    assert value(db, **at) == pytest.approx((0.5 + 1.6 * 0.2) * (0.6 - 1) / 4)
    assert value(
        lift(tmp_path, f"<pow>{prop('aero/beta-rad')}<value>2</value></pow>"), beta=0.3
    ) == pytest.approx(0.09)
    assert value(
        lift(tmp_path, f"<avg><value>1</value>{prop('aero/beta-rad')}</avg><pi/>"), beta=0.5
    ) == pytest.approx(0.75 * np.pi)


def test_functions_that_others_use(tmp_path):
    """A ground-effect factor by name becomes a factor table, and so does one through another; a
    circle is found.
    """
    kge = f"<function name='aero/function/k'>{LINE.format('aero/h_b-mac-ft')}</function>"
    twice = (
        f"<function name='aero/function/k2'><product>"
        f"<value>2</value>{prop('aero/function/k')}</product></function>"
    )
    db = lift(tmp_path, prop("aero/function/k2"), ALPHA, more=kge + twice)
    assert value(db, alpha=0.5, h_agl=0.5 * B * FOOT) == pytest.approx(2 * 2.0 * 2.0)
    leaf = aerodb.terms(db)["CL/CLx"]
    assert (leaf["value"].dims, leaf["K1"].dims) == (("alpha",), ("h_agl",))
    circle = "".join(f"<function name='f/{a}'>{prop(f'f/{b}')}</function>" for a, b in ("xy", "yx"))
    with pytest.raises(ParseError, match="the function f/x, which uses itself"):
        lift(tmp_path, prop("f/x"), more=circle)


def test_magnitudes_and_third_factors_are_tables(tmp_path):
    """Exact over all values the variable can take."""
    beta = np.array([-1.2, -0.1, 0.0, 0.7])
    db = lift(tmp_path, prop("aero/mag-beta-rad"))
    np.testing.assert_allclose(aerodb.evaluate(db, "CL", beta=beta), np.abs(beta), rtol=1e-15)
    db = lift(
        tmp_path, f"<abs><product><value>-2</value>{prop('fcs/rudder-pos-deg')}</product></abs>"
    )
    np.testing.assert_allclose(
        aerodb.evaluate(db, "CL", delta_r=beta), 2 * np.abs(beta) / DEGREE, rtol=1e-14
    )
    db = lift(tmp_path, LINE.format("aero/mag-beta-rad"))
    np.testing.assert_allclose(
        aerodb.evaluate(db, "CL", beta=beta, outside="clamp"),
        1 + 2 * np.minimum(np.abs(beta), 1),
        rtol=1e-15,
    )
    db = lift(tmp_path, *map(prop, ("aero/alpha-rad", "gear/gear-pos-norm", "aero/beta-rad")))
    assert aerodb.terms(db)["CL/CLx"].attrs["regressors"] == "alpha beta"
    assert value(db, alpha=0.2, beta=0.3, gear=0.5) == pytest.approx(0.03)


def test_many_tables_are_multiplied_out(tmp_path):
    names = (
        "aero/alpha-rad",
        "velocities/mach",
        "aero/beta-rad",
        "fcs/flap-pos-rad",
        "fcs/rudder-pos-rad",
    )
    db = lift(tmp_path, *(LINE.format(name) for name in names))
    at = dict(zip(("alpha", "mach", "beta", "delta_f", "delta_r"), (0.1, 0.2, 0.3, 0.4, 0.5)))
    assert value(db, **at) == pytest.approx(np.prod([1 + 2 * x for x in at.values()]))


def test_blocks_with_breakpoints_of_their_own(tmp_path):
    """JSBSim looks each block up by itself: the union of the breakpoints is the same function,
    beyond the ends too.
    """
    blocks = (
        "<tableData breakPoint='0'>\n 0 1\n0 0 1\n1 2 4\n</tableData>",
        "<tableData breakPoint='2'>\n 0 0.5 2\n-1 1 1 3\n0.5 1 2 5\n</tableData>",
    )
    axes = zip(("row", "column", "table"), ("aero/alpha-rad", "aero/beta-rad", "velocities/mach"))
    table = "".join(
        f"<independentVar lookup='{lookup}'>{name}</independentVar>" for lookup, name in axes
    )
    db = lift(tmp_path, f"<table>{table}{''.join(blocks)}</table>")
    # first block at (0.9, 0.8): rows 0 and 1 give 0.8 and 3.6; second one held at row 0.5 of it
    first, second = 0.1 * 0.8 + 0.9 * 3.6, 2.0 + 3.0 * (0.8 - 0.5) / 1.5
    assert value(db, alpha=0.9, beta=0.8, mach=0.5) == pytest.approx(0.75 * first + 0.25 * second)
    assert value(db, alpha=3.0, beta=3.0, mach=0.0) == pytest.approx(4.0)


def test_sampling_only_on_demand(tmp_path):
    """A sine times a table over the same angle: refused with what to do, or put onto a table within
    the bound.
    """
    parts = (f"<sin>{prop('aero/alpha-rad')}</sin>", ALPHA, LINE.format("velocities/mach"))
    with pytest.raises(
        SchemaError,
        match=r"CLx: <sin> x table\(alpha\) is not a product of tables .* give sample = largest "
        r"difference",
    ):
        lift(tmp_path, *parts)
    db = lift(tmp_path, *parts, sample=1e-4)
    alpha = np.linspace(0.0, 1.0, 777)
    found = aerodb.evaluate(db, "CL", alpha=alpha, mach=0.5)
    assert (
        np.abs(found - 2.0 * np.sin(alpha) * (1 + 2 * alpha)).max() < 2e-4
    )  # the bound times the factor over Mach, 2
    leaf = aerodb.terms(db)["CL/CLx"]
    assert leaf["K1"].dims == ("mach",)
    assert "sampled on" in leaf.attrs["comment"]
    with pytest.raises(
        SchemaError,
        match=r"no table states how far beta goes; give box = \{'beta': \(low, high\)\}",
    ):
        lift(tmp_path, f"<cos>{prop('aero/beta-rad')}</cos>", sample=1e-3)
    test = f"<gt>{prop('aero/beta-rad')}<value>9</value></gt>"
    curved = f"<ifthen>{test}<value>1</value><exp>{prop('aero/beta-rad')}</exp></ifthen>"
    db = lift(tmp_path, curved, sample=1e-3, box={"beta": (-0.5, 0.5)})
    assert value(db, beta=0.31) == pytest.approx(np.exp(0.31), abs=1e-3)
    with pytest.raises(SchemaError, match="needs more than 100000 nodes"):
        lift(tmp_path, curved, sample=1e-13, box={"beta": (-0.5, 0.5)})
    with pytest.raises(
        SchemaError, match=r"it jumps near beta = 0\.2; a table cannot follow it"
    ):  # breakpoints were added without end
        lift(
            tmp_path,
            curved.replace("<value>9", "<value>0.2"),
            sample=1e-3,
            box={"beta": (-0.5, 0.5)},
        )


def test_the_square_of_the_lift_is_a_polar(tmp_path):
    """CD = k CL^2 with CL of the same instant, there and back."""
    induced = (
        f"<function name='aero/coefficient/CDi'>"
        f"<product>{FORCE}{prop('aero/cl-squared')}<value>0.08</value></product></function>"
    )
    body = (
        f"<axis name='LIFT'><function "
        f"name='aero/coefficient/CLalpha'><product>{FORCE}{ALPHA}</product></function></axis>"
    )
    db = aerodb.exchange.import_jsbsim(file(tmp_path, body + f"<axis name='DRAG'>{induced}</axis>"))
    assert aerodb.terms(db)["CD/CDi"].attrs["regressors"] == "CL CL"
    assert float(aerodb.evaluate(db, "CD", alpha=0.5)) == pytest.approx(0.08 * 4.0, rel=1e-15)
    axial = f"<axis name='AXIAL'>{induced}</axis>"
    with pytest.raises(SchemaError, match="CX -> CX"):
        aerodb.exchange.import_jsbsim(file(tmp_path, body.replace("LIFT", "NORMAL") + axial))


@pytest.mark.nightly
def test_a_polar_is_written_as_the_square_of_the_lift(tmp_path):
    polar = {"CD/polar": make_term(0.05, regressors=["CL", "CL"])}
    db = aerodb.replace_terms(writing.synthetic("wind"), polar)
    aerodb.exchange.export_jsbsim(db, tmp_path / "polar.xml", writing.craft())
    back = aerodb.exchange.import_jsbsim(tmp_path / "polar.xml")
    assert aerodb.terms(back)["CD/polar"].equals(polar["CD/polar"])
    table = aerodb.replace_terms(db, {"CD/polar": make_term([0.02, 0.05], {"CL": [0.0, 1.0]})})
    with pytest.raises(SchemaError, match="CL is nothing that JSBSim knows"):
        aerodb.exchange.export_jsbsim(table, tmp_path / "table.xml", writing.craft())


def test_the_travel_that_a_file_states(tmp_path):
    """A scaling of the position to its fraction: 35 deg of flap; what differs by side, or starts
    elsewhere, states none.
    """
    flap, elevator = (
        f"<aerosurface_scale>"
        f"<input>fcs/{name}-pos-{unit}</input>{ends}<output>fcs/{name}-pos-norm</output>"
        f"</aerosurface_scale>"
        for name, unit, ends in (
            (
                "flap",
                "deg",
                "<domain><min>0</min><max>35</max></domain><range><min>0</min><max>1</max></range>",
            ),
            ("elevator", "rad", "<domain><min>-0.4</min><max>0.3</max></domain>"),
        )
    )
    path = file(
        tmp_path,
        f"<axis name='LIFT'><function "
        f"name='a'><product>{FORCE}{prop('fcs/flap-pos-norm')}</product></function></axis>",
    )
    text = path.read_text()
    path.write_text(
        text.replace(
            "<aerodynamics>", f"<flight_control>{flap}{elevator}</flight_control><aerodynamics>"
        )
    )
    assert value(aerodb.exchange.import_jsbsim(path), delta_f=35 * DEGREE) == pytest.approx(
        1.0, rel=1e-14
    )
    assert value(
        aerodb.exchange.import_jsbsim(path, travel={"delta_f": 0.5}), delta_f=0.5
    ) == pytest.approx(1.0, rel=1e-14)
    path.write_text(
        path.read_text().replace("fcs/flap-pos-norm</property>", "fcs/elevator-pos-norm</property>")
    )
    with pytest.warns(AeromatchWarning, match="fcs/elevator-pos-norm is device"):
        aerodb.exchange.import_jsbsim(path)
