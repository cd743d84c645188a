"""Configuration: from YAML files to complete, validated descriptions in SI units.

`document` reads YAML as plain data with lines, `section` validates it, `problem` says what is
wrong. `values` are what may stand at a key, `sections` what may stand in a run file. `robot` and
`run` are the two files; `loading` puts them together, `writing` writes the whole again.
"""

from expdesign.configuration.errors import ComputationError, InputError, Problem, shown
from expdesign.configuration.loading import ConfigurationLike, load_run
from expdesign.configuration.quantity import quantity_text
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunConfiguration, RunDescription
from expdesign.configuration.sections.data import FORCE_CHANNELS, LENGTH_CHANNELS, DataSection
from expdesign.configuration.sections.export import ExportSection
from expdesign.configuration.sections.motions import ForceTolerance, ValidationMotion
from expdesign.configuration.writing import resolved_yaml

__all__ = [
    "FORCE_CHANNELS",
    "LENGTH_CHANNELS",
    "ComputationError",
    "ConfigurationLike",
    "DataSection",
    "ExportSection",
    "ForceTolerance",
    "InputError",
    "Problem",
    "ResolvedRobot",
    "RunConfiguration",
    "RunDescription",
    "ValidationMotion",
    "load_run",
    "quantity_text",
    "resolved_yaml",
    "shown",
]
