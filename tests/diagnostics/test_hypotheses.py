"""Causes that a machine has and the model does not: columns, and what is named."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.hypotheses import list_hypotheses
from estimation.diagnostics.joint_system import EffectProjection, joint_systems
from estimation.diagnostics.linearisation import CandidateEffects, linearise
from estimation.diagnostics.significance import log_tail
from estimation.estimators import PerturbedMachine
from estimation.estimators.experiment import Experiment
from estimation.kinematics import fit_motion
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import PeriodSource
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.terms import DEFAULT, term_definitions
from expdesign.robot import robot_from
from expdesign.robot.deviation import apply_deviations, deviations, toleranced_deviations
from tests.diagnostics.conftest import Laboratory
from tests.estimation.cases import given_noise


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _with_terms(palida, terms, **parameters):
    changed = {"terms": [*DEFAULT, *terms], "parameters": palida["parameters"] | parameters}
    return robot_from(load_run({"name": "n", "robot": palida | changed}).robot)


@pytest.fixture(scope="module")
def lab():
    return Laboratory(samples=200, periods=4)


@pytest.fixture(scope="module")
def suspects(lab, palida):
    """Return where columns are taken, at parameters that are not the nominal ones."""
    experiment = lab.experiment(lab.measure(1), lab.noise)
    values = lab.robot.parameters.copy()
    values[lab.knowledge.names.index("p10")] *= 1.3
    motion = experiment.fit.motion
    part = linearise(lab.robot, experiment, values, lab.knowledge.free, motion)
    return CandidateEffects(lab.robot, experiment, motion, values, part)


@pytest.mark.parametrize(
    ("name", "constants"),
    [
        ("force_offset", {}),
        ("cable", {"rest_length": 0.6}),
        ("stribeck", {"velocity": 0.05}),
        ("load_friction", {}),
        ("quadratic_friction", {}),
        ("position_friction", {"length": 0.6}),
        ("passive_viscous_friction", {}),
        ("platform_spring", {"x": 0.1, "y": 0.0, "z": -0.6}),
        ("platform_drag", {}),
    ],
)
def test_columns_are_those_of_the_term_at_the_estimate(suspects, palida, name, constants):
    machine = _with_terms(palida, [{name: constants}] if constants else [name])
    count = len(term_definitions()[name].parameters)
    machine = machine.with_load_at(np.concatenate([suspects.values, np.zeros(count)]))
    states = suspects.motion.at(suspects.experiment.times).state()
    expected = machine.regressor(*np.split(states, 3, axis=1))[:, :, -count:]
    found = suspects.term(name, **constants)
    assert not np.any(found.lengths)
    # Next to a reversal the sign is an expectation: the few samples there may differ.
    sliding = np.all(np.abs(suspects.part.speed) > 0.02, axis=1)
    sliding &= np.all(np.abs(states[:, 6:12]) > 0.02, axis=1)
    assert np.mean(sliding) > 0.5
    np.testing.assert_allclose(
        found.forces[sliding], expected[sliding], rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


def test_columns_along_a_motion_with_more_harmonics_than_the_lengths_show(lab):
    """They are those of an experiment whose lengths do show them."""
    fitted = lab.experiment(lab.measure(1), lab.noise)
    count = fitted.fit.motion.harmonics + 2
    more = fit_motion(lab.robot, fitted.recording, lab.noise.lengths, count)
    shown = Experiment.from_fit(lab.robot, fitted.recording, lab.noise, more)
    along = replace(fitted, refined_motion=shown.fit).for_estimator("ml")
    values = lab.robot.parameters
    found = []
    for experiment in (along, shown):
        part = linearise(lab.robot, experiment, values, lab.knowledge.free, more.motion)
        suspects = CandidateEffects(lab.robot, experiment, more.motion, values, part)
        found.append(suspects.term("stribeck", velocity=0.05).forces)
        exact = PerturbedMachine.exact(lab.robot)
        machine = exact.forces(experiment, more.motion, values, slice(None))
        np.testing.assert_allclose(machine.regressors, part.regressors, rtol=0, atol=1e-9)
    assert np.abs(found[0]).max() > 0.1
    np.testing.assert_allclose(*found, rtol=0, atol=1e-12)


@pytest.mark.parametrize("source", [one for one in PeriodSource if one is not PeriodSource.REST])
def test_what_a_clock_moves_depends_on_where_the_frequency_comes_from(lab, palida, source):
    """Tolerances are the same columns for the causes as for the estimate."""
    robot = robot_from(
        load_run({"name": "n", "robot": palida | {"tolerances": {"clock": 1e-3}}}).robot
    )
    own = lab.experiment(lab.measure(1), lab.noise)
    experiment = replace(own, recording=replace(own.recording, source=source))
    motion, values = experiment.fit.motion, robot.parameters
    part = linearise(robot, experiment, values, lab.knowledge.free, motion)
    columns, *_ = CandidateEffects(robot, experiment, motion, values, part).tolerance_columns()
    machine = PerturbedMachine.of(robot, toleranced_deviations(robot), np.zeros(1))
    whole = slice(None)
    forces = machine.forces(experiment, motion, values, whole)
    lengths = machine.lengths(experiment, motion, whole)
    np.testing.assert_allclose(columns.forces, forces.deviations, atol=1e-9)
    np.testing.assert_allclose(columns.lengths, lengths.deviations, atol=1e-12)
    # A motion without a period is a function of the true time.
    stamped = (PeriodSource.DESIGN, PeriodSource.FREQUENCY, PeriodSource.NONE)
    assert np.any(columns.lengths) == (source in stamped)


def test_deviations_are_the_same_unknowns_in_all_recordings(lab, palida):
    """All data together say the same of them and of the parameters, seen from either recording."""
    tolerances = {"strut_length": 1e-3, "gravity": 0.01}
    robot = robot_from(load_run({"name": "n", "robot": palida | {"tolerances": tolerances}}).robot)
    experiments = [lab.experiment(lab.measure(seed), lab.noise) for seed in (1, 2)]
    motion, values = experiments[0].fit.motion, robot.parameters
    free, count = lab.knowledge.free, len(values)
    parts = [linearise(robot, each, values, free, motion) for each in experiments]
    tolerated = [
        CandidateEffects(robot, each, motion, values, part).tolerance_columns()
        for each, part in zip(experiments, parts, strict=True)
    ]
    nothing = NormalEquations(0.0, np.zeros((count, count)), np.zeros(count))
    columns = [each for each, _, _ in tolerated]
    systems = joint_systems(parts, [lab.noise] * 2, nothing, columns, held_out=False)
    inverses = []
    for system, own in zip(systems, tolerated, strict=True):
        found = system.with_tolerances(*own)
        common = np.r_[0:count, system.columns.shape[1] : found.columns.shape[1]]
        inverses.append(found.solution.inverse[np.ix_(common, common)])
    scale = np.sqrt(np.diag(inverses[0]))
    np.testing.assert_allclose(*(each / np.outer(scale, scale) for each in inverses), atol=1e-6)
    alone = systems[0].with_effects(*tolerated[0]).solution.inverse
    assert np.max(np.diag(inverses[0])[:count] / np.diag(alone)[:count]) > 1.01


def test_a_term_of_the_robot_is_no_suspect(suspects, palida):
    own = replace(suspects, robot=_with_terms(palida, ["force_offset"]))
    assert suspects.lacks("force_offset")
    assert not own.lacks("force_offset")


def test_subsets_are_fitted_as_by_least_squares():
    rng = np.random.default_rng(0)
    model, rows, rest = rng.normal(size=(60, 4)), rng.normal(size=(60, 5)), rng.normal(size=60)
    basis, _ = np.linalg.qr(model)
    left = rest - basis @ (basis.T @ rest)

    def project(some):
        return EffectProjection(some, *[some.T @ basis] * 2, np.sum(some**2, axis=0), left, np.inf)

    projection, grown = project(rows), project(rows[:, :2]).append(project(rows[:, 2:]))

    def squares(columns):
        whole = np.concatenate([model, rows[:, columns]], axis=1)
        fitted = np.linalg.lstsq(whole, rest, rcond=None)[0]
        return np.sum((rest - whole @ fitted) ** 2), fitted[4:]

    for known, wanted in (([], [1]), ([0, 3], [2]), ([4], [0, 1]), ([1, 2, 4], [0, 3])):
        for one in (projection, grown):
            fit = one.conditional_on(known).fit(wanted)
            assert fit.rank == len(wanted)
            gain = squares(known)[0] - squares([*known, *wanted])[0]
            assert fit.statistic == pytest.approx(gain, rel=1e-9)
            np.testing.assert_allclose(fit.values, squares([*known, *wanted])[1][len(known) :])
    # A combination of what is known is not seen.
    assert project(rows[:, [0, 0]]).conditional_on([0]).fit([1]).rank == 0


# --- what is named --------------------------------------------------------------------------------


def _diagnosed(lab, data, robot=None):
    experiment = lab.experiment(data)
    estimate = lab.estimate([experiment])
    return diagnose(robot or lab.robot, [experiment], lab.knowledge, estimate)


def _machine(lab, robot, seed):
    """Return what a machine measures, with the laboratory's noise."""
    ideal, noisy = lab.measure(seed), lab.measure(seed)
    states = lab.trajectory.sample(noisy.time)
    lengths = robot.inverse_kinematics(states.pose) - lab.robot.inverse_kinematics(states.pose)
    forces = robot.actuator_forces(*states) - lab.robot.actuator_forces(*states)
    return replace(noisy, lengths=ideal.lengths + lengths, forces=ideal.forces + forces)


def _named(result):
    effects = result.recordings[0].attribution.effects
    return [(e.kind, e.strut, e.parameter) for e in effects]


@pytest.mark.parametrize(
    ("terms", "parameters", "expected"),
    [
        (["force_offset"], {"o3": 15.0}, ("force_offset", 2, "")),
        (
            [{"stribeck": {"velocity": 0.05}}],
            {f"s{j}": 40.0 for j in range(1, 7)},
            ("stribeck", None, ""),
        ),
        ([{"cable": {"rest_length": 0.6}}], {"k4": 300.0}, ("cable", 3, "")),
        (["drive_inertia"], {"m_drive": 3.0}, ("drive_inertia", None, "")),
        (["force_offset"], {f"o{j}": 15.0 for j in range(1, 7)}, ("force_offset", None, "")),
        (
            ["quadratic_friction"],
            {f"w{j}": -30.0 for j in range(1, 7)},
            ("quadratic_friction", None, ""),
        ),
        (["asymmetric_friction"], {"a2": 25.0}, ("asymmetric_friction", 1, "")),
        (
            [{"position_friction": {"length": 0.6}}],
            {"rl5": 400.0},
            ("position_friction", 4, ""),
        ),
        (
            ["passive_viscous_friction"],
            {"v_base": 1.5},
            ("passive_viscous_friction", None, "v_base"),
        ),
        (
                ["platform_drag"],
                {"d_x": 8.0, "d_y": 8.0, "d_z": 8.0},
                ("platform_drag", None, "d_x, d_y, d_z"),
            ),
        (["platform_wrench"], {"f_x": 30.0}, ("platform_wrench", None, "f_x, f_y, f_z")),
        (["platform_spring"], {"k_x": 900.0}, ("platform_spring", None, "k_x, k_y, k_z")),
    ],
)  # fmt: skip
def test_a_term_that_is_missing_is_named(lab, palida, terms, parameters, expected):
    machine = _with_terms(palida, terms, **parameters)
    result = _diagnosed(lab, _machine(lab, machine, 2))
    assert _named(result)[0] == expected
    (effect, *_) = result.recordings[0].attribution.effects
    assert effect.value == pytest.approx(next(iter(parameters.values())), abs=5 * effect.std)
    if expected[0] == "stribeck":
        assert 0.02 < effect.constant < 0.1
    assert result.verdict.status.value == "doubtful"


def test_an_asymmetric_platform_is_named(lab, palida):
    more = {"platform": "general", "parameters": palida["parameters"] | {"sx": 0.3, "sy": -0.2}}
    machine = robot_from(load_run({"name": "n", "robot": palida | more}).robot)
    result = _diagnosed(lab, _machine(lab, machine, 2))
    assert _named(result)[0] == ("general_platform", None, "sx, sy")
    (effect, *_) = result.recordings[0].attribution.effects
    assert np.max(np.abs((effect.values - [0.3, -0.2]) / effect.stds)) < 5


def test_a_saturating_force_constant_is_named(lab):
    data = lab.measure(2)
    share = data.forces / np.abs(data.forces).max()
    data = replace(data, forces=data.forces * (1 - 0.45 * share**2))
    result = _diagnosed(lab, data)
    assert _named(result)[0] == ("force_saturation", None, "")
    assert result.recordings[0].attribution.effects[0].value < 0


@pytest.mark.parametrize(("channel", "lag"), [("force", 0.012), ("length", 0.001)])
def test_a_channel_that_lags_is_named(lab, channel, lag):
    data = lab.measure(2)
    late = lab.trajectory.sample(data.time - lag)
    now = lab.trajectory.sample(data.time)
    if channel == "force":
        change = lab.robot.actuator_forces(*late) - lab.robot.actuator_forces(*now)
        data = replace(data, forces=data.forces + change * np.eye(6)[2])
    else:
        change = lab.robot.inverse_kinematics(late.pose) - lab.robot.inverse_kinematics(now.pose)
        data = replace(data, lengths=data.lengths + change * np.eye(6)[2])
    result = _diagnosed(lab, data)
    assert _named(result)[0] == ("lag", 2, channel)
    (effect, *_) = result.recordings[0].attribution.effects
    assert effect.value == pytest.approx(lag, abs=5 * effect.std)


def test_a_low_pass_of_a_channel_is_no_delay(lab):
    data, constant = lab.measure(2), 40e-3
    lines = np.fft.rfft(lab.robot.actuator_forces(*lab.trajectory.sample(data.time)), axis=0)
    rates = 2 * np.pi * np.fft.rfftfreq(len(data.time), data.step)
    gains = 1 / (1 + 1j * constant * rates) - 1
    change = np.fft.irfft(gains[:, None] * lines, len(data.time), axis=0)
    result = _diagnosed(lab, replace(data, forces=data.forces + change * np.eye(6)[2]))
    assert _named(result)[0] == ("low_pass", 2, "force")
    (effect, *_) = result.recordings[0].attribution.effects
    assert effect.value == pytest.approx(constant, abs=5 * effect.std)


def test_a_delay_within_its_tolerance_is_not_called_absent(suspects):
    """An estimated delay is part of the model: only a further one can be absent."""
    text = "forces and lengths are sampled at the same time"
    run = load_run({"name": "n", "robot": "palida", "tolerances": {"delay": 1e-3}})
    for robot, known, noun in (
        (suspects.robot, text, "a delay of the forces"),
        (
            robot_from(run.robot),
            f"{text}, within the stated `tolerances.delay`",
            "a further delay of the forces",
        ),
    ):
        effects = replace(suspects, robot=robot)
        families = list_hypotheses(effects, robot.parameter_names, held_out=False)
        (delay,) = (each for each in families if each.kind == "delay")
        assert (delay.assumption.text, delay.noun) == (known, noun)
        sentence = delay.absent.format(p=1.0, value=0.1, std=0.2)
        assert sentence == f"{known} (a further delay of 0.1 ± 0.2 ms)"


def test_a_term_beyond_its_tolerance_is_told_from_one_without(suspects):
    given = {"name": "n", "robot": "palida", "tolerances": {"terms": {"load_friction": 0.01}}}
    effects = replace(suspects, robot=robot_from(load_run(given).robot))
    families = list_hypotheses(effects, effects.robot.parameter_names, held_out=False)
    found = {each.kind: each for each in families}
    stated = found["load_friction"]
    text = "no unmodelled friction by load beyond the stated `tolerances.terms.load_friction`"
    assert stated.assumption.text == text
    assert stated.absent.format(p=1.0) == f"{text} (p = 1)"
    assert stated.assumption.advice == (
        "it exceeds the stated `tolerances.terms.load_friction`: state a larger one, or add "
        "`load_friction` to the robot's `terms`: it becomes a parameter of the estimate"
    )
    assert "stated" not in found["stribeck"].assumption.text


def _moved_joint(lab, size):
    names = [f"platform_joint_5_{axis}" for axis in "xyz"]
    chosen = [each for each in deviations(lab.robot) if each.name in names]
    return apply_deviations(lab.robot, chosen, size * np.array([0.6, 0.64, -0.48]))


def test_one_joint_elsewhere_is_no_cogging(lab):
    result = _diagnosed(lab, _machine(lab, _moved_joint(lab, 3e-3), 3))
    assert _named(result)[0] == ("joint", 4, "platform")
    (effect, *_) = result.recordings[0].attribution.effects
    errors = (effect.values - 3e-3 * np.array([0.6, 0.64, -0.48])) / effect.stds
    assert np.max(np.abs(errors)) < 5
    assert not any(kind == "position-periodic" for kind, _, _ in _named(result))


def test_within_its_tolerance_a_joint_is_no_cause(lab, palida):
    tolerances = {"platform_joints": "3 mm"}
    tolerant = robot_from(
        load_run({"name": "n", "robot": palida | {"tolerances": tolerances}}).robot
    )
    data = _machine(lab, _moved_joint(lab, 3e-3), 3)
    assert _diagnosed(lab, data).verdict.status.value == "doubtful"
    found = _diagnosed(lab, data, tolerant)
    assert _named(found) == []
    assert found.verdict.status.value == "accepted"


def test_within_their_tolerance_gains_are_no_bias(lab, palida):
    tolerances = {"force_constant": {"each": "50 %"}}
    tolerant = robot_from(
        load_run({"name": "n", "robot": palida | {"tolerances": tolerances}}).robot
    )
    data = lab.measure(3)
    data = replace(data, forces=data.forces * (1 + 0.5 * np.array([1, -1, 0, 1, -1, 0])))
    found = [_diagnosed(lab, data, robot) for robot in (lab.robot, tolerant)]
    biased, right = (each.recordings[0].tests.lack_of_fit.failed for each in found)
    assert np.any(biased)
    assert not np.any(right)


def test_what_cannot_be_told_apart_is_named_together(lab):
    """The zero of a length is a joint that is moved along the strut."""
    data = lab.measure(4)
    lengths = data.lengths + 3e-3 * np.eye(6)[1]
    result = _diagnosed(lab, replace(data, lengths=lengths))
    (effect, *_) = result.recordings[0].attribution.effects
    assert (effect.kind, effect.strut) == ("length_zero", 1)
    assert effect.value == pytest.approx(3e-3, abs=5 * effect.std)
    assert not effect.certain
    assert ("joint", 1) in {(rival.kind, rival.strut) for rival in effect.rivals}
    (failed,) = [
        f for f in result.verdict.failed if f.assumption.startswith("lengths are measured")
    ]
    # All of them, each where it is.
    for rival in effect.rivals:
        what = f"{rival.parameter} joint" if rival.kind == "joint" else "actuator"
        assert f"{what} {rival.strut + 1}" in failed.sentence
    assert (
        "the zero of a length is wrong (in actuator 2), or there is a displaced joint instead"
        in (result.verdict.summary)
    )


def test_rivals_leave_nothing_of_an_effect(lab, palida):
    """By the definition of a rival, from the tests of the candidates themselves."""
    machine = _with_terms(palida, [{"cable": {"rest_length": 0.6}}], k4=60.0)
    attribution = _diagnosed(lab, _machine(lab, machine, 5)).recordings[0].attribution
    (effect,) = attribution.effects
    tests, scores = attribution.first.families, attribution.first.conditional

    def places(one):
        test = tests[one.kind]
        return test.places(test.hypothesis.labels.index((one.parameter, one.strut)))

    def significance(one, given):
        """Return the logarithm of p of an effect if another one is known."""
        known, own = places(given), places(one)
        both = scores.select(np.concatenate([known, own]))
        fit = both.conditional_on(range(len(known))).fit(range(len(known), len(both.score)))
        return log_tail(np.array(fit.statistic), np.array(fit.rank), scores.freedom)

    assert len(effect.rivals) > 1
    for rival in effect.rivals:
        assert (rival.kind, rival.strut) != (effect.kind, effect.strut)
        assert rival.log_p < np.log(0.001) < significance(effect, rival)
    # The same force in another strut leaves the effect significant.
    others = [replace(effect, strut=strut) for strut in range(6) if strut != effect.strut]
    assert all(significance(effect, other) < np.log(0.001) for other in others)


def test_noise_that_was_given_too_small_is_no_cause(lab):
    """It has its own test; causes are judged by the noise that the recording shows."""
    experiment = lab.experiment(lab.measure(1))
    small = given_noise(0.4 * lab.noise.forces.covariance, lab.noise.lengths.covariance)
    given = replace(experiment, noise=small)
    result = diagnose(lab.robot, [given], lab.knowledge, lab.estimate([given]))
    assert _named(result) == []
    failed = [finding.assumption for finding in result.verdict.failed]
    assert "the forces are as noisy as assumed" in failed
