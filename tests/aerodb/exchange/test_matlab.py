"""Terms in MAT files: there and back, and against GNU Octave."""

import shutil
import subprocess

import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat, savemat

import aerodb
from flightmech import terms
from flightmech.errors import ParseError, SchemaError

pytestmark = pytest.mark.usefixtures("mat_files_in_this_process")


@pytest.fixture
def build_up(small, root):
    """Return a database with every shape of term: 0 to 3 axes, factor tables, two regressors."""
    rng = np.random.default_rng(3)
    alpha, mach, flap = (
        np.radians([-8.0, 0.0, 5.0, 16.0]),
        [0.2, 0.4, 0.5],
        np.radians([0.0, 20.0, 40.0]),
    )
    x_cg = xr.DataArray([1.1, 0.9], coords={"x_cg": [0.2, 0.35]}, dims="x_cg")
    height = xr.DataArray(
        [[1.0, 0.8], [0.2, 0.1], [0.0, 0.0]],
        coords={"h_agl": [0.0, 5.0, 30.0], "delta_f": [0.0, 0.7]},
        dims=("h_agl", "delta_f"),
    )
    leaves = {
        "CL/flap": terms.make_term(
            rng.normal(size=(3, 3, 4)),
            {"delta_f": flap, "mach": mach, "alpha": alpha},
            stderr=0.1,
            source="datcom",
        ),
        "CL/elevator": terms.make_term(
            rng.normal(size=(3, 4)),
            {"mach": mach, "alpha": alpha},
            ["delta_e"],
            stderr=0.2,
            source="flight",
        ),
        "CL/ground": terms.make_term(
            rng.normal(size=4), {"alpha": alpha}, K1=height, outside="linear"
        ),
        "Cm/qhat": terms.make_term(rng.normal(size=3), {"mach": mach}, ["qhat"], K1=x_cg),
        "CD/basic": terms.make_term(0.02, comment="one number"),
        "CD/flap_slope": terms.make_term(
            [0.0, 0.1, 0.4], {"delta_f": flap}, ["alpha", "alpha"], source="judgement"
        ),
    }
    return aerodb.make_database(leaves, **root)


def test_the_first_index_belongs_to_the_first_axis(small, tmp_path):
    aerodb.exchange.export_matlab(small, tmp_path / "small.mat")
    content = loadmat(tmp_path / "small.mat", simplify_cells=True)
    basic = content["terms"][0]
    assert [axis["name"] for axis in basic["axes"]] == ["mach", "alpha"]
    assert [axis["units"] for axis in basic["axes"]] == ["1", "rad"]
    np.testing.assert_array_equal(basic["values"], aerodb.terms(small)["CL/basic"]["value"].values)
    np.testing.assert_array_equal(basic["breakpoints"][1], np.radians([-8.0, 0.0, 8.0, 16.0]))
    assert basic["comment"] == "clean"
    assert content["terms"][1]["regressors"] == "qhat"
    assert content["database"]["S"] == 16.9
    assert "first" not in content["database"]
    assert "radians" in content["conventions"]


def test_check_cases_and_previous_states_stay_in_the_database(small, tmp_path):
    aerodb.exchange.export_matlab(aerodb.store.with_checks(small), tmp_path / "small.mat")
    xr.testing.assert_identical(aerodb.exchange.import_matlab(tmp_path / "small.mat"), small)


_SCRIPT = """
load('db.mat'); load('points.mat');
found = zeros(numel(points.case), numel(terms));
function v = table(t, points)
  x = cell(1, numel(t.axes));
  for k = 1:numel(x), x{k} = points.(t.axes(k).name); end
  if isempty(x), v = t.values * ones(size(points.case));
  elseif numel(x) == 1, v = interp1(t.breakpoints{1}, t.values, x{1});
  else, v = interpn(t.breakpoints{:}, t.values, x{:}); end
end
for n = 1:numel(terms)
  t = terms(n);
  v = table(t, points);
  for f = {t.K1, t.K2}
    if ~isempty(f{1}), v = v .* table(f{1}, points); end
  end
  for r = t.regressors, v = v .* points.(r{1}); end
  found(:, n) = v;
end
save('-v7', 'found.mat', 'found');
"""


@pytest.mark.skipif(shutil.which("octave") is None, reason="needs GNU Octave")
def test_octave_interpolates_the_same_contributions(build_up, tmp_path):
    leaves = aerodb.terms(build_up)
    rng = np.random.default_rng(5)
    ends = {
        str(axis): (leaf[axis].values[0], leaf[axis].values[-1])
        for leaf in leaves.values()
        for axis in leaf.dims
    }
    names = {name for leaf in leaves.values() for name in terms.list_model_variables(leaf)}
    points = {name: rng.uniform(*ends.get(name, (-0.1, 0.1)), size=300) for name in sorted(names)}
    aerodb.exchange.export_matlab(build_up, tmp_path / "db.mat")
    columns = {name: x[:, None] for name, x in points.items()}
    savemat(tmp_path / "points.mat", {"points": {**columns, "case": np.zeros((300, 1))}})
    (tmp_path / "contributions.m").write_text(_SCRIPT)
    subprocess.run(
        ["octave", "--no-gui", "--norc", "-q", "contributions.m"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        timeout=1200,
    )
    found = loadmat(tmp_path / "found.mat")["found"]
    assert found.shape == (300, len(leaves))
    for column, (name, leaf) in zip(found.T, leaves.items()):
        np.testing.assert_allclose(
            column, terms.evaluate_term(leaf, points), rtol=1e-12, atol=1e-13, err_msg=name
        )


@pytest.mark.skipif(shutil.which("octave") is None, reason="needs GNU Octave")
def test_a_file_that_octave_saved_is_read(small, tmp_path):
    aerodb.exchange.export_matlab(small, tmp_path / "db.mat")
    script = (
        "load('db.mat'); terms(1).values(2,3) = 0.5; save('-v7', 'back.mat', 'terms', 'database')"
    )
    subprocess.run(
        ["octave", "--no-gui", "--norc", "-q", "--eval", script],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        timeout=1200,
    )
    expected = small.copy(deep=True)
    expected["CL/basic"]["value"][1, 2] = 0.5
    xr.testing.assert_identical(aerodb.exchange.import_matlab(tmp_path / "back.mat"), expected)


def test_files_that_are_none_of_ours(tmp_path):
    path = tmp_path / "x.mat"
    with pytest.raises(FileNotFoundError):
        aerodb.exchange.import_matlab(path)
    for content in (b"", b"text", b"MATLAB 5.0 MAT-file" + bytes(300)):
        path.write_bytes(content)
        with pytest.raises(ParseError, match=r"no MAT file, or a damaged one|the variables \[\]"):
            aerodb.exchange.import_matlab(path)
    savemat(path, {"terms": 1.0, "database": {"S": 1.0}})
    with pytest.raises(ParseError, match="structures 'terms' and 'database'"):
        aerodb.exchange.import_matlab(path)
    path.write_bytes(
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + bytes(400)
    )
    with pytest.raises(
        ParseError, match=r"version 7\.3; expected version 5 to 7; save it with save -v7"
    ):
        aerodb.exchange.import_matlab(path)


def test_all_faults_of_the_terms_are_reported(small, tmp_path):
    path = tmp_path / "small.mat"
    aerodb.exchange.export_matlab(small, path)
    content = loadmat(path)
    elements = content["terms"]
    elements["values"][0, 0] = elements["values"][0, 0].T
    elements["axes"][0, 1]["units"][0, 0] = "deg"
    elements["coefficient"][0, 2] = "CD"
    savemat(path, {"terms": elements, "database": content["database"]}, long_field_names=True)
    with pytest.raises(SchemaError) as caught:
        aerodb.exchange.import_matlab(path)
    assert caught.value.problems == [
        "terms(1): CL/basic values is 4 x 2, its breakpoints require 2 x 4",
        "terms(2): CL/qhat values: axis mach is given in 'deg'; convert its breakpoints to '1'",
        "terms(3): name is 'CL/flap', coefficient and contribution are others",
    ]


@pytest.mark.parametrize("keep", [0.0, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_a_file_that_ends_early_is_a_clear_error(small, tmp_path, keep):
    path = tmp_path / "small.mat"
    aerodb.exchange.export_matlab(small, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(ParseError, match=r"a damaged file|no MAT file, or a damaged one"):
        aerodb.exchange.import_matlab(path)


def test_a_flipped_byte_is_a_clear_error(small, tmp_path):
    path = tmp_path / "small.mat"
    aerodb.exchange.export_matlab(small, path)
    content = path.read_bytes()
    rng = np.random.default_rng(8)
    for place in [*range(0, 128, 5), *rng.integers(128, len(content), size=300)]:
        harmed = bytearray(content)
        harmed[place] ^= int(rng.integers(1, 256))
        path.write_bytes(harmed)
        with pytest.raises(ParseError, match=r"a damaged file|no MAT file, or a damaged one"):
            aerodb.exchange.import_matlab(path)


def test_a_root_attribute_that_no_structure_takes_is_refused(small, tmp_path):
    small.attrs["my note"] = "x"
    with pytest.raises(
        SchemaError, match="root attribute 'my note' is not a name of a MATLAB field"
    ):
        aerodb.exchange.export_matlab(small, tmp_path / "small.mat")
    assert not list(tmp_path.iterdir())
