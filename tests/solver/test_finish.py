import dataclasses
import importlib
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from expdesign.recheck.certificate import recheck
from expdesign.recheck.limit_check import LimitCheck, Recheck
from expdesign.solver.feasibility import random_start
from expdesign.solver.finish import polish
from expdesign.solver.interior_point import Solution
from expdesign.solver.phases import Phase, finish_phase
from expdesign.solver.starts import StartResult, no_report
from expdesign.trajectory import KnownHum, round_period
from expdesign.workers import Monitor

# --- whole controller steps -----------------------------------------------------------------------


@given(
    frequency=st.floats(0.01, 10),
    below=st.floats(0.5, 1),
    above=st.floats(1, 2),
    step=st.floats(1e-4, 1e-2),
)
def test_the_nearest_period_of_whole_steps(frequency, below, above, step):
    omega = 2 * np.pi * frequency
    bounds = (omega * below, omega * above)
    shortest, longest = 1 / (frequency * above), 1 / (frequency * below)
    assume(longest - shortest > 2 * step)
    found, steps = round_period(omega, bounds, step)
    assert bounds[0] * (1 - 1e-9) <= found <= bounds[1] * (1 + 1e-9)
    assert isinstance(steps, int)
    assert 2 * np.pi / found == pytest.approx(steps * step, rel=1e-12)
    # Within half a step of what was wanted, unless the bounds forbid it.
    period = 1 / frequency
    reach = 0.5 if shortest + step / 2 <= period <= longest - step / 2 else 1.0
    assert abs(2 * np.pi / found - period) <= (reach + 1e-6) * step


@pytest.mark.parametrize(("seconds", "steps"), [(2.0, 2000), (2.0004, 2000), (2.0006, 2001)])
def test_whole_steps(seconds, steps):
    found, count = round_period(2 * np.pi / seconds, (1.0, 10.0), 1e-3)
    assert count == steps
    assert 2 * np.pi / found == pytest.approx(steps * 1e-3, rel=1e-14)


@pytest.mark.parametrize("seconds", [1.0, 0.5, 1 / 0.6 // 1e-3 * 1e-3, 0.3])
def test_bounds_that_are_whole_steps_themselves_can_be_reached(seconds):
    """Rounding errors of 2π/ω do not shut out the bound."""
    omega = 2 * np.pi / seconds
    for bounds in ((omega, 2 * omega), (omega / 2, omega), (omega, omega)):
        found, steps = round_period(omega, bounds, 1e-3)
        assert steps == round(seconds / 1e-3)
        assert found == pytest.approx(omega, rel=1e-12)


def test_no_whole_number_of_steps():
    with pytest.raises(ValueError, match="whole number of steps"):
        round_period(2 * np.pi / 2.0005, (2 * np.pi / 2.0007, 2 * np.pi / 2.0003), 1e-3)


def test_periods_keep_away_from_a_hum():
    hum = KnownHum((50.0, 100.0), 10)
    wanted = 2 * np.pi / 2.0004
    assert round_period(wanted, (1.0, 10.0), 1e-3)[1] == 2000
    assert not all(one.kept for one in hum.distances(2 * np.pi / 2.0))
    found, steps = round_period(wanted, (1.0, 10.0), 1e-3, hum)
    # 50 Hz turns 0.05 times more with every step: it is a tenth of a turn away after two.
    assert steps == 2002
    assert all(one.kept for one in hum.distances(found))
    assert hum.distances(found)[0].distance == pytest.approx(abs(50 - 100 / 2.002), rel=1e-9)
    # From 1999.6 steps 1998 are nearer than 2002.
    assert round_period(2 * np.pi / 1.9996, (1.0, 10.0), 1e-3, hum)[1] == 1998


@pytest.mark.parametrize(("periods", "step"), [(10, 20e-3), (1, 1e-3)])
def test_where_no_period_keeps_away_the_nearest_is_taken(periods, step):
    hum = KnownHum((50.0,), periods)
    omega = 2 * np.pi / 2.001
    assert round_period(omega, (1.0, 10.0), step, hum) == round_period(omega, (1.0, 10.0), step)


# --- mending --------------------------------------------------------------------------------------


@pytest.fixture
def on_coarse_grid(monkeypatch):
    monkeypatch.setattr(
        importlib.import_module("expdesign.recheck.limit_check"), "LEAST_POINTS", 400
    )


def test_the_finish_keeps_limits_and_frequency(plan, on_coarse_grid):
    """From a motion that breaks the limits between the samples to one that does not."""
    problem = plan.problem
    x = random_start(problem, np.random.default_rng(0), 40, 0.4)
    x[:-1] *= 1.04
    omega = 2 * np.pi / 2.5
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    phase = finish_phase(problem, plan.widths, plan.iterations)
    seen = []

    def report(done, most):
        return lambda number, *_: seen.append(done.iterations + number) or True

    none = polish(fixed, plan.evaluator, x, phase, rounds=0, report=report)
    assert seen == []
    done = polish(fixed, plan.evaluator, x, phase, rounds=1, report=report)
    assert seen == list(range(1, len(seen) + 1))
    for finished in (none, done):
        assert finished.trajectory.omega == pytest.approx(omega, rel=1e-14)
        again = recheck(fixed.limits, finished.trajectory)
        assert again == finished.check
    assert done.check.passed
    assert done.phases[-1].rounds == 1
    samples = problem.cost.samples
    assert plan.evaluator.merit(done.trajectory, samples) >= plan.evaluator.merit(
        none.trajectory, samples
    )
    assert dataclasses.asdict(done.phases[-1])["evaluations"]["grad_f"] > 0


def test_a_limit_of_which_nothing_can_be_proved_counts_with_what_was_found(plan, on_coarse_grid):
    """One without enclosure: the motion is not shrunk for want of a proof, and rounds count."""
    problem = plan.problem
    x = random_start(problem, np.random.default_rng(0), 40, 0.4)
    x[:-1] *= 1.04
    omega = 2 * np.pi / 2.5
    phase = finish_phase(problem, plan.widths, plan.iterations)
    limits = problem.limits.limits
    same = [k for k, limit in enumerate(limits) if limit.definition.smooth is None]
    for place in (same[0], same[-1]):
        own = dataclasses.replace(
            limits[place].definition, smooth=limits[place].definition.natural, numerical=np.positive
        )
        changed = [*limits]
        changed[place] = dataclasses.replace(limits[place], definition=own)
        model = dataclasses.replace(problem.limits, limits=tuple(changed))
        fixed = dataclasses.replace(problem, limits=model).with_variables(
            omega_bounds=(omega, omega)
        )
        none, done = (
            polish(fixed, plan.evaluator, x, phase, rounds=rounds, report=no_report)
            for rounds in (0, 1)
        )
        for finished in (none, done):
            assert finished.check.passed
            assert not finished.check.certified
            assert np.isnan(finished.check.limits[place].proved)
            assert finished.shrink > 0.5
        merits = [
            plan.evaluator.merit(one.trajectory, problem.cost.samples) for one in (none, done)
        ]
        assert merits[1] > merits[0] + 1


def test_the_finish_can_be_stopped(plan, on_coarse_grid):
    problem = plan.problem
    x = random_start(problem, np.random.default_rng(0), 40, 0.4)
    phase = finish_phase(problem, plan.widths, plan.iterations)
    omega = 2 * np.pi / 2.5
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    calls = []

    def report(done, most):
        return lambda number, *_: bool(calls.append(done.iterations + number))

    finished = polish(fixed, plan.evaluator, x, phase, rounds=4, report=report)
    assert calls == [1]
    assert finished.phases[-1].status == "User_Requested_Stop"
    assert finished.phases[-1].rounds == 1


def finished(trajectory, check, merit, variables=None):
    return StartResult(1, "finish", variables, merit, trajectory=trajectory, check=check)


# --- what is proved, and kept ---------------------------------------------------------------------

START, BETTER = 0.0, 0.01
CERTIFIED, UNPROVED, BROKEN = (-1e-4, -1e-5), (-1e-4, 1e-3), (1e-2, 1e-2)
"""Excess of a limit as it is found, and as it is proved."""


class Scripted:
    """Finishes without motions: results of solves are given, and those of their proofs."""

    def __init__(self, monkeypatch, motions, status="Solve_Succeeded"):
        self.motions, self.status, self.proved, self.solves = motions, status, [], 0
        module = importlib.import_module("expdesign.solver.finish")
        monkeypatch.setattr(module, "_check", self.check)
        monkeypatch.setattr(module, "_critical_rows", lambda *_: (None, np.empty(0), None))
        for solver in ("solve_with_ipopt", "solve_by_interior_point"):
            monkeypatch.setattr(module, solver, self.solve)

    def check(self, _problem, _evaluator, x, _width, *, proving):
        number = int(x[0])
        merit, (found, proved) = self.motions[number]
        if proving:
            self.proved.append(number)
        one = LimitCheck("k", "", "", "m", 0.0, 1.0, found, 0.0, "o")
        one = dataclasses.replace(one, proved=proved if proving else np.nan)
        return finished({"number": number}, Recheck((one,)), merit), None

    def solve(self, *_, **__):
        self.solves += 1
        x = np.array([self.solves, 0.0])
        return Solution(x, 0.0, np.empty(0), self.status, 1, {}, 0.0, x)

    def polish(self, rounds):
        """Return the number of the motion that is kept, and whether it is certified."""
        variables = SimpleNamespace(harmonics=5, bounds=lambda: (np.array([0.0, 1.0]),) * 2)
        problem = SimpleNamespace(
            variables=variables,
            limits=SimpleNamespace(keys=["k"]),
            cost=SimpleNamespace(samples=10),
            cost_value=lambda *_: 0.0,
            program=lambda *_, **__: None,
        )
        evaluator = SimpleNamespace(gain=lambda one, other: one - other)
        phase = Phase("finish", 0.1, 0.0, 10, 10, 0.1, 0.2, 10)
        done = polish(
            problem, evaluator, np.zeros(2), phase, rounds=rounds, report=no_report, settled=True
        )
        return done.trajectory["number"], done.check.certified


@pytest.mark.parametrize("status", ["Solve_Succeeded", "User_Requested_Stop"])
@pytest.mark.parametrize("rounds", [0, 1, 4])
@pytest.mark.parametrize("found", [(BETTER, UNPROVED), (BETTER, BROKEN), (-BETTER, CERTIFIED)])
def test_a_motion_that_can_be_certified_is_kept(found, rounds, status, monkeypatch):
    motions = {0: (START, CERTIFIED)} | dict.fromkeys(range(1, 5), found)
    script = Scripted(monkeypatch, motions, status)
    assert script.polish(rounds) == (0, True)
    assert script.proved.count(0) == 1


def test_what_a_better_motion_set_out_from_is_not_proved(monkeypatch):
    script = Scripted(monkeypatch, {0: (START, CERTIFIED), 1: (BETTER, CERTIFIED)})
    assert script.polish(4) == (1, True)
    assert script.proved == [1]


def test_nothing_is_certified_that_cannot_be(monkeypatch):
    motions = {0: (START, UNPROVED)} | dict.fromkeys(range(1, 5), (BETTER, UNPROVED))
    assert Scripted(monkeypatch, motions).polish(4) == (1, False)


# --- the best motion, again -----------------------------------------------------------------------


def _proved_of(monkeypatch, plan, outcomes, stopped=False, unprovable=()):
    """Return which outcome is kept: `outcomes` are (merit, passed), the first one is given."""
    module = importlib.import_module("expdesign.solver.finish")
    motions = [plan.problem.variables.trajectory(_numbered(plan, k)) for k in range(len(outcomes))]
    made = [
        finished(
            motion,
            Recheck((_limit(-1e-3 if passed else 1e-2),)),
            merit,
            plan.problem.variables.pack(motion),
        )
        for motion, (merit, passed) in zip(motions, outcomes, strict=True)
    ]
    number = iter(range(1, len(outcomes)))

    def numbered(x):
        distances = [np.max(np.abs(x - plan.problem.variables.pack(one))) for one in motions]
        return int(np.argmin(distances))

    def polish_start(_plan, _monitor, start, *, proving=False, settled=False):
        x = start.variables
        if proving:
            proof = -1e-4 if numbered(x) not in unprovable else np.nan
            check = Recheck((dataclasses.replace(_limit(-1e-3), proved=proof),))
            return dataclasses.replace(made[numbered(x)], check=check)
        return made[next(number)]

    monkeypatch.setattr(module, "polish_start", polish_start)
    monkeypatch.setattr(module, "solve_phase", lambda _problem, _phase, x, _report: (x, None))
    evaluator = SimpleNamespace(gain=lambda merit, before: merit - before)
    scripted = dataclasses.replace(plan, evaluator=evaluator, hops=1)
    monitor = Monitor(lambda: stopped, lambda _event: None)
    proved = completed(module.prove_design(scripted, monitor, made[0]), scripted, monitor)
    return numbered(plan.problem.variables.pack(proved.trajectory))


def completed(procedure, built, monitor):
    """Return the value of a procedure whose jobs are done here."""
    jobs = next(procedure)
    while True:
        results = [job.function(built, monitor, *job.arguments) for job in jobs]
        try:
            jobs = procedure.send(results)
        except StopIteration as end:
            return end.value


def _numbered(plan, k):
    x = np.zeros(plan.problem.variables.size)
    x[[0, -1]] = 0.01 * k, 1.0
    return x


def _limit(excess):
    return LimitCheck("k", "", "", "m", 0.0, 1.0, excess, 0.0, "o")


@pytest.mark.parametrize(
    ("outcomes", "proved"),
    [
        ([(1.0, True), (0.9, True), (2.0, True)], 0),
        ([(1.0, True), (1.1, True), (1.2, True), (1.2, True), (2.0, True)], 2),
        ([(1.0, True), (1.1, False), (2.0, True)], 0),
        ([(1.0, False), (0.9, True), (0.8, True)], 1),
    ],
)
def test_the_best_motion_is_finished_again_as_long_as_it_becomes_better(
    monkeypatch, plan, outcomes, proved
):
    assert _proved_of(monkeypatch, plan, outcomes) == proved


@pytest.mark.parametrize(("unprovable", "proved"), [({1}, 2), ({2}, 0), ({0, 2}, 2)])
def test_what_became_better_and_cannot_be_proved_is_given_up(monkeypatch, plan, unprovable, proved):
    outcomes = [(1.0, True), (1.1, True), (1.2, True), (1.2, True)]
    assert _proved_of(monkeypatch, plan, outcomes, unprovable=unprovable) == proved


def test_after_a_stop_it_is_not(monkeypatch, plan):
    assert _proved_of(monkeypatch, plan, [(1.0, True), (1.1, True)], stopped=True) == 0
