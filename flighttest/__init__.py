"""Flight test: records, state reconstruction, and identification of aerodynamic terms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .aircraft_properties.eigenmotion import Motion, fit_motion
    from .aircraft_properties.inertia import Inertia, inertia_from_flight
    from .aircraft_properties.thrust_table import fit_thrust
    from .combining.data_partition import Partition, bins, fit_bins
    from .combining.joined_fits import Joined, join_fits
    from .combining.mixed_estimation import Mixed, mixed, prior_of
    from .combining.pooling import pool, pool_fits
    from .combining.published import published_fit
    from .dynamics.derived_channels import (
        airspeed_from_pressures,
        angular_accelerations,
        complete,
        forces_from_velocity,
        incidence_from_velocity,
        rates_from_attitude,
    )
    from .dynamics.force_coefficients import between, coefficients, open_states
    from .engine.fuel_thrust import FuelThrust, fit_fuel_thrust
    from .engine.result import EngineFit, identify_engine
    from .engine.spools import SpoolFit, identify_spools
    from .engine.starting import StartFit, identify_start
    from .engine.static import DeckCorrection, Polar, correct_deck
    from .equation_error.fit import Fit, open_fit, save_fit
    from .equation_error.frequency_domain import regress_frequency
    from .equation_error.model import Model
    from .equation_error.resampling import Bootstrap, Study, bootstrap, monte_carlo
    from .equation_error.time_domain import regress
    from .evaluation.flight_evaluation import evaluate
    from .evaluation.result import Evaluation
    from .expressions.separable_model import SeparableModel, ShapeParameter
    from .ground_effect.database import replace_ground_effect
    from .ground_effect.identification import identify_ground_effect
    from .ground_effect.result import GroundEffect
    from .input_design.design import Designed, design_input, save_design
    from .input_design.input_accuracy import Expected, cramer_rao, expected_errors
    from .input_design.multisines import InputAxis, multisine
    from .input_design.multisteps import in_sequence, multistep, sweep, unit_step
    from .input_design.predicted_response import amplitude_within, predict_response, trimmed_start
    from .input_design.specification import read_design
    from .input_design.timetable import open_timetable, save_timetable
    from .maximum_likelihood.files import open_output_error, save_output_error
    from .maximum_likelihood.frequency_domain import frequency_output_error
    from .maximum_likelihood.linear_time_domain import linear_output_error
    from .maximum_likelihood.models.state_space import LinearModel, linear_model
    from .maximum_likelihood.parameters import Unknown
    from .maximum_likelihood.process_noise import filter_error
    from .maximum_likelihood.result import OutputError
    from .maximum_likelihood.time_domain import output_error
    from .maximum_likelihood.updated_database import corrected_database
    from .model_structure.candidates import monomials, spline_terms
    from .model_structure.deletion_rule import decide
    from .model_structure.orthogonal_functions import select_orthogonal
    from .model_structure.selection import Selection, tally
    from .model_structure.stepwise import select_stepwise
    from .quality.assessment import assess
    from .quality.finding import Finding
    from .quality.result import Quality
    from .readers.name_map import NameMap, read_names, shipped_maps
    from .reconstruction.batch.programme import Batch, reconstruct_batch, visible
    from .reconstruction.compatibility import compatibility_report, compatibility_table, draw_compatibility
    from .reconstruction.flight_programme import combine_biases, reconstruct_programme
    from .reconstruction.path_files import open_biases, save_path
    from .reconstruction.smoother import Path, reconstruct
    from .records.file_contents import contents
    from .records.files import save_record
    from .records.joining import merge
    from .records.record import faults, manoeuvres, overview, read
    from .remarks import Remark
    from .sensors.position_corrections import force_at_cg, incidence_at_cg, true_pressures, vane_angles, vane_at_cg, vane_true, velocity_at
    from .separable.regression import regress_separable
    from .separable.result import SeparableFit
    from .signals.conditioning import channel, cut, lowpass, remove_delay, resample, smooth
    from .signals.delays import Delay, time_delay
    from .signals.differentiation import derivative, derivative_window
    from .signals.first_order_lag import remove_lag
    from .signals.fourier import finite_fourier, harmonics
    from .signals.fourier_smoothing import Smoothed, fourier_smooth
    from .signals.sample_flags import add_flags, flags
    from .spin.database import polynomial_database
    from .spin.decomposition import nominal_variables, spin_variables, wind_axis_rates
    from .spin.steep_reconstruction import reconstruct_steep
    from .spin.tables import read_polynomials
    from .uncertainty.goodness_of_fit import nrmse, r_squared, theil, theil_shares, validation_report, validation_table

_HOME = {
    "save_output_error": "maximum_likelihood.files",
    "corrected_database": "maximum_likelihood.updated_database",
    "open_output_error": "maximum_likelihood.files",
    "evaluate": "evaluation.flight_evaluation",
    "Evaluation": "evaluation.result",
    "fit_motion": "aircraft_properties.eigenmotion",
    "Motion": "aircraft_properties.eigenmotion",
    "Remark": "remarks",
    "assess": "quality.assessment",
    "Quality": "quality.result",
    "Finding": "quality.finding",
    "regress_frequency": "equation_error.frequency_domain",
    "finite_fourier": "signals.fourier",
    "harmonics": "signals.fourier",
    "Mixed": "combining.mixed_estimation",
    "prior_of": "combining.mixed_estimation",
    "published_fit": "combining.published",
    "join_fits": "combining.joined_fits",
    "Joined": "combining.joined_fits",
    "fit_bins": "combining.data_partition",
    "bins": "combining.data_partition",
    "Partition": "combining.data_partition",
    "inertia_from_flight": "aircraft_properties.inertia",
    "Inertia": "aircraft_properties.inertia",
    "bootstrap": "equation_error.resampling",
    "Bootstrap": "equation_error.resampling",
    "monte_carlo": "equation_error.resampling",
    "Study": "equation_error.resampling",
    "select_stepwise": "model_structure.stepwise",
    "select_orthogonal": "model_structure.orthogonal_functions",
    "monomials": "model_structure.candidates",
    "spline_terms": "model_structure.candidates",
    "tally": "model_structure.selection",
    "Selection": "model_structure.selection",
    "compatibility_report": "reconstruction.compatibility",
    "compatibility_table": "reconstruction.compatibility",
    "draw_compatibility": "reconstruction.compatibility",
    "Batch": "reconstruction.batch.programme",
    "reconstruct_batch": "reconstruction.batch.programme",
    "visible": "reconstruction.batch.programme",
    "filter_error": "maximum_likelihood.process_noise",
    "frequency_output_error": "maximum_likelihood.frequency_domain",
    "linear_output_error": "maximum_likelihood.linear_time_domain",
    "linear_model": "maximum_likelihood.models.state_space",
    "LinearModel": "maximum_likelihood.models.state_space",
    "OutputError": "maximum_likelihood.result",
    "Unknown": "maximum_likelihood.parameters",
    "output_error": "maximum_likelihood.time_domain",
    "incidence_from_velocity": "dynamics.derived_channels",
    "airspeed_from_pressures": "dynamics.derived_channels",
    "forces_from_velocity": "dynamics.derived_channels",
    "rates_from_attitude": "dynamics.derived_channels",
    "angular_accelerations": "dynamics.derived_channels",
    "complete": "dynamics.derived_channels",
    "true_pressures": "sensors.position_corrections",
    "incidence_at_cg": "sensors.position_corrections",
    "vane_true": "sensors.position_corrections",
    "derivative_window": "signals.differentiation",
    "remove_delay": "signals.conditioning",
    "remove_lag": "signals.first_order_lag",
    "smooth": "signals.conditioning",
    "Smoothed": "signals.fourier_smoothing",
    "fourier_smooth": "signals.fourier_smoothing",
    "Delay": "signals.delays",
    "time_delay": "signals.delays",
    "read": "records.record",
    "manoeuvres": "records.record",
    "overview": "records.record",
    "faults": "records.record",
    "contents": "records.file_contents",
    "flags": "signals.sample_flags",
    "add_flags": "signals.sample_flags",
    "merge": "records.joining",
    "save_record": "records.files",
    "read_names": "readers.name_map",
    "shipped_maps": "readers.name_map",
    "NameMap": "readers.name_map",
    "cut": "signals.conditioning",
    "channel": "signals.conditioning",
    "lowpass": "signals.conditioning",
    "resample": "signals.conditioning",
    "reconstruct": "reconstruction.smoother",
    "Path": "reconstruction.smoother",
    "reconstruct_programme": "reconstruction.flight_programme",
    "combine_biases": "reconstruction.flight_programme",
    "save_path": "reconstruction.path_files",
    "open_biases": "reconstruction.path_files",
    "fit_thrust": "aircraft_properties.thrust_table",
    "fit_fuel_thrust": "engine.fuel_thrust",
    "FuelThrust": "engine.fuel_thrust",
    "identify_engine": "engine.result",
    "EngineFit": "engine.result",
    "identify_spools": "engine.spools",
    "SpoolFit": "engine.spools",
    "identify_start": "engine.starting",
    "StartFit": "engine.starting",
    "correct_deck": "engine.static",
    "DeckCorrection": "engine.static",
    "Polar": "engine.static",
    "GroundEffect": "ground_effect.result",
    "identify_ground_effect": "ground_effect.identification",
    "replace_ground_effect": "ground_effect.database",
    "SeparableFit": "separable.result",
    "SeparableModel": "expressions.separable_model",
    "ShapeParameter": "expressions.separable_model",
    "regress_separable": "separable.regression",
    "force_at_cg": "sensors.position_corrections",
    "velocity_at": "sensors.position_corrections",
    "vane_angles": "sensors.position_corrections",
    "vane_at_cg": "sensors.position_corrections",
    "derivative": "signals.differentiation",
    "coefficients": "dynamics.force_coefficients",
    "between": "dynamics.force_coefficients",
    "open_states": "dynamics.force_coefficients",
    "Model": "equation_error.model",
    "regress": "equation_error.time_domain",
    "Fit": "equation_error.fit",
    "save_fit": "equation_error.fit",
    "open_fit": "equation_error.fit",
    "mixed": "combining.mixed_estimation",
    "pool": "combining.pooling",
    "pool_fits": "combining.pooling",
    "decide": "model_structure.deletion_rule",
    "Expected": "input_design.input_accuracy",
    "cramer_rao": "input_design.input_accuracy",
    "expected_errors": "input_design.input_accuracy",
    "Designed": "input_design.design",
    "design_input": "input_design.design",
    "save_design": "input_design.design",
    "InputAxis": "input_design.multisines",
    "multisine": "input_design.multisines",
    "open_timetable": "input_design.timetable",
    "save_timetable": "input_design.timetable",
    "in_sequence": "input_design.multisteps",
    "multistep": "input_design.multisteps",
    "sweep": "input_design.multisteps",
    "unit_step": "input_design.multisteps",
    "amplitude_within": "input_design.predicted_response",
    "predict_response": "input_design.predicted_response",
    "trimmed_start": "input_design.predicted_response",
    "read_design": "input_design.specification",
    "nrmse": "uncertainty.goodness_of_fit",
    "r_squared": "uncertainty.goodness_of_fit",
    "theil": "uncertainty.goodness_of_fit",
    "theil_shares": "uncertainty.goodness_of_fit",
    "validation_report": "uncertainty.goodness_of_fit",
    "validation_table": "uncertainty.goodness_of_fit",
    "polynomial_database": "spin.database",
    "nominal_variables": "spin.decomposition",
    "spin_variables": "spin.decomposition",
    "wind_axis_rates": "spin.decomposition",
    "read_polynomials": "spin.tables",
    "reconstruct_steep": "spin.steep_reconstruction",
}
__all__ = [
    "Batch",
    "Bootstrap",
    "DeckCorrection",
    "Delay",
    "Designed",
    "EngineFit",
    "Evaluation",
    "Expected",
    "Finding",
    "Fit",
    "FuelThrust",
    "GroundEffect",
    "Inertia",
    "InputAxis",
    "Joined",
    "LinearModel",
    "Mixed",
    "Model",
    "Motion",
    "NameMap",
    "OutputError",
    "Partition",
    "Path",
    "Polar",
    "Quality",
    "Remark",
    "Selection",
    "SeparableFit",
    "SeparableModel",
    "ShapeParameter",
    "Smoothed",
    "SpoolFit",
    "StartFit",
    "Study",
    "Unknown",
    "add_flags",
    "airspeed_from_pressures",
    "amplitude_within",
    "angular_accelerations",
    "assess",
    "between",
    "bins",
    "bootstrap",
    "channel",
    "coefficients",
    "combine_biases",
    "compatibility_report",
    "compatibility_table",
    "complete",
    "contents",
    "correct_deck",
    "corrected_database",
    "cramer_rao",
    "cut",
    "decide",
    "derivative",
    "derivative_window",
    "design_input",
    "draw_compatibility",
    "evaluate",
    "expected_errors",
    "faults",
    "filter_error",
    "finite_fourier",
    "fit_bins",
    "fit_fuel_thrust",
    "fit_motion",
    "fit_thrust",
    "flags",
    "force_at_cg",
    "forces_from_velocity",
    "fourier_smooth",
    "frequency_output_error",
    "harmonics",
    "identify_engine",
    "identify_ground_effect",
    "identify_spools",
    "identify_start",
    "in_sequence",
    "incidence_at_cg",
    "incidence_from_velocity",
    "inertia_from_flight",
    "join_fits",
    "linear_model",
    "linear_output_error",
    "lowpass",
    "manoeuvres",
    "merge",
    "mixed",
    "monomials",
    "monte_carlo",
    "multisine",
    "multistep",
    "nominal_variables",
    "nrmse",
    "open_biases",
    "open_fit",
    "open_output_error",
    "open_states",
    "open_timetable",
    "output_error",
    "overview",
    "polynomial_database",
    "pool",
    "pool_fits",
    "predict_response",
    "prior_of",
    "published_fit",
    "r_squared",
    "rates_from_attitude",
    "read",
    "read_design",
    "read_names",
    "read_polynomials",
    "reconstruct",
    "reconstruct_batch",
    "reconstruct_programme",
    "reconstruct_steep",
    "regress",
    "regress_frequency",
    "regress_separable",
    "remove_delay",
    "remove_lag",
    "replace_ground_effect",
    "resample",
    "save_design",
    "save_fit",
    "save_output_error",
    "save_path",
    "save_record",
    "save_timetable",
    "select_orthogonal",
    "select_stepwise",
    "shipped_maps",
    "smooth",
    "spin_variables",
    "spline_terms",
    "sweep",
    "tally",
    "theil",
    "theil_shares",
    "time_delay",
    "trimmed_start",
    "true_pressures",
    "unit_step",
    "validation_report",
    "validation_table",
    "vane_angles",
    "vane_at_cg",
    "vane_true",
    "velocity_at",
    "visible",
    "wind_axis_rates",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
