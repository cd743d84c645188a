"""An estimate in its folder: what is read is what was written, and looks the same."""

import pytest

from estimation.diagnostics.diagnosis import diagnose
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.result import EstimationResult
from results import draw_figures
from results.views.estimate import estimate_view
from results.views.folder import RunFolder
from tests.estimation.cases import measured, run, trajectory

MOTION = trajectory()


@pytest.fixture(scope="module")
def record():
    result = estimate_parameters(run(), measured(MOTION), MOTION)
    diagnosis = diagnose(result.robot, result.experiments, result.priors, result.best)
    return estimation_result(result, diagnosis)


def test_what_is_read_is_written_the_same(record, tmp_path):
    written = record.write(tmp_path / "one")
    assert len(written) == len(set(written)) == 17
    again = EstimationResult.read(tmp_path / "one").write(tmp_path / "two")
    for one, other in zip(written, again, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


@pytest.mark.slow
def test_figures_of_the_folder_are_those_of_the_result(record, tmp_path):
    record.write(tmp_path)
    drawn, anew = (
        draw_figures(
            estimate_view(RunFolder(tmp_path, {}, run(), results={EstimationResult: one})),
            folder,
            ("svg",),
        )
        for one, folder in (
            (record, tmp_path / "memory"),
            (EstimationResult.read(tmp_path), tmp_path),
        )
    )
    assert len(drawn) == 8
    for one, other in zip(drawn, anew, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name
