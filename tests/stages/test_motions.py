"""Several motions of one run: folders of single designs, and one estimate of all recordings."""

import json
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from typer.testing import CliRunner

import expdesign
from estimation.identification.result import EstimateFile
from expdesign.cli.app import app
from expdesign.cli.certify import CertifiedPart, certified_motions
from expdesign.configuration import InputError, load_run
from expdesign.experiment import DesignResult
from expdesign.experiment.design import FoundMotion
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.motions import MotionsResult, design_motions
from expdesign.experiment.next_motion import next_run
from expdesign.experiment.setup import plan_search, probe_motion
from expdesign.export.certification import PathCertificate
from expdesign.information.fisher import information_matrix
from expdesign.solver.search import NoDesignError, SearchResult
from expdesign.solver.starts import StartResult
from expdesign.stages.execution import keep_search
from expdesign.stages.stage import Workspace
from expdesign.workers import Monitor, StoppedError
from tests.blank_figures import blank_figures
from tests.tiny_run import tiny_run

COUNT = 2


def _run(**changes):
    trajectory = {"count": COUNT, **changes.pop("trajectory", {})}
    return tiny_run(trajectory=trajectory, experiment={"periods": 4, "seed": 3}, **changes)


def _finder(made):
    """Return a search that finds random motions within the limits; `made` gets their origins."""

    def find(configuration, _monitor, _journal, others, origin):
        plan = plan_search(configuration, others)
        motion = probe_motion(plan, len(made))
        start = StartResult(1, "finish", plan.problem.variables.pack(motion), trajectory=motion)
        made.append(origin)
        found = SearchResult(start, start, (start,), {1: 0.0}, False, 1.0, 1.0, "made up")
        return FoundMotion(plan, noise_evaluator(configuration), found)

    return find


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place, made = tmp_path_factory.mktemp("motions") / "run", []
    find = _finder(made)
    with blank_figures(), patch("expdesign.experiment.motions.find_motion", find):
        found = expdesign.run(_run(), place)
        again = expdesign.run(_run(), place)
    assert made[:COUNT] == [None] * COUNT
    assert None not in made[COUNT:]
    wanted = ["motions", "motion-1/experiment", "motion-2/experiment"]
    assert list(found.stages) == wanted
    assert all(outcome.kept for outcome in again.stages.values())
    return place


def test_every_motion_has_the_folder_of_a_design(folder):
    result = MotionsResult.read(folder)
    assert not result.interrupted
    assert {one.status for one in result.motions} <= {"converged", "not converged"}
    for number, one in enumerate(result.motions, start=1):
        place = folder / one.folder
        design, run = DesignResult.read(place), load_run(place / "run.yaml").run
        assert (run.trajectory.count, run.experiment.periods) == (1, 2)
        assert run.design.others == (str(folder / f"motion-{3 - number}"),)
        assert (design.check.certified, design.passed) == (one.certified, True)
        assert design.period == one.period == one.measuring_time / 2
    assert result.measuring_time == sum(one.measuring_time for one in result.motions)


def test_information_and_searches(folder):
    """The sum is that of the designs; no exchange makes it smaller."""
    result = MotionsResult.read(folder)
    designs = [DesignResult.read(folder / one.folder) for one in result.motions]
    whole = 0
    for one in designs:
        times = np.arange(one.experiment.samples) / 100
        regressors = one.robot.regressor(*one.trajectory.sample(times))
        noise = one.configuration.robot.noise.force_covariance
        whole = whole + information_matrix(regressors, noise)
    std = np.sqrt(np.diag(np.linalg.inv(whole)))
    np.testing.assert_allclose(list(result.predicted_std.experiment.std.values()), std, rtol=1e-8)
    mean = sum(one.information for one in designs) / COUNT
    assert result.log_det_information == pytest.approx(np.linalg.slogdet(mean)[1], abs=1e-6)
    values = [one.criterion_value for one in result.searches]
    assert [one.phase for one in result.searches][: COUNT + 1] == ["greedy"] * 2 + ["exchange"]
    assert np.all(np.diff(values) >= -1e-9)
    assert result.criterion_value == values[-1]
    assert [one.accepted for one in result.searches] == [
        not np.isfinite(one.gain_percent) or one.gain_percent > 0.1 for one in result.searches
    ]


def test_stages_after_the_motions_keep_their_search(folder, tmp_path):
    """Options may have given it: the run file has another one."""
    made = load_run(folder / "run.yaml").run.design
    other = load_run(_run()).with_section("design", seed=made.seed + 9)
    kept = keep_search(other, folder).run
    assert (kept.design.seed, kept.trajectory.count) == (made.seed, COUNT)
    (tmp_path / "run.yaml").write_bytes((folder / "run.yaml").read_bytes())
    assert keep_search(other, tmp_path) is other, "without designs"
    place = tmp_path / "motion-2"
    place.mkdir()
    (place / "design.json").write_bytes((folder / "motion-2" / "design.json").read_bytes())
    assert keep_search(other, tmp_path).run.design.seed == made.seed, "of an interrupted run"


def test_certify_and_next(folder):
    work = Workspace(load_run(folder / "run.yaml"), folder)
    certified = CertifiedPart("design", "", PathCertificate(()))
    with patch("expdesign.cli.certify.certified_folder", lambda _: [certified]):
        names = [part.name for part in certified_motions(work)]
    assert names == ["motion-1/design", "motion-2/design"]
    with pytest.raises(InputError, match="it has several motions"):
        next_run([folder])


def test_noise_of_the_recordings_differs(folder):
    texts = [(folder / f"motion-{k}" / "truth.json").read_text() for k in (1, 2)]
    one, other = (json.loads(text)["seeds"]["repetitions"] for text in texts)
    assert (one, other != one) == (3, True)


@pytest.mark.slow
def test_searched_motions_and_one_estimate_of_all_recordings(tmp_path):
    tolerances = {"gravity": "0.1 deg", "force_constant": {"common": "0.5 %"}}
    with blank_figures():
        expdesign.run(_run(tolerances=tolerances, estimate={"estimators": ["ml"]}), tmp_path)
    found, result = EstimateFile.read(tmp_path), MotionsResult.read(tmp_path)
    files = [str(tmp_path / f"motion-{number}" / "measurement.csv") for number in (1, 2)]
    assert [one.source for one in found.recordings] == files
    assert {one.period_source for one in found.recordings} == {"design"}
    assert all(one.certified for one in result.motions)
    again = expdesign.estimate(
        tmp_path / "run.yaml", files, [tmp_path / one.folder for one in result.motions]
    )
    values = found.estimators["ml"].values
    assert again.estimators["ml"].values == pytest.approx(values, rel=1e-6, abs=1e-9)
    std = {row.parameter: row.std for row in again.by_estimator()["ml"]}
    ratios = [std[one.name] / one.std_total for one in result.parameters]
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1, abs=0.1)


def test_a_search_without_a_result_counts():
    """The next one has its own seed and place in the journal."""
    made, seeds, count = [], [], 3
    three = tiny_run(trajectory={"count": count}, experiment={"periods": 6})

    def find(configuration, *arguments):
        seeds.append(configuration.run.design.seed)
        if len(seeds) == count + 1:
            raise NoDesignError("no trajectory keeps the limits", ())
        return _finder(made)(configuration, *arguments)

    def searching(_):
        return nullcontext(Monitor())

    with patch("expdesign.experiment.motions.find_motion", find):
        result, _ = design_motions(load_run(three), Path("nowhere"), searching)
    failed = result.searches[count]
    assert not failed.accepted
    before = result.searches[count - 1].criterion_value
    assert failed.criterion_value == pytest.approx(before, rel=1e-12)
    assert np.isnan(failed.gain_percent)
    assert len(set(seeds)) == len(seeds) == len(result.searches) > count + 1


@pytest.mark.parametrize("searches", [1, 2, 3])
def test_a_stop_keeps_the_motions_once_there_are_all(searches):
    made = []

    def stopped():
        return len(made) >= searches

    def design():
        searching = nullcontext(Monitor(stopped))
        return design_motions(load_run(_run()), Path("nowhere"), lambda _: searching)

    with patch("expdesign.experiment.motions.find_motion", _finder(made)):
        if searches < COUNT:
            with pytest.raises(StoppedError, match="interrupted after 1 of 2 motions"):
                design()
            return
        result, _ = design()
    assert result.interrupted
    assert len(made) == len(result.searches) == searches


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory": {"count": 3}}, "3 motions cannot share 4 periods equally"),
        ({"montecarlo": {}}, "a Monte-Carlo study is for a single motion"),
        (
            {"feedforward": {"bandwidth": 2, "motion": "design"}},
            "feedforward of the design is for a single motion",
        ),
        ({"sweep": {"design.criterion": ["d", "a"]}}, "a sweep is for a single motion"),
        ({"design": {"others": ["elsewhere"]}}, "design.others is for a single motion"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(InputError, match=message):
        load_run(_run(**changes))


def test_commands_for_one_recording_name_the_motions(folder):
    with pytest.raises(InputError, match="2 motions have a run folder each"):
        expdesign.design(_run())
    run = str(folder / "run.yaml")
    for command, message in (
        (["noise", run], "the noise of one recording is analysed, and there are 2"),
        (["montecarlo", run], "motion-1"),
        (["plan", run, "--want", "mass=1%"], "goals are planned for a single motion"),
        (
            ["estimate", run, "--data", str(folder / "motion-1/measurement.csv")],
            "recordings: 1, motions: 2",
        ),
    ):
        found = CliRunner().invoke(app, [*command, "--out", str(folder)])
        assert message in str(found.exception), found.output
