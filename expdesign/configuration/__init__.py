"""Configuration: from YAML files to complete, validated runs in SI units.

A file becomes plain data with line numbers (`document`), which pydantic models validate
(`section`, with `quantity` and `fields` as types of keys); their errors become a user's problems
(`errors`). `robot` and `run` are the models of the two files, `sections` those of the stages.
`loading` resolves a run with its robot, `writing` writes the result as YAML.
"""

from expdesign.configuration.errors import ComputationError, InputError, Problem, quote
from expdesign.configuration.loading import ConfigurationLike, load_run
from expdesign.configuration.quantity import quantity_text
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunConfiguration, RunDescription
from expdesign.configuration.section import StageSection
from expdesign.configuration.sections.data import FORCE_CHANNELS, LENGTH_CHANNELS, DataSection
from expdesign.configuration.sections.export import ExportSection, export_section
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
    "StageSection",
    "ValidationMotion",
    "export_section",
    "load_run",
    "quantity_text",
    "quote",
    "resolved_yaml",
]
