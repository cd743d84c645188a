"""Configuration: from YAML files to complete, validated runs in SI units.

A file becomes plain data with line numbers (`document`), which pydantic models validate
(`schema`, with `quantity` for keys with units); their errors become a user's problems (`errors`).
`robot` and `run` are the models of the two files, `design`, `experiment`, `estimate` and `export`
those of the run's sections. `loading` resolves a run with its robot.
"""

from expdesign.configuration.errors import ComputationError, InputError, Problem, quote
from expdesign.configuration.estimate import FORCE_CHANNELS, LENGTH_CHANNELS, DataSection
from expdesign.configuration.experiment import ForceTolerance, ValidationMotion
from expdesign.configuration.export import ExportSection, export_section
from expdesign.configuration.loading import ConfigurationLike, load_run
from expdesign.configuration.quantity import quantity_text
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunConfiguration, RunDescription, resolved_yaml
from expdesign.configuration.schema import StageSection

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
    "StageSection",
    "ValidationMotion",
    "export_section",
    "load_run",
    "quantity_text",
    "quote",
    "resolved_yaml",
]
