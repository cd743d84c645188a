"""The columns of the estimation's tables."""

from __future__ import annotations

from expdesign.runfolder.columns import TRAJECTORY
from expdesign.runfolder.described import Column

ESTIMATES = (
    Column("estimator", "", "ls, gm or ml"),
    Column("parameter", "", "name"),
    Column("unit", "", "SI unit of value, std, ci_low, ci_high and a_priori"),
    Column("value", "see unit", "estimate"),
    Column("std", "see unit", "standard deviation; empty for a fixed parameter"),
    Column("ci_low", "see unit", "lower end of the 95 % interval"),
    Column("ci_high", "see unit", "upper end of the 95 % interval"),
    Column("rel_std_percent", "%", "std over the a-priori value; empty without one"),
    Column("a_priori", "see unit", "value in the robot file, no prior"),
    Column("identified", "", "std below half the parameter's scale; empty for a fixed one"),
)
"""Columns of `estimates.csv`."""

_STRUTS = range(1, 7)

MOTION = (
    *TRAJECTORY[:19],
    *(Column(f"q{j}", "m", f"measured length of strut {j}, mean over periods") for j in _STRUTS),
    *(Column(f"q{j}_model", "m", f"length of strut {j} on the estimated motion") for j in _STRUTS),
    *(Column(f"Q{j}", "N", f"measured force of actuator {j}, mean over periods") for j in _STRUTS),
    *(Column(f"Q{j}_model", "N", f"force of actuator {j} by the estimate") for j in _STRUTS),
)
"""Columns of `tables/estimated_motion.csv`."""

TABLES: dict[str, tuple[Column, ...]] = {
    "precision": (
        Column("estimator", "", "ls, gm or ml"),
        Column("parameter", "", "name"),
        Column("std", "SI", "standard deviation"),
        Column("std_forces", "SI", "the share that the noise of the forces makes"),
        Column("std_kinematics", "SI", "the share that the noise of the lengths makes"),
        Column("bound", "SI", "Cramér–Rao bound with noise in forces and lengths"),
    ),
    "noise": (
        Column("recording", "1", "number of the recording"),
        Column("quantity", "", "force or length"),
        Column("row", "1", "strut"),
        Column("column", "1", "strut"),
        Column("covariance", "N^2 or m^2", "of one sample"),
        Column("std_error", "N^2 or m^2", "standard error of the covariance; 0 when it was given"),
    ),
}
