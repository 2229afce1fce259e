import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech import terms
from flightmech.errors import SchemaError, UnknownName


def test_a_new_term_is_added_and_leaves_the_absent_list(small):
    gear = terms.make_term(-0.02, regressors=["gear"], source="flight")
    new = aerodb.replace_terms(small, {"CL/gear": gear}, note="run 09")
    assert new.attrs["absent"] == "CY/rhat"
    assert new.attrs["history"].splitlines() == ["by hand", "replace_terms: added CL/gear (run 09)"]
    assert new["CL/gear"].attrs["history"] == "replace_terms: added (run 09)"
    assert float(new["CL/gear"]["value"]) == -0.02


def test_the_old_tree_stays_as_it_was(small):
    before = small.copy(deep=True)
    other = terms.make_term([9.0, 9.0], {"mach": [0.2, 0.4]}, ["qhat"], source="flight")
    new = aerodb.replace_terms(small, {"CL/qhat": other})
    xr.testing.assert_identical(small, before)
    assert float(new["CL/qhat"]["value"][0]) == 9.0
    assert new.attrs["history"].endswith("replace_terms: replaced CL/qhat")


def test_a_faulty_term_is_refused_with_all_faults(small):
    with pytest.raises(SchemaError) as caught:
        aerodb.replace_terms(small, {"CL/gear": xr.Dataset(), "Cq/basic": terms.make_term(1.0)})
    assert any(
        text.startswith("CL/gear: has no variable 'value'") for text in caught.value.problems
    )
    assert any("unknown coefficient 'Cq'" in text for text in caught.value.problems)


def test_deleting_writes_the_absent_list(small):
    new = aerodb.delete_terms(small, ["CL/flap"], note="could not be identified")
    assert "CL/flap" not in aerodb.terms(new)
    assert new.attrs["absent"] == "CL/gear CY/rhat CL/flap"
    assert new.attrs["history"].endswith("delete_terms: CL/flap (could not be identified)")
    with pytest.raises(UnknownName, match="unknown term 'CL/flop'; near it: CL/flap"):
        aerodb.delete_terms(small, ["CL/flop"])


def test_swapping_a_term_there_and_back_restores_the_numbers(small):
    old = aerodb.terms(small)["CL/basic"]
    new = aerodb.replace_terms(small, {"CL/basic": terms.make_term(0.5)})
    back = aerodb.replace_terms(new, {"CL/basic": old})
    conditions = {
        "mach": np.array([0.2, 0.3]),
        "alpha": np.array([0.0, 0.1]),
        "qhat": 0.01,
        "delta_f": 0.2,
    }
    np.testing.assert_array_equal(
        aerodb.evaluate(back, "CL", **conditions), aerodb.evaluate(small, "CL", **conditions)
    )


def test_a_database_as_new_terms_is_refused_in_words(small):
    for new in (small, {"CL/basic": small["CL/basic"]}):
        with pytest.raises(SchemaError, match=r"aerodb\.terms\(other\) has all of another"):
            aerodb.replace_terms(small, new)
    assert "CL/basic" in aerodb.terms(aerodb.replace_terms(small, aerodb.terms(small)))
