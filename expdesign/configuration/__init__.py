"""Configuration: from YAML files to complete, validated descriptions in SI units."""

from expdesign.configuration.data import CHANNELS, FORCE_CHANNELS, LENGTH_CHANNELS, DataSection
from expdesign.configuration.design import DesignSection
from expdesign.configuration.display import quantity_text
from expdesign.configuration.document import document_from_mapping
from expdesign.configuration.estimate import EstimateSection, Prior
from expdesign.configuration.experiment import Cogging, ExperimentSection, Outliers, TrackingError
from expdesign.configuration.export import OFFERS, STRUT_ONLY, ExportSection, Space
from expdesign.configuration.failure import nearest, shown
from expdesign.configuration.finding import find_robot, find_run
from expdesign.configuration.geometry import (
    condition_at_home,
    home_geometry,
    rotation_matrix,
    shared_joint_pairs,
)
from expdesign.configuration.limits import row_labels
from expdesign.configuration.montecarlo import MonteCarloSection
from expdesign.configuration.motion import MotionSection
from expdesign.configuration.noise_section import NoiseDescription
from expdesign.configuration.problem import InputError, Problem, key_path
from expdesign.configuration.quantity import (
    CURRENT,
    DURATION,
    FORCE,
    LENGTH,
    Dimension,
    dimension_of,
    unit_dimension,
)
from expdesign.configuration.report import ReportSection
from expdesign.configuration.resolved import (
    ResolvedNoise,
    ResolvedRobot,
    RunConfiguration,
)
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.robot_section import RobotDescription
from expdesign.configuration.run import load_run
from expdesign.configuration.run_section import STAGES, RunDescription
from expdesign.configuration.smoothing import smoothing_widths
from expdesign.configuration.study import Kinematics, StudySection
from expdesign.configuration.trajectory import TrajectorySection
from expdesign.configuration.validation import validate
from expdesign.configuration.validation_section import ValidationMotion
from expdesign.configuration.writing import resolved_yaml

__all__ = [
    "CHANNELS",
    "CURRENT",
    "DURATION",
    "FORCE",
    "FORCE_CHANNELS",
    "LENGTH",
    "LENGTH_CHANNELS",
    "OFFERS",
    "STAGES",
    "STRUT_ONLY",
    "Cogging",
    "DataSection",
    "DesignSection",
    "Dimension",
    "EstimateSection",
    "ExperimentSection",
    "ExportSection",
    "InputError",
    "Kinematics",
    "MonteCarloSection",
    "MotionSection",
    "NoiseDescription",
    "Outliers",
    "Prior",
    "Problem",
    "ReportSection",
    "ResolvedNoise",
    "ResolvedRobot",
    "RobotDescription",
    "RunConfiguration",
    "RunDescription",
    "Space",
    "StudySection",
    "TrackingError",
    "TrajectorySection",
    "ValidationMotion",
    "condition_at_home",
    "dimension_of",
    "document_from_mapping",
    "find_robot",
    "find_run",
    "home_geometry",
    "key_path",
    "load_robot_description",
    "load_run",
    "nearest",
    "quantity_text",
    "resolved_yaml",
    "rotation_matrix",
    "row_labels",
    "shared_joint_pairs",
    "shown",
    "smoothing_widths",
    "unit_dimension",
    "validate",
]
