"""Public names of `pom.fmu`."""

from .models import Models as Models
from .process import close_all as close_all
from .simulate import fly_job as fly
from .simulate import fly_job as fly_job
