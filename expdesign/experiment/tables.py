"""The columns of the design's tables."""

from __future__ import annotations

from expdesign.runfolder.described import Column

TABLES: dict[str, tuple[Column, ...]] = {
    "limits": (
        Column("limit", "", "key of the limit in the YAML"),
        Column("title", "", "the limit in words"),
        Column("row", "", "component, strut or pair of struts that comes closest to the bound"),
        Column("unit", "", "unit of value and bound"),
        Column("value", "see unit", "worst value over the whole period, unsmoothed model"),
        Column("bound", "see unit", "bound that it comes closest to"),
        Column(
            "violation",
            "1",
            "excess over the bound as a share of the limit's range (max - min; |bound| of a "
            "one-sided limit); negative: what is left",
        ),
        Column("time", "s", "when, from the start of the period"),
        Column("origin", "", "where the bound was given"),
    ),
    "parameters": (
        Column("parameter", "", "name"),
        Column("unit", "", "SI unit of nominal value and standard deviations"),
        Column("nominal", "see unit", "nominal value"),
        Column("std_per_period", "see unit", "predicted standard deviation, one period"),
        Column("std_experiment", "see unit", "predicted standard deviation, whole experiment"),
        Column("rel_std_percent_per_period", "%", "of the nominal value; empty where that is 0"),
        Column("rel_std_percent_experiment", "%", "of the nominal value; empty where that is 0"),
    ),
    "starts": (
        Column("start", "1", "number of the start, from 1; hops go on counting"),
        Column("kind", "", "random, or hop; every second of those after the starts is random"),
        Column("criterion_value", "", "criterion of the motion reached, within its limits"),
        Column("finished_value", "", "the same after its finish; empty for those not finished"),
        Column("iterations", "1", "iterations of all stages"),
        Column("converged", "", "whether the last stage converged"),
        Column("status", "", "how the last stage ended"),
        Column("best", "", "whether the design came from it: the best of the finished"),
    ),
    "convergence": (
        Column("start", "1", "number of the start"),
        Column("kind", "", "random or hop"),
        Column("stage", "", "stage of the continuation"),
        Column("iteration", "1", "iteration, counted over the stages"),
        Column("objective", "", "smoothed criterion, as it is reported"),
        Column("violation", "1", "largest violation in the NLP, share of the limit's range"),
    ),
    "eigenvalues": (
        Column("index", "1", "from the smallest"),
        Column("eigenvalue", "1", "of F scaled to unit diagonal"),
        Column("eigenvalue_nominal", "1", "of F with each parameter in units of its nominal value"),
    ),
    "information": (
        Column("parameter", "", "row of F; the other columns are its columns, SI units"),
    ),
}
"""By the table's name; the files are ``tables/<name>.csv``."""
