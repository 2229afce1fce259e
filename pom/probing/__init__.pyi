"""Public names of `pom.probing`."""

from .flight_consistency import compare_inputs as compare_inputs
from .flight_consistency import compare_lift as compare_lift
from .input_probe import changed_job as changed_job
from .input_probe import judge_input_change as judge_input_change
from .model_probes import probe_models as probe_models
from .record_leak import find_leaks as find_leaks
from .scatter_probe import measure_scatter as measure_scatter
from .temperature_effect import weigh_temperature as weigh_temperature
from .wind_effect import weigh_wind as weigh_wind
