"""Every key that a run file may have: its default, what it takes and what it refuses."""

import pytest
from pydantic import ValidationError

from expdesign.configuration import RunDescription


def _run(**keys):
    return RunDescription.model_validate({"name": "test", "robot": "palida", **keys})


@pytest.fixture
def error_of(run_mapping, the_problem):
    """Return the only problem of a run with the given keys."""

    def error(**keys):
        return the_problem(run_mapping | keys)

    return error


def test_stages_are_those_that_are_named_in_their_order():
    run = _run(
        report={},
        export=["csv"],
        validate=[{"motion": "circle"}],
        estimate=None,
        experiment={"periods": 3},
        design={},
        trajectory={"harmonics": 3},
        data={},
    )
    assert run.stages == ("design", "experiment", "estimate", "validate", "export", "report")
    assert _run(export=[], validate=None, montecarlo=None).stages == ("montecarlo",)


def test_the_complete_example_of_the_contract():
    run = _run(
        trajectory={
            "harmonics": 5,
            "frequency": ["0.1 Hz", "0.6 Hz"],
            "samples": 200,
            "controller_period": "1 ms",
        },
        design={
            "criterion": "condition",
            "starts": 16,
            "seed": 3,
            "search": "hopping",
            "hops": 10,
            "start": "rest",
            "scaling": "nominal",
            "parameters": ["p1", "r_alpha"],
            "max_seconds": "2 min",
        },
        experiment={
            "periods": 10,
            "sampling": "1 kHz",
            "seed": 1,
            "tracking_error": {"position": "1 mm", "angle": "0.1 deg", "harmonics": [6, 15]},
            "drift": "0.05 mm",
            "cogging": {
                "amplitude": [0, 0, 12, 12, 0, 0],
                "pitch": "30 mm",
                "phase": [0, 0, 0.3, 1.1, 0, 0],
            },
            "quantisation": {"length": "1 um", "force": 0.1},
            "outliers": {"share": 0.001, "length": "5 mm", "force": "200 N"},
        },
        data={
            "file": "measured.csv",
            "columns": {"t": "time", "q1": "Leg 1", "Q1": "F1", "period": "n"},
            "units": {"t": "ms", "q": "mm", "Q": "A", "Q1": "N"},
            "delimiter": ";",
            "decimal": ",",
            "force_constants": "90 N/A",
            "start": "0.5 s",
            "delay": {"forces": "2 ms", "lengths": 0},
            "time": "stamped",
            "time_tolerance": 0.05,
        },
        estimate={
            "estimators": ["gm", "ml"],
            "differentiation": "butterworth",
            "harmonics": 9,
            "noise": "given",
            "frequency": "estimated",
            "fixed": {"p1": 0.005, "p2": None},
            "prior": {"p10": {"std": "0.5 kg"}, "p9": {"value": 1.7, "std": 0.1}},
            "bounds": {"r1": [0, "50 N"]},
        },
        montecarlo={"repetitions": 100, "estimators": ["ls"], "seed": 7},
        validate=[
            {"motion": "circle", "mirror": "xz", "periods": 5},
            {"motion": "line", "poses": [[0, 0, -0.6, 0, 0, 0], [0.1, 0, -0.6, 0, 0, "5 deg"]]},
            {"motion": "file", "file": "other.csv"},
        ],
        export=["csv", "xps-pvt", "linuxcnc-gcode"],
        report={"title": "A report", "figures": ["pdf"]},
        scheduler="tcp://127.0.0.1:8786",
    )
    assert run.trajectory.controller_period == 0.001
    assert run.design.max_seconds == 120
    assert run.experiment.cogging.pitch == (0.03,) * 6
    assert run.experiment.cogging.amplitude[2] == 12
    assert run.data.force_constants == (90.0,) * 6
    assert run.data.delay.forces == (0.002,) * 6
    assert run.estimate.fixed == {"p1": 0.005, "p2": None}
    assert run.estimate.prior["p10"].std == 0.5
    assert run.estimate.prior["p10"].value is None
    assert run.estimate.bounds == {"r1": (0.0, 50.0)}
    assert run.workers is None
    # What is written is what was read.
    assert RunDescription.model_validate(run.model_dump(by_alias=True)) == run


def test_fixed_parameters_as_a_list():
    assert _run(estimate={"fixed": ["p1", "v3"]}).estimate.fixed == {"p1": None, "v3": None}


def test_parameters_all_and_harmonics_auto():
    run = _run(design={"parameters": "all"}, estimate={"harmonics": "auto"})
    assert run.design.parameters is None
    assert run.estimate.harmonics is None
    written = run.model_dump(by_alias=True)
    assert written["design"]["parameters"] == "all"
    assert written["estimate"]["harmonics"] == "auto"


@pytest.mark.parametrize("name", ["a", "A.b_c-1", "-x", "..x", "x" * 100])
def test_names(name):
    assert _run(name=name).name == name


@pytest.mark.parametrize("name", ["", ".", "..", "a b", "a/b", "ä", "a\n", "x" * 101, 5, None])
def test_names_that_are_refused(error_of, name):
    problem = error_of(name=name)
    assert problem.key == "name"
    assert problem.allowed


@pytest.mark.parametrize(
    ("keys", "key", "nearest"),
    [
        ({"trajektory": {}}, "trajektory", "trajectory"),
        ({"Design": {}}, "Design", "design"),
        ({"validation": []}, "validation", "validate"),
        ({"trajectory": {"harmonic": 5}}, "trajectory.harmonic", "harmonics"),
        ({"design": {"criterium": "d"}}, "design.criterium", "criterion"),
        ({"design": {"start": "periodical"}}, "design.start", "periodic"),
        (
            {"experiment": {"tracking_error": {"positon": 1}}},
            "experiment.tracking_error.positon",
            "position",
        ),
        ({"validate": [{"motions": "circle", "motion": "line"}]}, None, "motion"),
        ({"limits": {"strut_velocity": 1}}, "limits.strut_velocity", "strut_clearance"),
    ],
)
def test_unknown_keys_name_the_nearest(problems_of, run_mapping, keys, key, nearest):
    problem = next(p for p in problems_of(run_mapping | keys) if p.nearest)
    if key is not None:
        assert problem.key == key
    if key != "limits.strut_velocity":
        assert problem.nearest == nearest
    assert problem.allowed


@pytest.mark.parametrize("key", ["(name)", "(inline)", "[key]", "", "a.b", "x" * 10_000])
def test_odd_unknown_keys(error_of, key):
    assert "unknown key" in error_of(**{key: 1}).message


def test_all_problems_are_reported_at_once(run_mapping, problems_of):
    run_mapping["trajectory"] = {"harmonics": 0, "samples": "many"}
    run_mapping["design"] = {"criterion": "x"}
    run_mapping["limits"] = {"tilt": -1}
    run_mapping["robot"]["base_joints"].pop()
    keys = [p.key for p in problems_of(run_mapping)]
    assert keys == [
        "robot.base_joints",
        "trajectory.harmonics",
        "trajectory.samples",
        "design.criterion",
        "limits.tilt",
    ]


def test_every_parameter_with_a_wrong_value_is_reported(run_mapping, problems_of):
    run_mapping["estimate"] = {
        "bounds": {"p1": [2, 1], "q1": [0, 1], "r1": [0, "1 kg"], "r2": [0, 1]},
        "fixed": {"p2": "x"},
    }
    keys = [p.key for p in problems_of(run_mapping)]
    assert keys == [f"estimate.{k}" for k in ("fixed.p2", "bounds.p1", "bounds.q1", "bounds.r1")]


def test_one_frequency_alone_is_shown_as_a_pair():
    with pytest.raises(ValidationError) as caught:
        _run(trajectory={"frequency": "0.5 Hz"})
    (error,) = caught.value.errors()
    assert error["ctx"]["allowed"].endswith("[0.5 Hz, 0.5 Hz]")
