import numpy as np
import pytest
import xarray as xr

from aerodb.prior.prior_errors import PRIOR_ERRORS, REGIME_FACTORS, errors_with, method_class
from aerodb.store.templates import lr743
from flightmech.errors import SchemaError, UnknownName


def test_every_figure_belongs_to_a_term_with_a_method():
    scheme = lr743()
    for name, (relative, absolute) in PRIOR_ERRORS.items():
        assert name in scheme
        assert method_class(name) in REGIME_FACTORS
        assert relative > 0.0 or absolute > 0.0


def test_a_node_has_the_error_of_its_regime():
    table = xr.DataArray([0.2, 0.2, 0.2, 0.2], {"mach": [0.5, 0.8, 1.2, 2.0]}, "mach")
    base = np.hypot(0.08 * 0.2, 0.05)
    np.testing.assert_allclose(
        errors_with(None).stderr("CL/basic", table), base * np.array([1.0, 2.0, 2.0, 1.25])
    )
    np.testing.assert_allclose(
        errors_with(None, 0.9, 1.2).stderr("CL/basic", table),
        base * np.array([1.0, 1.0, 1.25, 1.25]),
    )
    np.testing.assert_allclose(
        errors_with(None).stderr("CL/basic", table.isel(mach=2, drop=True)), base
    )  # no Mach axis


def test_roll_damping_that_a_predicted_stall_takes_away_is_uncertain():
    """0.3 of the loss within 10 deg of incidence, on any place of the axis; beyond it none."""
    alpha = np.radians([0.0, 4.0, 8.0, 12.0, 24.0])
    damping = np.array([-0.4, -0.4, -0.3, 0.1, 0.1])
    table = xr.DataArray(np.tile(damping, (2, 1)), {"mach": [0.1, 0.3], "alpha": alpha})
    loss = np.array([0.0, 0.0, 0.1, 0.5, 0.0])
    expected = np.sqrt((0.15 * damping) ** 2 + 0.02**2 + (0.3 * loss) ** 2)
    for turned in (table, table.transpose("alpha", "mach")):
        found = errors_with(None).stderr("Cl/phat", turned)
        np.testing.assert_allclose(found.transpose("mach", "alpha"), np.tile(expected, (2, 1)))
    without = errors_with(None).stderr("Cl/rhat", table)
    np.testing.assert_allclose(without[0], np.hypot(0.5 * damping, 0.02))


def test_terms_and_classes_may_be_overridden():
    table = xr.DataArray([1.0, 1.0], {"mach": [0.5, 1.0]}, "mach")
    rules = errors_with({"Cl/phat": (0.3, 0.4), "transonic dynamic": 3.0})
    np.testing.assert_allclose(rules.stderr("Cl/phat", table), [0.5, 1.5])
    assert rules.factors["dynamic"] == (3.0, 1.5)
    assert errors_with(None).factors["dynamic"] == (2.0, 1.5)  # the defaults stay


def test_wrong_overrides_are_refused():
    with pytest.raises(
        UnknownName, match="unknown term 'transonic dynamics'; near it: transonic dynamic"
    ):
        errors_with({"transonic dynamics": 3.0})
    with pytest.raises(UnknownName, match="subsonic static"):
        errors_with({"subsonic static": 3.0})
    with pytest.raises(
        SchemaError, match=r"transonic static is -1\.0; give a factor of zero or more"
    ):
        errors_with({"transonic static": -1.0})
    with pytest.raises(SchemaError, match=r"CL/basic is \(0.1,\); give \(relative, absolute\)"):
        errors_with({"CL/basic": (0.1,)})
    with pytest.raises(SchemaError, match="CL/basic is"):
        errors_with({"CL/basic": (0.1, float("nan"))})
