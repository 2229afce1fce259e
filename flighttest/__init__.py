"""Flight test: records, state reconstruction, and identification of aerodynamic terms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from .batch.programme import Batch, reconstruct_batch, visible
    from .calibrate import force_at_cg, incidence_at_cg, true_pressures, vane_angles, vane_at_cg, vane_true, velocity_at
    from .compatibility import compatibility_report, compatibility_table, draw_compatibility
    from .conditioning import channel, cut, lowpass, remove_delay, resample, smooth
    from .delay import Delay, time_delay
    from .deletion import decide
    from .differentiate import derivative, derivative_window
    from .eigenmotion import Motion, fit_motion
    from .evaluation.evaluating import Evaluation, evaluate
    from .files import open_biases, save_path, save_record
    from .fit import Fit, open_fit, save_fit
    from .fourier import finite_fourier, harmonics
    from .fourier_smoothing import Smoothed, fourier_smooth
    from .ground_effect.database import replace_ground_effect
    from .ground_effect.identification import identify_ground_effect
    from .ground_effect.result import GroundEffect
    from .inertia import Inertia, inertia_from_flight
    from .inputs.accuracy import Expected, cramer_rao, expected_errors
    from .inputs.designing import Designed, design_input, save_design
    from .inputs.multisines import InputAxis, multisine
    from .inputs.playback import open_timetable, save_timetable
    from .inputs.pulses import in_sequence, multistep, sweep, unit_step
    from .inputs.response import amplitude_within, predict_response, trimmed_start
    from .inputs.specification import read_design
    from .join import merge
    from .joining import Joined, join_fits
    from .lag import remove_lag
    from .likelihood.corrected import corrected_database
    from .likelihood.files import open_output_error, save_output_error
    from .likelihood.flown import output_error
    from .likelihood.in_frequency import frequency_output_error
    from .likelihood.in_time import linear_output_error
    from .likelihood.result import OutputError
    from .likelihood.state_space import LinearModel, linear_model
    from .likelihood.turbulent import filter_error
    from .likelihood.unknowns import Unknown
    from .marking import add_marks, marks
    from .metrics import nrmse, r_squared, theil, theil_shares, validation_report, validation_table
    from .mixed_estimation import Mixed, mixed, prior_of
    from .model import Model
    from .names_map import NameMap, read_names, shipped_maps
    from .partition import Partition, bins, fit_bins
    from .pooling import pool, pool_fits
    from .programme import combine_biases, reconstruct_programme
    from .published import published_fit
    from .quality.assessment import Quality, assess
    from .quality.finding import Finding
    from .raw_contents import contents
    from .reconstruction import Path, reconstruct
    from .record import faults, manoeuvres, overview, read
    from .reduction import between, coefficients, open_states
    from .regression import regress
    from .remarks import Remark
    from .resampling import Bootstrap, Study, bootstrap, monte_carlo
    from .selection.candidates import monomials, spline_terms
    from .selection.orthogonal import select_orthogonal
    from .selection.result import Selection, tally
    from .selection.stepwise import select_stepwise
    from .separable.model import SeparableModel, ShapeParameter
    from .separable.regression import regress_separable
    from .separable.result import SeparableFit
    from .spectrum import regress_frequency
    from .spin.database import polynomial_database
    from .spin.decomposition import nominal_variables, spin_variables, wind_axis_rates
    from .spin.tables import read_polynomials
    from .spin.turned import reconstruct_steep
    from .thrust import fit_thrust
    from .unmeasured import (
        airspeed_from_pressures,
        angular_accelerations,
        complete,
        forces_from_velocity,
        incidence_from_velocity,
        rates_from_attitude,
    )

_HOME = {
    "save_output_error": "likelihood.files",
    "corrected_database": "likelihood.corrected",
    "open_output_error": "likelihood.files",
    "evaluate": "evaluation.evaluating",
    "Evaluation": "evaluation.evaluating",
    "fit_motion": "eigenmotion",
    "Motion": "eigenmotion",
    "Remark": "remarks",
    "assess": "quality.assessment",
    "Quality": "quality.assessment",
    "Finding": "quality.finding",
    "regress_frequency": "spectrum",
    "finite_fourier": "fourier",
    "harmonics": "fourier",
    "Mixed": "mixed_estimation",
    "prior_of": "mixed_estimation",
    "published_fit": "published",
    "join_fits": "joining",
    "Joined": "joining",
    "fit_bins": "partition",
    "bins": "partition",
    "Partition": "partition",
    "inertia_from_flight": "inertia",
    "Inertia": "inertia",
    "bootstrap": "resampling",
    "Bootstrap": "resampling",
    "monte_carlo": "resampling",
    "Study": "resampling",
    "select_stepwise": "selection.stepwise",
    "select_orthogonal": "selection.orthogonal",
    "monomials": "selection.candidates",
    "spline_terms": "selection.candidates",
    "tally": "selection.result",
    "Selection": "selection.result",
    "compatibility_report": "compatibility",
    "compatibility_table": "compatibility",
    "draw_compatibility": "compatibility",
    "Batch": "batch.programme",
    "reconstruct_batch": "batch.programme",
    "visible": "batch.programme",
    "filter_error": "likelihood.turbulent",
    "frequency_output_error": "likelihood.in_frequency",
    "linear_output_error": "likelihood.in_time",
    "linear_model": "likelihood.state_space",
    "LinearModel": "likelihood.state_space",
    "OutputError": "likelihood.result",
    "Unknown": "likelihood.unknowns",
    "output_error": "likelihood.flown",
    "incidence_from_velocity": "unmeasured",
    "airspeed_from_pressures": "unmeasured",
    "forces_from_velocity": "unmeasured",
    "rates_from_attitude": "unmeasured",
    "angular_accelerations": "unmeasured",
    "complete": "unmeasured",
    "true_pressures": "calibrate",
    "incidence_at_cg": "calibrate",
    "vane_true": "calibrate",
    "derivative_window": "differentiate",
    "remove_delay": "conditioning",
    "remove_lag": "lag",
    "smooth": "conditioning",
    "Smoothed": "fourier_smoothing",
    "fourier_smooth": "fourier_smoothing",
    "Delay": "delay",
    "time_delay": "delay",
    "read": "record",
    "manoeuvres": "record",
    "overview": "record",
    "faults": "record",
    "contents": "raw_contents",
    "marks": "marking",
    "add_marks": "marking",
    "merge": "join",
    "save_record": "files",
    "read_names": "names_map",
    "shipped_maps": "names_map",
    "NameMap": "names_map",
    "cut": "conditioning",
    "channel": "conditioning",
    "lowpass": "conditioning",
    "resample": "conditioning",
    "reconstruct": "reconstruction",
    "Path": "reconstruction",
    "reconstruct_programme": "programme",
    "combine_biases": "programme",
    "save_path": "files",
    "open_biases": "files",
    "fit_thrust": "thrust",
    "GroundEffect": "ground_effect.result",
    "identify_ground_effect": "ground_effect.identification",
    "replace_ground_effect": "ground_effect.database",
    "SeparableFit": "separable.result",
    "SeparableModel": "separable.model",
    "ShapeParameter": "separable.model",
    "regress_separable": "separable.regression",
    "force_at_cg": "calibrate",
    "velocity_at": "calibrate",
    "vane_angles": "calibrate",
    "vane_at_cg": "calibrate",
    "derivative": "differentiate",
    "coefficients": "reduction",
    "between": "reduction",
    "open_states": "reduction",
    "Model": "model",
    "regress": "regression",
    "Fit": "fit",
    "save_fit": "fit",
    "open_fit": "fit",
    "mixed": "mixed_estimation",
    "pool": "pooling",
    "pool_fits": "pooling",
    "decide": "deletion",
    "Expected": "inputs.accuracy",
    "cramer_rao": "inputs.accuracy",
    "expected_errors": "inputs.accuracy",
    "Designed": "inputs.designing",
    "design_input": "inputs.designing",
    "save_design": "inputs.designing",
    "InputAxis": "inputs.multisines",
    "multisine": "inputs.multisines",
    "open_timetable": "inputs.playback",
    "save_timetable": "inputs.playback",
    "in_sequence": "inputs.pulses",
    "multistep": "inputs.pulses",
    "sweep": "inputs.pulses",
    "unit_step": "inputs.pulses",
    "amplitude_within": "inputs.response",
    "predict_response": "inputs.response",
    "trimmed_start": "inputs.response",
    "read_design": "inputs.specification",
    "nrmse": "metrics",
    "r_squared": "metrics",
    "theil": "metrics",
    "theil_shares": "metrics",
    "validation_report": "metrics",
    "validation_table": "metrics",
    "polynomial_database": "spin.database",
    "nominal_variables": "spin.decomposition",
    "spin_variables": "spin.decomposition",
    "wind_axis_rates": "spin.decomposition",
    "read_polynomials": "spin.tables",
    "reconstruct_steep": "spin.turned",
}
__all__ = [
    "Batch",
    "Bootstrap",
    "Delay",
    "Designed",
    "Evaluation",
    "Expected",
    "Finding",
    "Fit",
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
    "Quality",
    "Remark",
    "Selection",
    "SeparableFit",
    "SeparableModel",
    "ShapeParameter",
    "Smoothed",
    "Study",
    "Unknown",
    "add_marks",
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
    "fit_motion",
    "fit_thrust",
    "force_at_cg",
    "forces_from_velocity",
    "fourier_smooth",
    "frequency_output_error",
    "harmonics",
    "identify_ground_effect",
    "in_sequence",
    "incidence_at_cg",
    "incidence_from_velocity",
    "inertia_from_flight",
    "join_fits",
    "linear_model",
    "linear_output_error",
    "lowpass",
    "manoeuvres",
    "marks",
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
