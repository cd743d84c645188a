"""The columns of the studies' tables."""

from __future__ import annotations

from expdesign.runfolder.described import Column

_SET = Column("set", "1", "set of initial parameters")
_KINEMATICS = Column(
    "kinematics", "", "exact (no noise of the lengths), fourier or central differentiation"
)
_ESTIMATOR = Column("estimator", "", "ls, gm or ml")
_PARAMETER = Column("parameter", "", "name")
_UNIT = Column("unit", "", "SI unit of the columns that refer to it")
_TRUTH = Column("truth", "see unit", "true value")
_ACTUATORS = range(1, 7)

TABLES: dict[str, tuple[Column, ...]] = {
    "study_designs": (
        _SET,
        Column("criterion", "", "criterion of the design"),
        Column("folder", "", "run folder of the design"),
        Column("status", "", "how the search ended"),
        Column("keeps_limits", "", "on the fine grid, unsmoothed model"),
        Column("log_det_information", "1", "log det F over the samples of one period, SI"),
        Column("condition_si", "1", "condition number of F, SI"),
        Column("condition_nominal", "1", "condition number of F scaled by the nominal parameters"),
        Column("period", "s", "of the motion"),
        Column("strut_speed", "m/s", "rms over struts and time"),
        Column("strut_acceleration", "m/s^2", "rms over struts and time"),
        Column("failed", "1", "repetitions without an estimate"),
    ),
    "study_precision": (
        _SET,
        Column("criterion", "", "criterion of the design"),
        _KINEMATICS,
        _ESTIMATOR,
        _PARAMETER,
        _UNIT,
        _TRUTH,
        Column("mean", "see unit", "mean of the estimates"),
        Column("std", "see unit", "standard deviation of the estimates"),
        Column("predicted_std", "see unit", "predicted with exact kinematics"),
    ),
    "study_determinants": (
        _SET,
        _KINEMATICS,
        _ESTIMATOR,
        Column("log_det_first", "1", "log det of the achieved covariance, first criterion"),
        Column("log_det_second", "1", "the same of the second criterion"),
        Column("difference", "1", "second less first"),
        Column("std_error", "1", "of the difference, from the number of repetitions"),
        Column("rigid_body_smaller", "1", "rigid-body parameters the first knows better"),
        Column("friction_smaller", "1", "friction parameters the first knows better"),
    ),
    "study_agreement": (
        _SET,
        Column("criterion", "", "criterion of the design"),
        _ESTIMATOR,
        Column("variance_ratio", "1", "achieved over predicted variance, mean over parameters"),
        Column("std_error", "1", "from the scatter between repetitions"),
        Column("z", "1", "ratio less one, in standard errors"),
    ),
    "study_means": (
        _SET,
        _KINEMATICS,
        _PARAMETER,
        _UNIT,
        Column("difference", "see unit", "mean LS estimate, second less first criterion"),
        Column("std_error", "see unit", "of the difference"),
        Column("t", "1", "their ratio (Welch)"),
        Column("p_value", "1", "two-sided, corrected for the number of parameters (Holm)"),
        Column("p_joint", "1", "of all parameters together (Hotelling)"),
    ),
    "study_estimates": (
        Column("case", "", "undisturbed, pointwise or tracking"),
        _ESTIMATOR,
        _PARAMETER,
        _UNIT,
        _TRUTH,
        Column("identified", "", "ML knows it to less than half its scale"),
        Column("value", "see unit", "estimate of the first experiment"),
        Column("std", "see unit", "as stated with it"),
        Column("mean", "see unit", "over all experiments"),
        Column("bias", "see unit", "mean less truth"),
        Column("bias_std_error", "see unit", "its standard error"),
        Column("bias_t", "1", "bias in standard errors"),
        Column("bias_over_std", "1", "bias in standard deviations as stated for one experiment"),
        Column("hausman_z", "1", "ML − GM of the first experiment over its standard deviation"),
        Column("hausman_p", "1", "two-sided, corrected for the number of parameters (Holm)"),
    ),
    "study_hausman": (
        Column("case", "", "undisturbed, pointwise or tracking"),
        Column("experiment", "1", "number"),
        Column("p_joint", "1", "of the difference of GM and ML, all parameters"),
        Column("largest_z", "1", "largest difference of a parameter over its standard deviation"),
        Column("parameter", "", "that it is of"),
        Column("disturbed", "", "whether the information matrix is, by this test"),
        Column("harmonics", "1", "that ML found in the lengths"),
    ),
    "study_variances": (
        Column("situation", "", "cogging nowhere, unknown to the model, or in both experiments"),
        Column("motion", "", "predicted motion"),
        Column("actuator", "1", "number"),
        Column("variance_model_error", "N^2", "about the prediction, mean over runs"),
        Column("variance_measurement_error", "N^2", "of the noise, mean over runs"),
        Column("fails", "1", "runs in which the actuator fails the lack-of-fit test"),
        Column("runs", "1", "identifications"),
    ),
    "study_verdicts": (
        Column("run", "1", "identification"),
        Column("situation", "", "cogging nowhere, unknown to the model, or in both experiments"),
        Column("motion", "", "predicted motion"),
        *(Column(f"fails_{j}", "", f"actuator {j} fails the lack-of-fit test") for j in _ACTUATORS),
        Column("against", "", "assumptions that fail, separated by semicolons"),
    ),
    "study_power": (
        _PARAMETER,
        Column("factor", "1", "by which it is wrong"),
        Column("seen", "1", "runs in which a test fails"),
        Column("runs", "1", "identifications"),
        Column("power", "1", "share of the runs"),
        Column("low", "1", "lower end of its 95 % interval"),
        Column("high", "1", "upper end of its 95 % interval"),
        Column("tests", "", "tests that fail, with their number of runs"),
    ),
}
"""By the table's name."""
