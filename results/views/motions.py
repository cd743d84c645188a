"""View of several motions of one experiment."""

from __future__ import annotations

from expdesign.experiment.motions import MotionsResult
from expdesign.information.criteria import criteria
from results.notation import duration, readable
from results.views.design import parameters_table, precision_facts
from results.views.folder import RunFolder
from results.views.parameter_blocks import derived_blocks
from results.views.view import (
    Block,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)

_READ = (
    "Every motion has a run folder like a single design, with its limits, figures and tables. The "
    "criterion and the predicted σ are those of all recordings together. The motions were found "
    "one after another, then each was improved with the others fixed: {}."
)


def motions_view(folder: RunFolder) -> StageView:
    """Return the view of the motions in a folder."""
    result = folder.result(MotionsResult)
    blocks: tuple[Block, ...] = (
        TextBlock(_READ.format(result.ended)),
        ReportTable.of("motions", "Motions", _MOTIONS, result.motions, screen=True, latex=True),
        *derived_blocks("motions_derived", result.derived, "with the σ predicted for all motions"),
        parameters_table(result),
        ReportTable.of(
            "motions_search", "Searches of the motions", _SEARCHES, result.searches, folded=True
        ),
    )
    return StageView(
        _verdict(result), blocks, _facts(result), result.warnings, heading="Several motions"
    )


_MOTIONS = (
    TableColumn("motion", of="number"),
    TableColumn("status", kind="outcome", of="status"),
    TableColumn("period", "s", of="period"),
    TableColumn("periods", of="periods"),
    TableColumn("measuring", "s", of="measuring_time"),
    TableColumn("log det F alone", digits=5, of="log_det_information"),
    TableColumn("proved", of="certified", proof=True),
    TableColumn("folder", kind="text", of="folder"),
)
_SEARCHES = (
    TableColumn("search", of="search"),
    TableColumn("motion", of="motion"),
    TableColumn("phase", kind="text", of="phase"),
    TableColumn("criterion", digits=6, of="criterion_value"),
    TableColumn("gain", "%", digits=3, of="gain_percent"),
    TableColumn("accepted", kind="text", of="accepted"),
)


def _verdict(result: MotionsResult) -> StageVerdict:
    wrong = [one for one in result.motions if one.status not in ("converged", "not converged")]
    proved = all(one.certified for one in result.motions)
    sentence = (
        f"{len(result.motions)} motions, {duration(result.measuring_time)} of measuring together."
    )
    if wrong:
        listed = ", ".join(f"motion {one.number}: {one.status}" for one in wrong)
        return StageVerdict(
            "Motions", Level.BAD, wrong[0].status, f"{sentence} {listed}.", "motions"
        )
    if result.interrupted:
        sentence += " The searches were interrupted: these are the best found until then."
        return StageVerdict("Motions", Level.BAD, "interrupted", sentence, "motions")
    how = "proved for every instant" if proved else "but not proved for every instant"
    sentence += f" Every limit is kept by each of them, {how}."
    level = Level.GOOD if proved else Level.CAUTION
    return StageVerdict("Motions", level, "designed", sentence, "motions")


def _facts(result: MotionsResult) -> tuple[Fact, ...]:
    note = f"of the mean information over one period, {result.samples} samples"
    title = criteria()[result.criterion].named("F")
    return (
        Fact(title, readable(result.criterion_value, 6), note),
        *precision_facts(result.parameters),
    )
