"""Public names of `flighttest` and where they are defined; ``__init__.py`` loads them from this list."""

from .aircraft_properties.eigenmotion import Motion as Motion
from .aircraft_properties.eigenmotion import fit_motion as fit_motion
from .aircraft_properties.inertia import Inertia as Inertia
from .aircraft_properties.inertia import inertia_from_flight as inertia_from_flight
from .aircraft_properties.thrust_table import fit_thrust as fit_thrust
from .combining.data_partition import Partition as Partition
from .combining.data_partition import bins as bins
from .combining.data_partition import fit_bins as fit_bins
from .combining.joined_fits import Joined as Joined
from .combining.joined_fits import join_fits as join_fits
from .combining.mixed_estimation import Mixed as Mixed
from .combining.mixed_estimation import mixed as mixed
from .combining.mixed_estimation import prior_of as prior_of
from .combining.pooling import pool as pool
from .combining.pooling import pool_fits as pool_fits
from .combining.published import published_fit as published_fit
from .control_loading.database import replace_hinge_moments as replace_hinge_moments
from .control_loading.identification import identify_control_loading as identify_control_loading
from .control_loading.loading import ControlLoading as ControlLoading
from .control_loading.result import IdentifiedLoading as IdentifiedLoading
from .dynamics.derived_channels import (
    airspeed_from_pressures as airspeed_from_pressures,
)
from .dynamics.derived_channels import (
    angular_accelerations as angular_accelerations,
)
from .dynamics.derived_channels import (
    complete as complete,
)
from .dynamics.derived_channels import (
    forces_from_velocity as forces_from_velocity,
)
from .dynamics.derived_channels import (
    incidence_from_velocity as incidence_from_velocity,
)
from .dynamics.derived_channels import (
    rates_from_attitude as rates_from_attitude,
)
from .dynamics.force_coefficients import between as between
from .dynamics.force_coefficients import coefficients as coefficients
from .dynamics.force_coefficients import open_states as open_states
from .engine.fuel_thrust import FuelThrust as FuelThrust
from .engine.fuel_thrust import fit_fuel_thrust as fit_fuel_thrust
from .engine.result import EngineFit as EngineFit
from .engine.result import identify_engine as identify_engine
from .engine.spools import SpoolFit as SpoolFit
from .engine.spools import identify_spools as identify_spools
from .engine.starting import StartFit as StartFit
from .engine.starting import identify_start as identify_start
from .engine.static import DeckCorrection as DeckCorrection
from .engine.static import Polar as Polar
from .engine.static import correct_deck as correct_deck
from .equation_error.fit import Fit as Fit
from .equation_error.fit import open_fit as open_fit
from .equation_error.fit import save_fit as save_fit
from .equation_error.frequency_domain import regress_frequency as regress_frequency
from .equation_error.model import Model as Model
from .equation_error.resampling import Bootstrap as Bootstrap
from .equation_error.resampling import Study as Study
from .equation_error.resampling import bootstrap as bootstrap
from .equation_error.resampling import monte_carlo as monte_carlo
from .equation_error.time_domain import regress as regress
from .evaluation.flight_evaluation import evaluate as evaluate
from .evaluation.result import Evaluation as Evaluation
from .expressions.separable_model import SeparableModel as SeparableModel
from .expressions.separable_model import ShapeParameter as ShapeParameter
from .ground_effect.database import replace_ground_effect as replace_ground_effect
from .ground_effect.identification import identify_ground_effect as identify_ground_effect
from .ground_effect.result import GroundEffect as GroundEffect
from .input_design.design import Designed as Designed
from .input_design.design import design_input as design_input
from .input_design.design import save_design as save_design
from .input_design.input_accuracy import Expected as Expected
from .input_design.input_accuracy import cramer_rao as cramer_rao
from .input_design.input_accuracy import expected_errors as expected_errors
from .input_design.multisines import InputAxis as InputAxis
from .input_design.multisines import multisine as multisine
from .input_design.multisteps import in_sequence as in_sequence
from .input_design.multisteps import multistep as multistep
from .input_design.multisteps import sweep as sweep
from .input_design.multisteps import unit_step as unit_step
from .input_design.predicted_response import (
    amplitude_within as amplitude_within,
)
from .input_design.predicted_response import (
    predict_response as predict_response,
)
from .input_design.predicted_response import (
    trimmed_start as trimmed_start,
)
from .input_design.specification import read_design as read_design
from .input_design.timetable import open_timetable as open_timetable
from .input_design.timetable import save_timetable as save_timetable
from .maximum_likelihood.estimates_to_database import updated_database as updated_database
from .maximum_likelihood.files import open_output_error as open_output_error
from .maximum_likelihood.files import save_output_error as save_output_error
from .maximum_likelihood.frequency_domain import frequency_output_error as frequency_output_error
from .maximum_likelihood.linear_time_domain import linear_output_error as linear_output_error
from .maximum_likelihood.models.state_space import LinearModel as LinearModel
from .maximum_likelihood.models.state_space import linear_model as linear_model
from .maximum_likelihood.parameters import Unknown as Unknown
from .maximum_likelihood.process_noise import filter_error as filter_error
from .maximum_likelihood.result import OutputError as OutputError
from .maximum_likelihood.time_domain import output_error as output_error
from .model_structure.candidates import monomials as monomials
from .model_structure.candidates import spline_terms as spline_terms
from .model_structure.deletion_rule import decide as decide
from .model_structure.orthogonal_functions import select_orthogonal as select_orthogonal
from .model_structure.selection import Selection as Selection
from .model_structure.selection import tally as tally
from .model_structure.stepwise import select_stepwise as select_stepwise
from .quality.assessment import assess as assess
from .quality.finding import Finding as Finding
from .quality.result import Quality as Quality
from .readers.name_map import NameMap as NameMap
from .readers.name_map import read_names as read_names
from .readers.name_map import shipped_maps as shipped_maps
from .reconstruction.batch.programme import Batch as Batch
from .reconstruction.batch.programme import reconstruct_batch as reconstruct_batch
from .reconstruction.batch.programme import visible as visible
from .reconstruction.compatibility import (
    compatibility_report as compatibility_report,
)
from .reconstruction.compatibility import (
    compatibility_table as compatibility_table,
)
from .reconstruction.compatibility import (
    draw_compatibility as draw_compatibility,
)
from .reconstruction.flight_programme import combine_biases as combine_biases
from .reconstruction.flight_programme import reconstruct_programme as reconstruct_programme
from .reconstruction.path_files import open_biases as open_biases
from .reconstruction.path_files import save_path as save_path
from .reconstruction.smoother import Path as Path
from .reconstruction.smoother import reconstruct as reconstruct
from .records.file_contents import contents as contents
from .records.files import save_record as save_record
from .records.joining import merge as merge
from .records.record import faults as faults
from .records.record import manoeuvres as manoeuvres
from .records.record import overview as overview
from .records.record import read as read
from .remarks import Remark as Remark
from .sensors.position_corrections import (
    force_at_cg as force_at_cg,
)
from .sensors.position_corrections import (
    incidence_at_cg as incidence_at_cg,
)
from .sensors.position_corrections import (
    true_pressures as true_pressures,
)
from .sensors.position_corrections import (
    vane_angles as vane_angles,
)
from .sensors.position_corrections import (
    vane_at_cg as vane_at_cg,
)
from .sensors.position_corrections import (
    vane_true as vane_true,
)
from .sensors.position_corrections import (
    velocity_at as velocity_at,
)
from .separable.regression import regress_separable as regress_separable
from .separable.result import SeparableFit as SeparableFit
from .signals.conditioning import (
    channel as channel,
)
from .signals.conditioning import (
    cut as cut,
)
from .signals.conditioning import (
    lowpass as lowpass,
)
from .signals.conditioning import (
    remove_delay as remove_delay,
)
from .signals.conditioning import (
    resample as resample,
)
from .signals.conditioning import (
    smooth as smooth,
)
from .signals.delays import Delay as Delay
from .signals.delays import time_delay as time_delay
from .signals.differentiation import derivative as derivative
from .signals.differentiation import derivative_window as derivative_window
from .signals.first_order_lag import remove_lag as remove_lag
from .signals.fourier import finite_fourier as finite_fourier
from .signals.fourier import harmonics as harmonics
from .signals.fourier_smoothing import Smoothed as Smoothed
from .signals.fourier_smoothing import fourier_smooth as fourier_smooth
from .signals.sample_flags import add_flags as add_flags
from .signals.sample_flags import flags as flags
from .spin.database import polynomial_database as polynomial_database
from .spin.decomposition import nominal_variables as nominal_variables
from .spin.decomposition import spin_variables as spin_variables
from .spin.decomposition import wind_axis_rates as wind_axis_rates
from .spin.steep_reconstruction import reconstruct_steep as reconstruct_steep
from .spin.tables import read_polynomials as read_polynomials
from .uncertainty.goodness_of_fit import (
    nrmse as nrmse,
)
from .uncertainty.goodness_of_fit import (
    r_squared as r_squared,
)
from .uncertainty.goodness_of_fit import (
    theil as theil,
)
from .uncertainty.goodness_of_fit import (
    theil_shares as theil_shares,
)
from .uncertainty.goodness_of_fit import (
    validation_report as validation_report,
)
from .uncertainty.goodness_of_fit import (
    validation_table as validation_table,
)
