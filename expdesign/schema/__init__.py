"""What may stand in the YAML files: plain data, validated key by key, in SI units."""

from expdesign.schema.data import DataSection
from expdesign.schema.design import DesignSection
from expdesign.schema.estimate import EstimateSection, Prior
from expdesign.schema.experiment import ExperimentSection
from expdesign.schema.export import ExportSection
from expdesign.schema.montecarlo import MonteCarloSection
from expdesign.schema.motion import MotionSection
from expdesign.schema.noise import NoiseDescription
from expdesign.schema.parameters import (
    GENERAL_PARAMETERS,
    PARAMETER_DIMENSIONS,
    SYMMETRIC_PARAMETERS,
    ParametersDescription,
)
from expdesign.schema.quantity import Dimension, dimension_of
from expdesign.schema.report import ReportSection
from expdesign.schema.robot import RobotDescription
from expdesign.schema.run import STAGES, RunDescription
from expdesign.schema.trajectory import TrajectorySection
from expdesign.schema.validation import ValidationMotion

__all__ = [
    "GENERAL_PARAMETERS",
    "PARAMETER_DIMENSIONS",
    "STAGES",
    "SYMMETRIC_PARAMETERS",
    "DataSection",
    "DesignSection",
    "Dimension",
    "EstimateSection",
    "ExperimentSection",
    "ExportSection",
    "MonteCarloSection",
    "MotionSection",
    "NoiseDescription",
    "ParametersDescription",
    "Prior",
    "ReportSection",
    "RobotDescription",
    "RunDescription",
    "TrajectorySection",
    "ValidationMotion",
    "dimension_of",
]
