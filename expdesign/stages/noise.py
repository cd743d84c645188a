"""Stage that analyses the noise of a recording, without any model."""

from __future__ import annotations

from typing import Any

from numpy.linalg import LinAlgError

from expdesign.configuration import RunConfiguration
from expdesign.progress import report_progress
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, StageFailed, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView


class NoiseStage(Stage):
    """Noise analysis of a recording."""

    name = "noise"
    does = "analyses the noise of a recording"
    file = "noise.json"
    writes = ("noise.yaml", *TABLES)
    sections = run_sections("trajectory", "data")
    needs = ("recording",)

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from estimation.diagnostics.noise_result import NoiseResult

        return NoiseResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the analysis."""
        from results.views.noise import noise_view

        del brief
        return noise_view(folder)

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return no reason: a recording can be analysed in every run."""
        del configuration
        return ""

    def run(self, work: Workspace) -> Outcome:
        """Analyse the noise of a recording."""
        from estimation.diagnostics import noise_analysis
        from estimation.identification.periods import fold_noise_recording

        (file,) = work.data_files()
        (trajectory,) = work.recorded_designs(1)
        report_progress("reading the recording")
        recording = work.recording(file)
        for warning in recording.warnings:
            work.progress.warn(warning)
        samples = fold_noise_recording(
            work.configuration, recording, trajectory, certain=bool(work.sources.designs)
        )
        try:
            record = noise_analysis.analyse_noise(samples, str(file))
        except LinAlgError as error:
            raise StageFailed(
                "the noise cannot be determined from these data: a channel is constant, or the sum "
                f"of others ({error})"
            ) from error
        return Outcome(
            result=samples,
            record=record,
            summary={**record.as_data(), "for_the_robot_file": record.block},
        )
