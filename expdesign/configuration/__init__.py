"""Configuration: from YAML files to complete, validated descriptions in SI units.

`document` reads YAML as plain data with lines, `section` validates it, `problem` says what is
wrong. `values` are what may stand at a key, `sections` what may stand in a run file. `robot` and
`run` are the two files; `loading` puts them together, `writing` writes the whole again.
"""

from expdesign.configuration.document import document_from_mapping, read_text
from expdesign.configuration.limits import row_labels
from expdesign.configuration.loading import ConfigurationLike, load_run, smoothing_widths
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.problem import (
    ComputationError,
    InputError,
    Problem,
    format_number,
    key_path,
    nearest,
    shown,
)
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    load_robot_description,
)
from expdesign.configuration.run import ReportSection, RunConfiguration, RunDescription
from expdesign.configuration.section import validate
from expdesign.configuration.sections.data import (
    CHANNELS,
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    EstimateSection,
    MonteCarloSection,
)
from expdesign.configuration.sections.design import DesignSection, MotionSection, TrajectorySection
from expdesign.configuration.sections.experiment import (
    Cogging,
    ExperimentSection,
    Kinematics,
    Outliers,
    StudySection,
    TrackingError,
    ValidationMotion,
)
from expdesign.configuration.sections.export import OFFERS, STRUT_ONLY, ExportSection, Space
from expdesign.configuration.values.quantity import (
    CURRENT,
    DURATION,
    FORCE,
    LENGTH,
    Dimension,
    quantity_text,
    unit_dimension,
)
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
    "STRUT_ONLY",
    "Cogging",
    "ComputationError",
    "ConfigurationLike",
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
    "Problem",
    "ReportSection",
    "ResolvedRobot",
    "RobotDescription",
    "RunConfiguration",
    "RunDescription",
    "Space",
    "StudySection",
    "TrackingError",
    "TrajectorySection",
    "ValidationMotion",
    "document_from_mapping",
    "format_number",
    "key_path",
    "load_robot_description",
    "load_run",
    "nearest",
    "quantity_text",
    "read_text",
    "resolved_yaml",
    "row_labels",
    "shown",
    "smoothing_widths",
    "unit_dimension",
    "validate",
]
