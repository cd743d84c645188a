"""Selection of terms: against fits one by one, its local optimum, and what it finds and adds."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import cycle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from estimation.estimators import ParameterPriors, linear_estimate
from estimation.identification import estimate_parameters, prepare_experiment, term_selection
from estimation.identification.estimate import diagnose_estimation, identified_robot
from estimation.identification.term_selection import UNSETTLED, Selection
from estimation.measurement_model.motion import NormalEquations
from estimation.selection import Evidence, Judge, select, splits
from expdesign.configuration import InputError, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.run import add_terms, robot_yaml
from expdesign.mechanism.term import parameters_of
from expdesign.robot import robot_from
from tests.estimation import constants
from tests.estimation.cases import ROBOT, measured, run, trajectory

CANDIDATES = [{"stribeck": {"velocity": 0.05}}, "drive_inertia", "force_offset", "payload"]
NAMES = ["stribeck", "drive_inertia", "force_offset", "payload"]
EXACT = {"noise": {"length_std": ["1 nm"] * 6}}
"""Of the lengths, so that the motion is known."""
MOTION = trajectory()


@cache
def machine(**parameters):
    """Return PaLiDA with terms that the robot file of the user lacks."""
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    terms, values = [*file["terms"], "drive_inertia", "force_offset"], file["parameters"]
    return robot_from(
        load_run(
            {
                "name": "machine",
                "robot": file | {"terms": terms, "parameters": values | parameters},
            }
        ).robot
    )


def selecting(by="bic", candidates=CANDIDATES, **others):
    estimated = {"estimators": ["gm"], "noise": "given", "harmonics": 2}
    select = {"select": {"candidates": candidates, "by": by}}
    return run(estimated | select | others.pop("estimate", {}), **others)


def evidence_of(configuration, experiments):
    wide = robot_from(add_terms(configuration, configuration.run.estimate.select.candidates).robot)
    own = {term.name for term in ROBOT.terms}
    blocks = {
        term.name: tuple(p.name for p in parameters_of((term,)))
        for term in wide.terms
        if term.name not in own
    }
    knowledge = ParameterPriors.of(wide, configuration.run.estimate)
    seen = [experiment.of_robot(wide) for experiment in experiments]
    own_values = dict(zip(ROBOT.parameter_names, ROBOT.parameters, strict=True))
    values = np.array([own_values.get(name, 0.0) for name in knowledge.names])
    return wide, knowledge, seen, Evidence.of(wide, seen, knowledge, values, blocks)


@pytest.fixture(scope="module")
def known_motion():
    """Return evidence of a recording whose motion is known, with the model of all candidates.

    Two periods are too few to show the noise: it is that of the robot file.
    """
    configuration = selecting(**EXACT)
    data = measured(MOTION, robot=machine(o2=3.0, m_drive=0.2), length_scale=1e-5, periods=2)
    experiment = prepare_experiment(configuration, ROBOT, data, MOTION)
    return evidence_of(configuration, [experiment])


def cost(wide, knowledge, experiments, terms):
    """Return the weighted sum of squares of a fit with some of the candidates."""
    kept = {p.name for term in wide.terms if term.name in terms for p in term.parameters}
    own = set(ROBOT.parameter_names) | kept
    free = np.array([name in own for name in knowledge.names])
    return linear_estimate(wide, experiments, replace(knowledge, free=free), "gm").cost


@pytest.mark.parametrize(
    ("term", "others"),
    [("stribeck", ()), ("force_offset", ("drive_inertia",)), ("drive_inertia", ("stribeck",))],
)
def test_what_a_block_is_worth_is_the_difference_of_two_fits(known_motion, term, others):
    wide, knowledge, experiments, evidence = known_motion
    judge = Judge(evidence, "bic", 0.01)
    found = judge.try_term(term, others)
    without, with_it = (
        cost(wide, knowledge, experiments, model) for model in (others, (*others, term))
    )
    assert found.statistic * judge.dispersion == pytest.approx(without - with_it, rel=1e-3)
    assert found.parameters == (1 if term == "drive_inertia" else 6)
    # White noise that is known: every sample counts as one.
    assert judge.samples[term] == pytest.approx(2 * 200)
    assert -found.bic == pytest.approx(found.statistic - found.parameters * np.log(400))


def test_what_nothing_tells_apart_is_not_counted(known_motion):
    # A mass at the TCP is one of the platform's.
    found = Judge(known_motion[3], "bic", 0.01).try_term("payload", ())
    assert (found.parameters, found.statistic, found.log_p) == (0, 0.0, 0.0)


def test_periods_add_up_to_the_recording(known_motion):
    (recording,) = known_motion[3].recordings
    assert recording.periods.shape[1] == 2
    total = recording.periods.sum(axis=1)
    np.testing.assert_allclose(total, recording.total.gradient, rtol=1e-8, atol=1e-6)


def test_held_out_periods_are_predicted_by_fits_to_the_others(known_motion):
    """Against fits and predictions with the regressor, one after the other."""
    wide, knowledge, (experiment,), evidence = known_motion
    judge = Judge(evidence, "holdout", 0.01)
    assert splits(evidence)[0].fitted.gradient.shape[1] == 2
    weight = np.linalg.inv(experiment.noise.forces.covariance)
    own = set(ROBOT.parameter_names)
    errors = {}
    for terms in ((), ("force_offset",)):
        kept = own | {p.name for t in wide.terms if t.name in terms for p in t.parameters}
        columns = experiment.fitted_regressors[:, :, [n in kept for n in knowledge.names]]
        matrix = np.einsum("rik,ij,rjl->kl", columns, weight, columns)
        total = 0.0
        periods = experiment.recording.forces.periods
        for number, period in enumerate(periods):
            right = np.einsum("rik,ij,rj->k", columns, weight, period)
            rest = np.delete(periods, number, axis=0) - columns @ np.linalg.solve(matrix, right)
            total += np.einsum("mri,ij,mrj->", rest, weight, rest)
        errors[terms] = total / len(periods)
    found = judge.try_term("force_offset", ())
    assert -found.held_out == pytest.approx(errors[()] - errors["force_offset",], rel=1e-3)


@pytest.mark.slow
def test_a_block_that_is_not_there_has_the_chi_square_of_chance():
    """Its p is uniform, over 30 recordings and two blocks."""
    configuration = selecting()
    found = []
    for seed in range(30):
        experiment = prepare_experiment(
            configuration, ROBOT, measured(MOTION, seed=seed, periods=6), MOTION
        )
        *_, evidence = evidence_of(configuration, [experiment])
        judge = Judge(evidence, "f", 0.01)
        judge.dispersion = 1.0
        found.append([judge.try_term(term, ()).log_p for term in ("stribeck", "force_offset")])
    p = np.exp(np.array(found)).ravel()
    assert stats.kstest(p, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("by", ["bic", "f", "holdout"])
def test_what_is_there_is_found_and_estimated(by):
    data = measured(MOTION, robot=machine(m_drive=3.0), seed=3, periods=6)
    result = estimate_parameters(selecting(by), data, MOTION)
    selection = result.selection
    assert selection.chosen == ("drive_inertia",)
    row = next(row for row in result.rows if row.parameter == "m_drive")
    assert abs(row.value - 3.0) < 5 * row.std
    assert row.std < 1
    assert "m_drive" in robot_yaml(identified_robot(result, None))
    (step,) = (row for row in selection.steps if row.chosen)
    assert (step.direction, step.term, step.worth > 0) == ("add", "drive_inertia", True)
    assert any("held out" in text for text in result.warnings) == (by == "holdout")


def test_nothing_is_added_to_a_machine_that_is_the_model():
    added = [
        Selection.of(
            selecting(by),
            ROBOT,
            [prepare_experiment(selecting(), ROBOT, measured(MOTION, seed=s), MOTION)],
        ).chosen
        for by in ("bic", "f", "holdout")
        for s in range(5)
    ]
    assert added.count(()) >= 14


def test_without_a_term_the_estimate_is_as_ever():
    data = measured(MOTION, seed=1)
    plain = estimate_parameters(
        run({"estimators": ["gm"], "noise": "given", "harmonics": 2}), data, MOTION
    )
    tried = estimate_parameters(selecting(), data, MOTION)
    assert tried.selection.chosen == ()
    np.testing.assert_array_equal(tried.best.values, plain.best.values)
    np.testing.assert_array_equal(tried.best.covariance, plain.best.covariance)


@pytest.mark.parametrize("parameters", ["all", "base"])
def test_bounds_have_no_part_in_the_choice_and_hold_after_it(parameters):
    """Of the robot's own parameters, of a candidate that is chosen, and of one that is not."""
    data = measured(MOTION, robot=machine(m_drive=3.0), seed=3, periods=6)
    bounds = {"m_drive": [0.5, 2.0], "p10": [10, 16], "o3": [1, 2]}
    free, bounded = (
        estimate_parameters(
            selecting(candidates=CANDIDATES[:3], estimate=more | {"parameters": parameters}),
            data,
            MOTION,
        )
        for more in ({}, {"bounds": bounds})
    )
    assert bounded.selection.chosen == free.selection.chosen == ("drive_inertia",)
    worth = [[row.worth for row in each.selection.steps] for each in (bounded, free)]
    assert worth[0] == worth[1]
    assert bounded.selection.bounded == tuple(bounds)
    values = dict(zip(bounded.priors.names, bounded.best.values, strict=True))
    assert (values["m_drive"], values["p10"]) == (2, 16)
    told = [text for text in bounded.warnings if text not in free.warnings]
    assert any("estimate.select" in text and "m_drive" in text for text in told)
    assert any("m_drive is at its bound" in text for text in told)
    assert not any("bound" in text for text in free.warnings)


@pytest.mark.slow
def test_terms_are_chosen_at_the_constants_that_are_found():
    """What a wrong pitch and velocity leave of their terms, others imitate: they are not kept."""
    off = {"pitch": 1.01 * constants.PITCH, "velocity": 0.6 * constants.VELOCITY}

    def chosen(*, estimated):
        guess = {key: {"value": value, "estimate": estimated} for key, value in off.items()}
        candidates = [
            {"stribeck": {"velocity": guess["velocity"]}},
            {"cogging": {"pitch": guess["pitch"]}},
            "quadratic_friction",
            "cubic_friction",
            "force_offset",
        ]
        section = {"noise": "given", "harmonics": 2, "estimators": ["gm"]}
        section |= {"select": {"candidates": candidates}}
        given = {"noise": constants.noise(), "estimate": section}
        configuration = load_run({"name": "n", "robot": "palida", **given})
        return estimate_parameters(configuration, constants.data(1), constants.MOTION).selection

    found, written = chosen(estimated=True), chosen(estimated=False)
    assert set(found.chosen) == set(written.chosen) == {"stribeck", "cogging"}
    assert not found.imitations
    assert set(written.imitations) == {"quadratic_friction", "cubic_friction"}
    assert found.settled
    at = {term.name: term.constants for term in found.judged}
    assert at["cogging"]["pitch"].value == pytest.approx(constants.PITCH, rel=1e-3)
    assert at["stribeck"]["velocity"].value == pytest.approx(constants.VELOCITY, rel=0.05)
    assert {c.value for term in found.added for c in term.constants.values()} == set(off.values())


def test_a_choice_that_does_not_settle_says_so(monkeypatch):
    """Two terms that take turns, each chosen at the constants found with the other."""
    turns = cycle([("stribeck",), ("cogging",)])

    def chosen(_, configuration, *__):
        candidates = configuration.run.estimate.select.candidates
        return Selection(
            by="bic",
            level=None,
            candidates=candidates,
            chosen=next(turns),
            dispersion=1.0,
            held_out="",
            steps=(),
        )

    monkeypatch.setattr(Selection, "_at", classmethod(chosen))
    monkeypatch.setattr(term_selection, "_found", lambda *_: ROBOT)
    guess = {"value": 0.03, "estimate": True}
    candidates = [{"stribeck": {"velocity": guess}}, {"cogging": {"pitch": guess}}]
    found = Selection.of(selecting(candidates=candidates), ROBOT, [])
    assert not found.settled
    assert found.chosen == ("stribeck",)
    assert any(UNSETTLED in text for text in found.warnings)


def test_a_candidate_of_which_nothing_is_estimated_is_refused():
    """In base parameters a payload on a general platform says nothing new."""
    general = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    configuration = selecting(
        candidates=[{"payload": {"z": 0.05}}, "quadratic_friction"],
        estimate={"parameters": "base"},
        robot=general | {"platform": "general"},
    )
    with pytest.raises(InputError, match="payload"):
        estimate_parameters(configuration, measured(MOTION), MOTION)


def test_friction_may_be_a_candidate():
    """Its signs are those of rates that no other term has."""
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    smooth = ["struts", "rigid_platform"]
    known = {key: value for key, value in file["parameters"].items() if key.startswith("p")}
    robot = file | {"terms": smooth, "parameters": known}
    candidates = ["cable", "actuator_friction", "passive_friction"]
    candidates[0] = {"cable": {"rest_length": 0.6}}
    section = {"estimators": ["gm"], "harmonics": 2, "select": {"candidates": candidates}}
    configuration = load_run({"name": "bare", "robot": robot, "estimate": section})
    found = estimate_parameters(configuration, measured(MOTION, seed=6, force_scale=0.1), MOTION)
    assert set(found.selection.chosen) == {"actuator_friction", "passive_friction"}
    plain = estimate_parameters(
        run({"estimators": ["gm"], "harmonics": 2}), measured(MOTION, 6, force_scale=0.1), MOTION
    )
    values = dict(zip(found.priors.names, found.best.values, strict=True))
    np.testing.assert_allclose(
        [values[name] for name in plain.priors.names], plain.best.values, rtol=1e-6, atol=1e-7
    )


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_a_constant_is_estimated_with_the_term_that_was_chosen(known):
    """Of a candidate after the choice, of the robot's own term before it."""
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)

    def robot(pitch, *terms, **parameters):
        listed = [*file["terms"], {"cogging": {"pitch": pitch}}, *terms]
        values = file["parameters"] | {f"cs{j}": 20.0 for j in range(1, 7)}
        cosines = {f"cc{j}": 5.0 for j in range(1, 7)}
        return file | {"terms": listed, "parameters": values | cosines | parameters}

    true = robot(0.05, "drive_inertia", m_drive=3.0)
    machine = robot_from(load_run({"name": "m", "robot": true}).robot)
    data = measured(MOTION, 8, robot=machine, force_scale=0.1)
    guess = {"value": 0.0503, "estimate": True}
    candidates = ["force_offset", "drive_inertia"]
    section = {"estimators": ["gm"], "harmonics": 2, "select": {"candidates": candidates}}
    if not known:
        candidates.append({"cogging": {"pitch": guess}})
    own = robot(guess) if known else "palida"
    result = estimate_parameters({"name": "m", "robot": own, "estimate": section}, data, MOTION)
    chosen = {"drive_inertia"} if known else {"drive_inertia", "cogging"}
    assert set(result.selection.chosen) == chosen
    (deviation,) = result.best.systematic.deviations
    assert deviation.name == "cogging_pitch"
    (off,), (std,) = result.best.systematic.values, result.best.systematic.std
    assert abs(off + 0.0003) < 5 * std < 0.0003


def test_several_recordings_hold_each_other_out():
    motions = [trajectory(seed=4), trajectory(seed=5)]
    data = [measured(m, robot=machine(m_drive=3.0), seed=k) for k, m in enumerate(motions)]
    result = estimate_parameters(selecting("holdout"), data, motions)
    assert result.selection.chosen == ("drive_inertia",)
    assert result.selection.held_out == "recordings"
    assert not any("held out" in text for text in result.warnings)


def test_a_single_period_holds_nothing_out():
    with pytest.raises(InputError) as caught:
        estimate_parameters(selecting("holdout"), measured(MOTION, periods=1), MOTION)
    assert caught.value.problems[0].key == "estimate.select.by"


def test_what_no_candidate_explains_counts_as_noise():
    data = measured(MOTION, seed=2, periods=40, force_scale=0.2)
    wave = np.sin(2 * np.pi * data.lengths / 0.021)
    disturbed = replace(data, forces=data.forces + 12 * (wave - wave.mean(axis=0)))
    configuration = selecting(estimate={"noise": "estimated"})
    found = []
    for each in (data, disturbed):
        experiment = prepare_experiment(configuration, ROBOT, each, MOTION)
        judge = Judge(evidence_of(configuration, [experiment])[-1], "bic", 0.01)
        found.append((judge.dispersion, judge.try_term("stribeck", ()).statistic))
    (clean, _), (disturbed_by, statistic) = found
    assert clean < 1.2
    # Twelve newtons of amplitude, beside the noise of the means: six of 25 N of noise, 40 periods.
    assert disturbed_by > 2
    judge.dispersion = 1.0
    assert judge.try_term("stribeck", ()).statistic == pytest.approx(disturbed_by * statistic)


def _with_force(force):
    """Return a recording of a machine with another force, of the struts' state and the load."""
    data = measured(MOTION, seed=3, periods=6, force_scale=0.1)
    state = MOTION.sample(data.time)
    struts = ROBOT.strut_motion(state.pose, state.rate, state.acceleration)
    load = ROBOT.actuator_forces(state.pose, state.rate, state.acceleration)
    return replace(data, forces=data.forces + force(struts, load))


def _selected(force, *candidates):
    configuration = selecting(candidates=list(candidates))
    return estimate_parameters(configuration, _with_force(force), MOTION)


def _named(result):
    """Return the finding on terms that only imitate, in the verdict."""
    failed = diagnose_estimation(result).verdict.failed
    return next(finding for finding in failed if "imitates" in finding.contradiction)


def test_a_term_with_an_impossible_sign_is_not_chosen_and_is_named():
    result = _selected(
        lambda s, load: -0.06 * np.abs(load) * np.sign(s.length_rate), "load_friction"
    )
    assert result.selection.chosen == ()
    (row,) = result.selection.steps
    assert row.bic < 0
    assert not row.possible
    assert "load_friction" in _named(result).contradiction


@pytest.mark.slow
def test_an_added_term_with_an_impossible_sign_is_named():
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    robot = file | {"terms": [*file["terms"], "load_friction"]}
    section = {"estimators": ["gm"], "harmonics": 2}
    data = _with_force(lambda s, load: -0.06 * np.abs(load) * np.sign(s.length_rate))
    found = diagnose_estimation(estimate_parameters(run(section, robot=robot), data, MOTION))
    assert "not plausible for this machine (mu" in found.verdict.summary


def test_a_term_that_leaves_most_of_a_lack_of_fit_is_not_kept_and_is_named():
    """A periodic force of a long pitch, of which quadratic friction takes a little."""
    result = _selected(
        lambda s, _: 5 * s.length_rate * np.abs(s.length_rate) + 25 * np.sin(60 * s.length),
        "quadratic_friction",
    )
    assert result.selection.imitations == ("quadratic_friction",)
    assert result.selection.chosen == ()
    assert "quadratic_friction" in _named(result).contradiction


@dataclass(frozen=True)
class Recording:
    """What a recording says, made up."""

    total: NormalEquations
    columns: np.ndarray
    columns_white: np.ndarray
    samples: float = 1000.0

    def residual_chi_square(self, _):
        return 1.0, 10_000


@st.composite
def judges(draw):
    """Draw evidence of five blocks of one to three columns beside two of the robot's own."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sizes = [int(n) for n in rng.integers(1, 4, 5)]
    ends = 2 + np.cumsum([0, *sizes])
    root = rng.normal(size=(ends[-1], 40)) * 10 ** rng.uniform(-1, 1)
    root += draw(st.floats(0, 3)) * rng.normal(size=40)
    information = root @ root.T
    step = rng.normal(size=ends[-1]) * (rng.random(ends[-1]) < 0.5)
    gradient = information @ step + root @ rng.normal(size=40)
    diagonal = np.diag(information).copy()
    blocks = {f"b{k}": np.arange(*ends[k : k + 2]) for k in range(5)}
    nothing = NormalEquations(0.0, np.zeros_like(information), np.zeros(ends[-1]))
    recording = Recording(NormalEquations(0.0, information, gradient), diagonal, diagonal)
    unbounded = np.full((ends[-1], 2), [-np.inf, np.inf])
    evidence = Evidence(blocks, nothing, (recording,), np.inf, unbounded)
    by = draw(st.sampled_from(["bic", "f"]))
    return Judge(evidence, by, 0.01, {"b1": "b0"} if draw(st.booleans()) else {})


@settings(max_examples=60)
@given(judges())
def test_no_single_step_improves_what_was_chosen(judge):
    chosen, rows = select(judge)
    assert sum(row.chosen for row in rows) >= len(chosen)
    for term in judge.evidence.blocks:
        others = tuple(other for other in chosen if other != term)
        needs = judge.needs.get(term)
        if needs is not None and term in chosen:
            assert needs in chosen
        if any(judge.needs.get(other) == term for other in others):
            continue
        if needs is not None and needs not in chosen:
            continue
        assert (judge.try_term(term, others).worth > 0) == (term in chosen)


@settings(max_examples=60)
@given(judges())
def test_every_step_lowers_the_criterion(judge):
    """Against the criterion of whole models, by one fit of each."""
    _, rows = select(judge)
    whole = judge.evidence.total
    own = judge.evidence.own_terms
    model, values = (), []
    for row in [None, *(row for row in rows if row.chosen)]:
        if row is not None:
            adding = row.direction == "add"
            model = (*model, row.term) if adding else tuple(t for t in model if t != row.term)
        places = np.concatenate([own, *(judge.evidence.blocks[t] for t in model)]).astype(int)
        part = whole.gradient[places]
        gain = part @ np.linalg.solve(whole.matrix[np.ix_(places, places)], part)
        values.append(-gain + (len(places) - len(own)) * np.log(1000))
    if judge.by == "bic":
        assert np.all(np.diff(values) < 1e-6 * np.abs(values[:-1]))
