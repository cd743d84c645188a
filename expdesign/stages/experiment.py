"""The stage that measures a designed trajectory, or a controller table of it, on the twin."""

from __future__ import annotations

from estimation.twin import Twin
from estimation.twin.truth import MEASUREMENT, repetition_file, write_measurement, write_truth
from expdesign.configuration import InputError
from expdesign.configuration.sizes import MEASURED_ROWS
from expdesign.export.table_file import find_table_file
from expdesign.progress import report_progress
from expdesign.robot import robot_from
from expdesign.runfolder.manifest import text_hash
from expdesign.stages.outcome import Outcome, short
from expdesign.stages.record import clear_outdated
from expdesign.stages.workspace import Workspace

NAME = "experiment"


def perform(work: Workspace) -> Outcome:
    """Simulate, and write the run folder; Ctrl-C keeps the repetitions that are complete."""
    configuration, folder, sources = work.configuration, work.folder, work.sources
    design = work.design()
    warnings = work.warn_of(design)
    table = None
    if sources.table is not None:
        robot = robot_from(configuration.robot)
        table = find_table_file(sources.table.absolute(), robot, design.trajectory)
        work.inputs[NAME] = text_hash(work.inputs[NAME], table.path.name, table.digest)
    report_progress("the motion without noise")
    twin = Twin.of(configuration, design.trajectory if table is None else table)
    if table is not None and table.changed:
        # Not before: the twin refuses what does not hold the design.
        changed = (
            f"{table.path.name} was changed after it was exported: what is executed was not "
            "checked, and its record is taken to hold for its axes and its window"
        )
        work.progress.warn(changed)
        warnings.append(changed)
    repetitions, done = sources.repetitions, 0
    samples = twin.truth.experiment.samples
    made = f"{repetitions} measurements of {samples} samples"
    if excess := MEASURED_ROWS.excess(repetitions * samples, made):
        raise InputError(excess.message, key="--repetitions", allowed=excess.allowed)
    files = clear_outdated(NAME, work)
    status = "done"
    try:
        files |= set(write_truth(twin.truth, folder, repeated=repetitions > 1))
        with work.progress.count("repetitions") as advanced:
            for number in range(1, repetitions + 1):
                file = folder / (repetition_file(number) if repetitions > 1 else MEASUREMENT.file)
                advanced(done, repetitions)
                write_measurement(twin.measurement(number), file)
                files.add(file)
                done = number
                advanced(done, repetitions)
    except KeyboardInterrupt:
        status = "interrupted"
    message = "" if status == "done" else f"interrupted after {done} of {repetitions} measurements"
    truth = twin.truth
    return Outcome(
        result=twin,
        files=tuple(sorted(files)),
        record=truth,
        summary={
            "repetitions": done,
            "periods": truth.experiment.periods,
            "samples": truth.experiment.samples,
            "samples_per_period": truth.experiment.samples_per_period,
            "table": None if truth.table is None else truth.table.file,
            "warnings": [*configuration.warnings, *warnings],
        },
        status=status,
        message=message,
        failure=message and f"{message}; they are in {short(folder)}",
    )
