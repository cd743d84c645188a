from types import SimpleNamespace

import hypothesis.strategies as st
from hypothesis import given

from expdesign.solver.jobs import CAPACITY, Candidate, Population

candidates = st.builds(
    lambda merit, passed, worst, lineage: Candidate(
        merit,
        SimpleNamespace(check=SimpleNamespace(passed=passed, certified=passed, worst=worst)),
        SimpleNamespace(),
        lineage,
    ),
    st.integers(-5, 5).map(float),
    st.booleans(),
    st.integers(0, 3).map(float),
    st.integers(1, 6),
)


def admitted(sequence):
    population = Population.of(sequence[:1])
    for candidate in sequence[1:]:
        population = population.admit(candidate)
    return population


@given(st.lists(candidates, min_size=1, max_size=30))
def test_whoever_is_best_is_kept_and_lineages_are_different(sequence):
    population = admitted(sequence)
    ranks = [member.rank for member in population.members]
    lineages = [member.lineage for member in population.members]
    assert population.best.rank == max(candidate.rank for candidate in sequence)
    assert ranks == sorted(ranks, reverse=True)
    assert len(set(lineages)) == len(lineages) <= CAPACITY
    passed = [rank for rank in ranks if rank[0]]
    assert (population.least is None) == (len(passed) < CAPACITY)
    assert population.least is None or population.least.rank == min(ranks)


@given(st.lists(candidates, min_size=1, max_size=30), candidates)
def test_one_more_never_makes_any_place_worse(sequence, another):
    before = admitted(sequence)
    after = before.admit(another)
    assert len(after.members) >= len(before.members)
    for old, new in zip(before.members, after.members, strict=False):
        assert new.rank >= old.rank


@given(st.lists(candidates, min_size=1, max_size=30))
def test_everyone_has_a_turn(sequence):
    population = admitted(sequence)
    count = len(population.members)
    assert tuple(population.origin(turn) for turn in range(count, 2 * count)) == population.members


def candidate(merit, lineage, *, passed=True, worst=0.0):
    finished = SimpleNamespace(check=SimpleNamespace(passed=passed, certified=passed, worst=worst))
    return Candidate(merit, finished, SimpleNamespace(), lineage)


def test_what_passed_the_recheck_comes_first_and_the_rest_by_its_worst_limit():
    good, broken, worse = (
        candidate(1.0, 1),
        candidate(9.0, 2, passed=False, worst=0.1),
        candidate(99.0, 3, passed=False, worst=0.2),
    )
    assert Population.of([worse, broken, good]).members == (good, broken, worse)


def test_a_descendant_takes_the_place_of_its_ancestor_only_when_it_is_better():
    ancestor, other = candidate(2.0, 1), candidate(1.0, 2)
    population = Population.of([ancestor, other])
    assert population.admit(candidate(1.5, 1)) is population
    better = candidate(3.0, 1)
    assert population.admit(better).members == (better, other)
