"""Stage that measures a designed trajectory, or a controller table of it, on the twin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.progress import report_progress
from expdesign.robot import robot_from
from expdesign.runfolder.manifest import text_hash
from expdesign.stages.execution import clear_outdated
from expdesign.stages.stage import Stage, run_sections, sweep_reason
from expdesign.stages.workspace import MEASUREMENT_FILE, Outcome, Workspace, short
from results.views.folder import RunFolder
from results.views.view import StageView


class ExperimentStage(Stage):
    """Simulated experiment on the digital twin."""

    name = "experiment"
    does = "measures the trajectory on the digital twin"
    file = "truth.json"
    output = MEASUREMENT_FILE
    writes = ("columns.json", MEASUREMENT_FILE, "repetitions/*/measurement.csv")
    sections = run_sections("experiment")
    needs = ("design",)

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from estimation.twin.truth import Truth

        return Truth

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the simulated recording."""
        from results.views.experiment import experiment_view

        del brief
        return experiment_view(folder)

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason against a simulation: a measured recording, or a sweep."""
        file = configuration.run.data.file
        measured = "" if file is None else f"the data is measured: {short(Path(file))}"
        return measured or sweep_reason(configuration)

    def run(self, work: Workspace) -> Outcome:
        """Simulate, and write the run folder; Ctrl-C keeps the complete repetitions."""
        from estimation.twin import Twin
        from estimation.twin.truth import repetition_file, write_measurement, write_truth
        from expdesign.export.table_file import find_table_file

        configuration, folder, sources = work.configuration, work.folder, work.sources
        design = work.design()
        warnings = work.warn_of(design)
        table = None
        if sources.table is not None:
            robot = robot_from(configuration.robot)
            table = find_table_file(sources.table.absolute(), robot, design.trajectory)
            work.inputs[self.name] = text_hash(
                work.inputs[self.name], table.path.name, table.digest
            )
        report_progress("the motion without noise")
        twin = Twin.of(configuration, design.trajectory if table is None else table)
        if table is not None and table.changed:
            # Afterwards, since the twin refuses a table of another motion.
            changed = (
                f"{table.path.name} was changed after it was exported: the executed motion was not "
                "checked, and the description of its axes and window may be wrong"
            )
            work.progress.warn(changed)
            warnings.append(changed)
        repetitions, done = sources.repetitions, 0
        files = clear_outdated(self.name, work)
        status = "done"
        try:
            files |= set(write_truth(twin.truth, folder, repeated=repetitions > 1))
            with work.progress.count("repetitions") as advanced:
                for number in range(1, repetitions + 1):
                    file = folder / (
                        repetition_file(number) if repetitions > 1 else MEASUREMENT_FILE
                    )
                    advanced(done, repetitions)
                    write_measurement(twin.measurement(number), file)
                    files.add(file)
                    done = number
                    advanced(done, repetitions)
        except KeyboardInterrupt:
            status = "interrupted"
        message = (
            "" if status == "done" else f"interrupted after {done} of {repetitions} measurements"
        )
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
