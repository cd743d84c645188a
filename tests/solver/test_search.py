"""The search as a whole, on tiny problems: what it may depend on, and what not."""

import dataclasses
import importlib
import math
import pickle
import time
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from expdesign.progress import listen_to_progress
from expdesign.solver.phases import SearchEvent
from expdesign.solver.search import GROUP, NoDesignError, groups, search
from expdesign.solver.starts import GIVEN_UP, StartResult, run_start
from expdesign.workers import Job, JobJournal, JobRunner, Monitor, run_jobs
from expdesign.workers.local import _Team

QUICK = {"max_iterations": 4}


def begun(index, kind="random", variables=()):
    """Return a start, or a hop from variables, without phases."""
    return StartResult(index, kind, np.array(variables))


class Recorder:
    """A monitor that keeps the events."""

    def __init__(self):
        self.events = []

    def report(self, event):
        self.events.append(event)

    def stop_requested(self):
        return False


@pytest.fixture(scope="module")
def run(build, plan, cheaper):
    """Search with another plan; return the result."""

    def searched(monitor=None, **changes):
        changed = dataclasses.replace(plan, iterations=4, **changes)
        with cheaper():
            return search(build(design=QUICK), changed, monitor or Monitor())

    return searched


@pytest.fixture(scope="module")
def one_start(run):
    return run(starts=1)


@pytest.fixture(scope="module")
def hopped(run):
    return run(starts=1, hops=3)


def merit(result, plan):
    return plan.evaluator.merit(result.trajectory, plan.problem.cost.samples)


def test_seed_and_starts(run, one_start, build, plan, monkeypatch):
    """More starts begin like fewer, and come to no less."""
    monkeypatch.setattr("expdesign.solver.phases._INTERVAL", 0.0)
    monitor = Recorder()
    # The plan that a job uses is the one that its workshop was built with.
    assert build(design=QUICK)().seed == 0
    one = one_start
    two = run(monitor, starts=2)
    np.testing.assert_array_equal(two.starts[0].variables, one.starts[0].variables)
    assert two.starts[0].merit == one.starts[0].merit
    assert merit(two, plan) >= merit(one, plan)
    assert np.max(np.abs(two.starts[0].variables - two.starts[1].variables)) > 1e-2
    _events_tell_everything(monitor.events, two)


def _events_tell_everything(events, result):
    for start in result.starts:
        mine = [event for event in events if event.start == start.index]
        ends = {"waiting", "done", "finish", "finished"}
        own = [event for event in mine if event.phase not in ends]
        assert [event.iteration for event in own] == [point.iteration for point in start.trace]
        (waits,) = (event for event in mine if event.phase == "waiting")
        assert waits.iteration == start.phases[0].iterations
        (done,) = (event for event in mine if event.phase == "done")
        assert done.status == start.status
        assert done.objective == start.merit
        assert done.iteration == start.iterations
    assert any(event.phase == "finish" for event in events)
    told = {event.start: event.objective for event in events if event.phase == "finished"}
    assert told == result.merits
    assert max(told, key=told.get) == result.best.index


def test_seeds_differ(plan):
    reached = []
    for seed in (1, 2):
        changed = dataclasses.replace(plan, seed=seed, iterations=2)
        reached.append(run_start(changed, Monitor(), begun(1), 1))
    assert np.max(np.abs(reached[0].variables - reached[1].variables)) > 1e-2


def test_hopping_is_never_worse_than_the_starts_alone(hopped, one_start):
    """By the smoothed objective: what the finish gains on top is not the same for all."""
    assert [start.kind for start in hopped.starts] == ["random", "hop", "hop", "hop"]
    assert [start.index for start in hopped.starts] == [1, 2, 3, 4]
    np.testing.assert_array_equal(hopped.starts[0].variables, one_start.starts[0].variables)
    assert hopped.best.rank >= one_start.best.rank
    assert hopped.finish.check.passed
    assert hopped.best.index in {start.index for start in hopped.starts}


@pytest.fixture
def reached(one_start, plan):
    """Return what makes a motion that has reached an objective."""
    one, size = one_start.starts[0], plan.problem.variables.size

    def at(index, objective, kind="hop", **changes):
        last = dataclasses.replace(one.phases[-1], objective=objective, violation=0.0)
        start = dataclasses.replace(
            one, index=index, kind=kind, variables=np.full(size, objective), phases=(last,)
        )
        return dataclasses.replace(start, **changes)

    return at


@pytest.fixture
def module(monkeypatch, one_start):
    """Return the search's module; finish and proof return the objective of a motion."""
    found = importlib.import_module("expdesign.solver.search")
    polished = one_start.finish

    def polish(_plan, _monitor, start):
        return dataclasses.replace(polished, merit=-float(start.variables[0]), index=start.index)

    monkeypatch.setattr(found, "polish_start", polish)

    def prove(_plan, _monitor, one):
        yield from ()
        return dataclasses.replace(one, merit=one.index)

    monkeypatch.setattr(found, "prove_design", prove)
    monkeypatch.setattr(found, "LAG", np.inf)
    return found


@pytest.fixture
def scripted(module, monkeypatch):
    """Give the results of rough searches, refinements and hops."""

    def script(rough, refine, hop=None):
        def run_start(_plan, monitor, start, until=None, reference=()):
            if start.kind == "hop":
                return hop(start, reference)
            return rough(monitor, start.index) if until == 1 else refine(start)

        monkeypatch.setattr(module, "run_start", run_start)

    return script


def test_the_best_of_the_rough_searches_are_refined(run, module, scripted, reached, monkeypatch):
    rough = {1: 5.0, 2: 3.0, 3: 4.0, 4: 9.0, 5: 1.0}
    refined = []

    def refine(start):
        refined.append(start.index)
        return reached(start.index, rough[start.index], "random")

    monkeypatch.setattr(module, "REFINED", 2)
    scripted(
        lambda _, index: reached(index, rough[index], "random", status="", merit=-np.inf), refine
    )
    monitor = Recorder()
    result = run(monitor, starts=5)
    assert refined == [5, 2]
    assert [start.status == GIVEN_UP for start in result.starts] == [True, False, True, True, False]
    assert {event.start for event in monitor.events if event.phase == "done"} == {1, 3, 4}
    assert result.merits.keys() == {2, 5}
    assert result.best.index == 5


@pytest.mark.parametrize(
    ("unproved", "finished", "best"),
    [((), {3, 5}, 3), ((3,), {3, 5}, 5), ((3, 5), {1, 2, 3, 5}, 1)],
)
def test_motions_that_lag_are_finished_if_the_others_are_not_proved(
    run, module, scripted, reached, monkeypatch, unproved, finished, best
):
    values = {1: 0.02, 2: 1.0, 3: 0.0, 4: 2.0, 5: 0.01, 6: 3.0}

    def prove(_plan, _monitor, one):
        yield from ()
        if one.index not in unproved:
            return one
        open_limits = [dataclasses.replace(limit, proved=np.inf) for limit in one.check.limits]
        return dataclasses.replace(one, check=dataclasses.replace(one.check, limits=open_limits))

    monkeypatch.setattr(module, "prove_design", prove)
    monkeypatch.setattr(module, "LAG", 0.015)
    scripted(
        lambda _, index: reached(index, values[index], "random", status="", merit=-np.inf),
        lambda start: reached(start.index, values[start.index], "random"),
    )
    result = run(starts=6, hops=0)
    assert result.merits.keys() == finished
    assert result.best.index == best


def test_others_are_refined_when_the_best_are_useless(run, module, scripted, reached, monkeypatch):
    def refine(start):
        useless = {"merit": -np.inf, "status": "broken"} if start.index < 3 else {}
        return reached(start.index, float(start.index), "random", **useless)

    monkeypatch.setattr(module, "REFINED", 2)
    scripted(
        lambda _, index: reached(index, float(index), "random", status="", merit=-np.inf), refine
    )
    result = run(starts=5)
    assert result.best.index == 3
    assert [start.status for start in result.starts][:2] == ["broken"] * 2
    assert result.starts[-1].status == GIVEN_UP


class Hops:
    """Hops with given results; their origins are recorded, told by their variables."""

    def __init__(self, reached, objectives):
        self.reached, self.objectives, self.origins = reached, objectives, []

    def __call__(self, hop, reference):
        self.origins.append((hop.index, self.index_of(hop.variables[0], reference)))
        return self.reached(hop.index, self.objectives.get(hop.index, 1e3))

    def index_of(self, objective, reference):
        """Return the number of the motion with an objective."""
        assert reference[-1].objective == objective
        known = {2.0 + k: k for k in (1, 2, 3)} | {value: k for k, value in self.objectives.items()}
        return known[objective]


@pytest.fixture
def hopping(run, module, scripted, reached, monkeypatch):
    """Return what searches with three starts that reached 3, 4, 5 and hops that reach given."""

    def searched(objectives, hops, *, weighs_gain=False, **changes):
        stand_in = Hops(reached, objectives)
        scripted(
            lambda _, index: reached(index, float(index), "random", status="", merit=-np.inf),
            lambda start: reached(start.index, 2.0 + start.index, "random"),
            stand_in,
        )
        for name, value in changes.items():
            monkeypatch.setattr(module, name, value)
        return run(starts=3, hops=hops, weighs_gain=weighs_gain), stand_in

    return searched


def test_a_hop_takes_its_origins_place_only_when_it_is_better(hopping):
    objectives = {5: 2.5, 8: 2.4, 9: 2.6}
    result, hops = hopping(objectives, 9, TOGETHER=2)
    # The second start's hop reached 2.5: the best now. 2.4 is better than the 3 of the first start,
    # whose hop it is; 2.6 is no better than 2.5.
    assert hops.origins == [
        *((4, 1), (5, 2), (6, 1), (7, 5)),
        *((8, 1), (9, 5), (10, 8), (11, 5), (12, 8)),
    ]
    assert result.best.index == 8
    assert len(result.starts) == 12
    assert result.ended == "all starts and hops were made"


def test_hops_under_way_at_once_set_out_from_different_motions(hopping):
    _, hops = hopping({}, 9, TOGETHER=3)
    origins = [origin for _, origin in hops.origins]
    assert all(len(set(origins[k : k + 3])) == 3 for k in range(7))
    # With fewer motions than may be under way there are fewer.
    _, others = hopping({}, 9, TOGETHER=8)
    assert others.origins == hops.origins


def test_a_late_gain_does_not_set_a_group_out_again(hopping):
    """6 fails, that is enough; 7 and 8 were under way by then."""
    result, hops = hopping({8: 0.5}, 300, TOGETHER=3, PATIENCE=3)
    assert [number for number, _ in hops.origins] == [4, 5, 6, 7, 8]
    assert result.best.index == 8
    assert "chance" not in result.ended


def test_hops_set_out_from_others_where_they_come_to_nothing(hopping):
    """Each hop that failed counts: 3, 4 and 5 are about equally promising in the end."""
    _, hops = hopping({}, 12, TOGETHER=1, FAILED=0.35)
    assert [origin for _, origin in hops.origins] == [1, 1, 1, 2, 1, 2, 1, 2, 1, 3, 2, 1]
    # One that gets on has none against it any more: 7 reached 3.5 from 4.
    _, hops = hopping({7: 3.5}, 7, TOGETHER=1, FAILED=0.35)
    assert [origin for _, origin in hops.origins] == [1, 1, 1, 2, 7, 7, 1]


def test_hops_end_when_none_finds_anything_better(hopping):
    result, hops = hopping({5: 2.5}, 500, TOGETHER=2, PATIENCE=20)
    # Two that count, twenty since, and the one that was under way by then.
    assert len(hops.origins) == 23
    # 0.05 = (1 - p)^21
    assert "13 %" in result.ended
    assert result.best.index == 5


@pytest.mark.parametrize(("best", "said"), [(4, False), (204, True)])
def test_a_chance_is_stated_only_of_the_last_group_and_if_the_best_is_of_it(hopping, best, said):
    """Each start is a group, and four hops that fail are its end: 4 to 7, 104 on, 204 on."""
    result, _ = hopping({best: 0.5}, 300, GROUP=1, PATIENCE=4, TOGETHER=1)
    assert result.best.index == best
    assert ("chance" in result.ended) == said


@pytest.mark.parametrize("moves", [True, False])
def test_the_time_allowed_begins_when_a_start_moves(run, scripted, reached, moves):
    """Processes may take seconds until they can work."""

    def rough(monitor, index):
        if moves:
            monitor.report(SearchEvent(index, "blunt", 1, 0.0, 0.0, 0.0))
        time.sleep(0.02)
        return reached(index, float(index), "random", status="", merit=-np.inf)

    scripted(rough, lambda start: reached(start.index, 2.0, "random"))
    result = run(starts=3, hops=0, max_seconds=0.01)
    assert len(result.starts) == (1 if moves else 3)


def test_a_search_that_is_stopped_keeps_what_has_gone_through_all_phases(
    run, module, scripted, reached, monkeypatch
):
    """Motions that are in the first stage still have a better objective, of another problem."""
    refined = []

    def rough(_, index):
        return reached(index, -9.0 if index == 2 else 5.0, "random", status="", merit=-np.inf)

    def refine(start):
        refined.append(start.index)
        result = reached(start.index, start.variables[0], "random")
        if start.index == 1:
            return dataclasses.replace(result, phases=result.phases * 2)
        return result

    scripted(rough, refine)
    monkeypatch.setattr(module, "GROUP", 1)
    monkeypatch.setattr(module, "FINISHED", 1)
    result = run(starts=2, hops=0)
    assert refined == [1, 2]
    assert result.best.index == 1


@pytest.mark.parametrize("starts", [1, 2, GROUP, GROUP + 1, 5 * GROUP, 5 * GROUP + 3])
def test_every_start_is_in_one_group_and_groups_are_about_as_large(starts):
    found = groups(starts)
    assert [number for group in found for number in group] == list(range(1, starts + 1))
    sizes = {len(group) for group in found}
    assert max(sizes) <= GROUP
    assert max(sizes) - min(sizes) <= 1
    assert len(found) == -(-starts // GROUP)


def test_every_group_has_its_share_of_the_hops(hopping):
    """Three groups of one start each; hops set out from motions of their own group alone."""
    _, hops = hopping({}, 7, GROUP=1, TOGETHER=2)
    assert [origin for _, origin in hops.origins] == [1, 1, 2, 2, 3, 3, 3]
    assert [number for number, _ in hops.origins] == list(range(4, 11))
    # The first gets no more after two that came to nothing; the others have no more for that.
    result, hops = hopping({10: 4.5}, 9, GROUP=1, TOGETHER=1, PATIENCE=2)
    assert hops.origins == [(4, 1), (5, 1), (7, 2), (8, 2), (10, 3), (11, 10), (12, 10)]
    assert result.best.index == 1
    assert len(result.starts) == 3 + 7


def test_groups_are_the_same_side_by_side(run, module, scripted, reached, monkeypatch):
    """With more workers groups do not wait for each other; their motions are the same."""

    def hop(start, reference):
        return reached(start.index, reference[-1].objective - (start.index % 3 == 0) * 0.1)

    def searched(busy):
        monkeypatch.setattr(module, "BUSY", busy)
        result = run(starts=3, hops=9)
        return [(start.index, start.phases[-1].objective) for start in result.starts]

    scripted(
        lambda _, index: reached(index, float(index), "random", status="", merit=-np.inf),
        lambda start: reached(start.index, 2.0 + start.index, "random"),
        hop,
    )
    monkeypatch.setattr(module, "GROUP", 1)
    assert searched(1.0) == searched(0.25)


def test_hops_end_when_they_are_expected_to_gain_too_little(hopping):
    """The scale of records is that of other searches, with a weight, and of the own gains."""
    result, hops = hopping({}, 500, weighs_gain=True)
    expected = [0.009 * 8 / (math.log1p(k) + 8) * math.log1p(8 / (1 + k)) for k in range(99)]
    (enough,) = (k for k in range(1, 99) if expected[k] < 0.0015 <= expected[k - 1])
    # There are three motions, and so as many at once.
    assert len(hops.origins) == enough + 2
    assert f"after {enough + 2} hops: 8 more are expected to gain less than 0.15 %" in result.ended
    # Who gains more goes on for longer; stated hops are all made, but for a long standstill.
    _, others = hopping({9: 2.97}, 500, weighs_gain=True)
    assert enough + 2 < len(others.origins) < 80
    assert len(hopping({}, 60)[1].origins) == 60


def test_a_hop_knows_its_origin_and_is_given_up(plan, one_start):
    quick = dataclasses.replace(plan, iterations=4)
    start = one_start.starts[0]
    hop = run_start(quick, Monitor(), begun(6, "hop", start.variables))
    assert (hop.kind, hop.index) == ("hop", 6)
    assert hop.usable
    assert [phase.name for phase in hop.phases] == [phase.name for phase in start.phases]
    out_of_reach = tuple(dataclasses.replace(one, objective=-1e9) for one in start.phases)
    given_up = run_start(quick, Monitor(), begun(6, "hop", start.variables), None, out_of_reach)
    assert not given_up.usable
    assert given_up.status == GIVEN_UP
    assert given_up.rank < hop.rank


def test_a_start_goes_on_where_its_rough_search_ended(plan, one_start):
    quick = dataclasses.replace(plan, iterations=4)
    rough = run_start(quick, Monitor(), begun(1), 1)
    assert (len(rough.phases), rough.status, rough.usable) == (1, "", False)
    refined = run_start(quick, Monitor(), rough)
    whole = one_start.starts[0]
    assert refined.phases[0] == rough.phases[0]
    assert refined.trace == whole.trace
    np.testing.assert_array_equal(refined.variables, whole.variables)
    assert refined.seconds >= rough.seconds


def test_starts_and_hops_in_other_processes_are_the_same(build):
    make = build(design={"max_iterations": 2})
    first = run_start(make(), Monitor(), begun(7), 1)
    best = run_start(make(), Monitor(), first)
    hop = Job(run_start, (begun(6, "hop", best.variables), None, best.phases))
    jobs = [hop, Job(run_start, (first,))]
    one, two = (list(run_jobs(make, jobs, workers, Monitor())) for workers in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.variables, b.variables)
        assert (a.trace, a.status, a.merit) == (b.trace, b.status, b.merit)
    assert pickle.loads(pickle.dumps(one[0])).rank == one[0].rank


@pytest.mark.slow
def test_jobs_ahead_change_no_digit(build, plan, monkeypatch):
    """Results of hops, finishes and proofs done ahead, and of proofs led here, are used."""
    module = importlib.import_module("expdesign.solver.search")
    monkeypatch.setattr(module, "TOGETHER", 2)
    monkeypatch.setattr(module, "REFINED", 2)
    used, proofs = Counter(), []
    lead, begin = JobRunner.lead, _Team._begin

    def leading(self, *arguments):
        proofs.append("led")
        return lead(self, *arguments)

    def beginning(self, job):
        if job.key in self._ahead.known or job.key in self._ahead.busy.values():
            used[job.arguments[1].function.__name__] += 1
        return begin(self, job)

    def listening(what, _done, _total):
        if what == "proving the limits":
            proofs.append(what)

    monkeypatch.setattr(JobRunner, "lead", leading)
    monkeypatch.setattr(_Team, "_begin", beginning)
    settings = {"max_iterations": 8, "starts": 4, "search": "hopping", "hops": 8}
    results, present = [], build(design=settings)()
    for workers in (1, 2, 4, 7):
        proofs.clear()
        changed = dataclasses.replace(present, workers=workers)
        with listen_to_progress(listening):
            results.append(search(build(design=settings), changed, Monitor()))
        assert workers > 1 or not used
        # The report precedes the proof, and there is none where its result is used.
        led = [k for k, what in enumerate(proofs) if what == "led"]
        assert all(k and proofs[k - 1] != "led" for k in led)
        assert not led or proofs[-1] == "led"
        assert len(proofs) <= max(1, 2 * len(led))
    assert {"run_start", "polish_start", "polish_again", "prove_limits"} <= used.keys()
    first = results[0]
    for other in results[1:]:
        assert other.trajectory.vector().tobytes() == first.trajectory.vector().tobytes()
        assert other.merits == first.merits
        assert [one.trace for one in other.starts] == [one.trace for one in first.starts]
        assert other.finish.check == first.finish.check


def test_finished_motions_that_keep_the_limits_come_first_the_others_by_their_worst():
    def candidate(merit, *, passed=True, certified=True, worst=0.0):
        check = SimpleNamespace(passed=passed, certified=passed and certified, worst=worst)
        return StartResult(1, "finish", None, merit, check=check)

    ranked = [
        candidate(1.0),
        candidate(5.0, certified=False),
        candidate(9.0, passed=False, worst=0.1),
        candidate(99.0, passed=False, worst=0.2),
    ]
    mixed = [ranked[k] for k in (2, 0, 3, 1)]
    assert sorted(mixed, key=lambda one: one.rank, reverse=True) == ranked


def test_what_no_smaller_motion_keeps_is_brought_within(run, monkeypatch):
    """Rates and accelerations cancel in part: a smaller motion may break what a larger keeps."""
    from expdesign.solver import starts as module

    real = module.shrink_to_limits

    def broken(problem, trajectory, points):
        return dataclasses.replace(real(problem, trajectory, points=points), kept=False)

    monkeypatch.setattr(module, "shrink_to_limits", broken)
    found = run(starts=1)
    assert found.best.usable
    assert found.finish.check.passed


def test_no_start_keeps_the_limits(run, monkeypatch):
    """What the starts came to is said and kept."""
    from expdesign.solver import starts as module
    from expdesign.solver.feasibility import RestoredMotion

    def hopeless(problem, *_, **__):
        nothing = np.empty((0, 0))
        x = np.append(np.zeros(problem.variables.size - 1), 1.0)
        return RestoredMotion(problem.variables.trajectory(x), 0.8, nothing, nothing, kept=False)

    monkeypatch.setattr(module, "shrink_to_limits", hopeless)
    monkeypatch.setattr(module, "restore_limits", hopeless)
    with pytest.raises(NoDesignError, match="none of 1 starts") as caught:
        run(starts=1)
    assert len(caught.value.starts) == 1
    assert caught.value.starts[0].merit == -np.inf
    assert caught.value.starts[0].status in str(caught.value)


def test_a_search_continues_from_the_results_in_its_journal(build, plan, cheaper, tmp_path):
    changed = dataclasses.replace(plan, iterations=4, starts=2, hops=2)

    def searched(monitor):
        journal = JobJournal(tmp_path / "search.jsonl", "inputs", StartResult, resume=True)
        with cheaper():
            return search(build(design=QUICK), changed, monitor, journal)

    first, monitor = searched(Monitor()), Recorder()
    again = searched(monitor)
    for start, other in zip(first.starts, again.starts, strict=True):
        np.testing.assert_array_equal(start.variables, other.variables)
        assert (start.merit, start.phases, start.trace) == (other.merit, other.phases, other.trace)
    np.testing.assert_array_equal(first.trajectory.vector(), again.trajectory.vector())
    # Nothing but the finish is done again, and the display counts every start.
    assert {event.phase for event in monitor.events} == {"waiting", "done", "finish", "finished"}
    done = {event.start: event.objective for event in monitor.events if event.phase == "done"}
    assert done == {start.index: start.merit for start in first.starts}
