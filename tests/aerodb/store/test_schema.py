import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech import terms
from flightmech.errors import SchemaError


def test_a_sound_database_has_no_faults(small):
    assert aerodb.check(small) == []


def test_check_lists_every_fault_at_once(small_terms, root):
    faulty = small_terms["CL/basic"].copy()
    faulty["value"] = faulty["value"].where(faulty["mach"] > 0.3)
    attributes = {**root, "S": -1.0, "force_axes": "sideways", "comment": ["a", "list"]}
    del attributes["title"]
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=attributes),
            "/CL/basic": faulty,
            "/CX/deep/er": small_terms["CL/qhat"],
        }
    )
    text = "\n".join(aerodb.check(tree))
    assert "root attribute title is None; a text is needed" in text
    assert "root attribute S is -1.0; it must be positive" in text
    assert "force_axes is 'sideways'; allowed: stability, wind, body" in text
    assert "root attribute comment is a list" in text
    assert "CL/basic: value holds 4 NaN or infinite nodes of 8" in text
    assert "CX/deep/er: a term stands at <coefficient>/<contribution>" in text


def test_a_coefficient_of_other_axes_is_refused(root):
    with pytest.raises(
        SchemaError,
        match="unknown coefficient 'CZ'; with these force_axes allowed: CL, CD, CY, Cl, Cm, Cn",
    ):
        aerodb.make_database({"CZ/basic": terms.make_term(0.1)}, **root)
    assert (
        aerodb.check(
            aerodb.make_database(
                {"CZ/basic": terms.make_term(0.1)}, **{**root, "force_axes": "body"}
            )
        )
        == []
    )


def test_check_cases_in_the_file_are_no_terms(small):
    small["checks/trim"] = xr.Dataset({"CL": ("case", [0.3])})
    assert aerodb.check(small) == []
    assert "checks/trim" not in aerodb.terms(small)


def test_what_edits_replaced_is_no_term(small, small_terms):
    small["previous/e001/CL/gear"] = small_terms["CL/flap"]
    assert aerodb.check(small) == []
    assert "CL/gear" not in aerodb.terms(small)
    assert not [name for name in aerodb.terms(small) if name.startswith("previous")]


def test_hinge_moments_go_with_any_force_axes(small_terms, root):
    hinge = terms.make_term(-0.3, regressors=["delta_e"])
    for axes, name in (("stability", "CL/basic"), ("wind", "CL/basic"), ("body", "CZ/basic")):
        db = aerodb.make_database(
            {name: small_terms["CL/basic"], "Ch_e/delta": hinge, "Ch_r/beta": hinge},
            **{**root, "force_axes": axes},
        )
        assert aerodb.check(db) == []
    with pytest.raises(SchemaError, match="unknown coefficient 'Ch_x'"):
        aerodb.make_database({"Ch_x/delta": hinge}, **root)


def test_an_empty_tree_is_no_database(root):
    assert aerodb.check(xr.DataTree(xr.Dataset(attrs=root))) == [
        "holds no term; a database has leaves such as CL/basic"
    ]


def test_terms_keep_their_own_breakpoints(small):
    leaves = aerodb.terms(small)
    assert list(leaves) == ["CL/basic", "CL/qhat", "CL/flap", "Cm/qhat"]
    np.testing.assert_array_equal(leaves["CL/qhat"]["mach"], [0.2, 0.4])
    assert leaves["Cm/qhat"]["value"].ndim == 0


def test_import_of_the_package_is_fast():
    code = (
        "import sys, aerodb; print([m for m in ('xarray', 'pandas', 'scipy', 'numpy') if m in "
        "sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )
