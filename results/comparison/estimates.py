"""Comparison of estimates: parameters with intervals, and tests of their differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from estimation.estimators.covariance import Effects
from estimation.identification.result import EstimationResult
from estimation.twin.truth import Truth
from estimation.uncertainty.intervals import Differences, difference_test
from expdesign.configuration.tolerances import machine_name
from expdesign.mechanism.terms import parameter_unit
from expdesign.runfolder.manifest import file_hash
from results.figures.parameters import ParameterSeries, compared_estimates_figure
from results.notation import count_text
from results.views import view
from results.views.blocks import (
    differences_table,
    estimated_values,
    information_sentence,
    information_test,
)
from results.views.folder import RunFolder
from results.views.parameter_blocks import symbols_blocks

_TWO_SIDED = 1.959963984540054
"""Half-width of a 95 % interval in standard deviations."""


@dataclass(frozen=True, eq=False)
class ComparedEstimate:
    """The best estimate of one folder."""

    label: str
    folder: RunFolder
    result: EstimationResult

    @property
    def changed(self) -> bool:
        """Whether its files or inputs were changed by hand: its claims may not hold for them."""
        return bool(self.folder.changes.of("estimate"))

    def of(self, names: tuple[str, ...]) -> tuple[Array, Array]:
        """Return values, (m,), and standard deviations, NaN for fixed ones, of parameters, SI."""
        variance = np.diag(self.covariance(names))
        return (
            estimated_values(self.result, self.result.best)[self._places(names)],
            np.sqrt(np.where(variance > 0, variance, np.nan)),
        )

    def covariance(self, names: tuple[str, ...]) -> Array:
        """Return the covariance of parameters, (m, m), SI."""
        at = self._places(names)
        return self.result.best_estimator.covariance[np.ix_(at, at)]

    def difference_covariance(self, other: ComparedEstimate, names: tuple[str, ...]) -> Array:
        """Return the covariance of the difference to an estimate from independent data, (m, m), SI.

        The effect of the tolerances is shared by estimates of one machine; only the difference
        between its effects on both counts.
        """
        total = self.covariance(names) + other.covariance(names)
        if machine_name(self.result.robot) != machine_name(other.result.robot):
            return total
        own, others = self._effects(names), other._effects(names)
        for key in (key for key in own if key in others):
            shared = np.multiply.outer(own[key], others[key])
            total = total - shared - shared.T
        return total

    def _effects(self, names: tuple[str, ...]) -> Effects:
        found, at = self.result.best_estimator.systematic, self._places(names)
        return {} if found is None else {key: one[at] for key, one in found.effects.items()}

    def _places(self, names: tuple[str, ...]) -> list[int]:
        return [self.result.parameters.index(name) for name in names]


def common_parameters(found: tuple[ComparedEstimate, ...]) -> tuple[str, ...]:
    """Return the parameters of all estimates, in the order of the first."""
    first, *others = (each.result.parameters for each in found)
    return tuple(name for name in first if all(name in other for other in others))


def compare_estimates(folders: Mapping[str, RunFolder], *_: object) -> view.StageView:
    """Return the comparison of the best estimates of folders."""
    found = tuple(
        ComparedEstimate(label, folder, folder.result(EstimationResult))
        for label, folder in folders.items()
    )
    names = common_parameters(found)
    blocks: list[view.Block] = [
        *_derived_tables(found),
        _values_table(found, names),
        *symbols_blocks(names, screen=True),
    ]
    if len(found) > 1:
        first, std = found[0].of(names)
        chosen = {each.label: each.of(names) for each in found}
        deviations = {label: (values - first) / std for label, (values, _) in chosen.items()}
        errors = {label: _TWO_SIDED * own / std for label, (_, own) in chosen.items()}
        series = ParameterSeries(names, deviations, errors)
        blocks.append(view.Drawing(compared_estimates_figure, series))
    different, tested = 0, 0
    for number, (one, other) in enumerate(combinations(found, 2), start=1):
        title = f"{other.label} − {one.label}"
        changed = " and ".join(each.label for each in (one, other) if each.changed)
        reason = f"Changed: {changed}." if changed else not_independent(one, other)
        if reason:
            text = f"{title}: not tested. {reason}"
            blocks.append(view.TextBlock(text, view.Level.CAUTION))
            continue
        covariance = one.difference_covariance(other, names)
        test = difference_test(one.of(names)[0], other.of(names)[0], covariance)
        tested += 1
        different += test.differ
        blocks.append(view.TextBlock(_sentence(title, test)))
        caption = f"{title}: each parameter against the uncertainty from noise and tolerances"
        blocks.append(differences_table(f"difference_{number}", caption, names, test))
    for each in found:
        test_of_information = information_test(each.result)
        if test_of_information is not None and not each.changed:
            text = f"{each.label}. {information_sentence(test_of_information)}."
            blocks.append(view.TextBlock(text))
    sentence = f"{count_text(len(found), 'estimate')} of {len(names)} common parameters."
    if tested:
        sentence += (
            f" {different} of {count_text(tested, 'independent pair')} differ significantly."
        )
    elif len(found) > 1:
        is_changed = any(each.changed for each in found)
        sound = "independent and unchanged" if is_changed else "independent"
        sentence += f" None of the pairs is {sound}: no difference could be tested."
    level = view.Level.CAUTION if different else view.Level.NEUTRAL
    verdict = view.StageVerdict("Estimates", level, "compared", sentence, "estimates")
    facts = (view.Fact("pairs that differ", f"{different} of {tested}", "independent data only"),)
    return view.StageView(verdict, tuple(blocks), facts if tested else ())


def not_independent(one: ComparedEstimate, other: ComparedEstimate) -> str:
    """Return the reason why the data of two estimates are not independent; empty without one."""
    if _recordings(one) & _recordings(other):
        return (
            "Both come from the same data, so that their errors are not independent and the sum "
            "of their covariances is not that of the difference."
        )
    if _lineage(one) & _lineage(other):
        return (
            "They have recordings in common by their priors, so that their errors are not "
            "independent and the sum of their covariances is not that of the difference."
        )
    if one.folder.has("experiment") and other.folder.has("experiment"):
        first, second = (each.folder.result(Truth).seeds for each in (one, other))
        if first.repetitions == second.repetitions:
            return (
                "Both experiments were simulated with the same seed, so that their noise may be "
                "the same; simulate one of them with another experiment.seed."
            )
    return ""


def _recordings(each: ComparedEstimate) -> set[str]:
    """Return hashes of the recordings of an estimate; their names where the files are missing."""
    found = {one.fingerprint for one in each.result.recordings if one.fingerprint}
    for recording in each.result.recordings:
        source = Path(recording.source)
        own = each.folder.path / source.name
        file = source if source.is_file() else own
        found.add(file_hash(file) if file.is_file() else str(source))
    return found


def _lineage(each: ComparedEstimate) -> set[str]:
    own = {one.fingerprint for one in each.result.recordings if one.fingerprint}
    return own.union(each.result.prior_recordings)


def _sentence(title: str, test: Differences) -> str:
    which = int(np.sum(test.differs))
    outcome = "differ" if test.differ_jointly or which else "agree"
    return (
        f"{title}: the estimates {outcome} (jointly χ² = {test.statistic:.4g} with "
        f"{test.freedom:.3g} degrees of freedom, p = {test.p_joint:.2g}; {which} of "
        f"{test.difference.size} parameters differ individually)."
    )


def _values_table(found: tuple[ComparedEstimate, ...], names: tuple[str, ...]) -> view.ReportTable:
    units = [parameter_unit(name) for name in names]
    columns = [
        view.TableColumn("parameter", kind="parameter", of=names),
        view.TableColumn("unit", kind="text", of=units),
    ]
    for each in found:
        estimator = each.result.best.upper()
        values, std = each.of(names)
        half = _TWO_SIDED * std
        columns += [
            view.TableColumn(f"{each.label}, {estimator}", digits=5, of=values),
            view.TableColumn("from", digits=5, of=values - half),
            view.TableColumn("to", digits=5, of=values + half),
        ]
    caption = "Best estimate of every folder with its 95 % interval, SI units"
    return view.ReportTable.of("compared_estimates", caption, columns, screen=True)


def _derived_tables(found: tuple[ComparedEstimate, ...]) -> list[view.Block]:
    tables = {
        each.label: {row.quantity: row for row in each.result.best_estimator.derived}
        for each in found
    }
    first, *others = tables.values()
    names = [name for name in first if all(name in rows for rows in others)]
    columns = [
        view.TableColumn("quantity", kind="text", of=names),
        view.TableColumn("unit", kind="text", of=[first[name].unit for name in names]),
    ]
    for label, rows in tables.items():
        columns += [
            view.TableColumn(label, digits=5, of=[rows[name].value for name in names]),
            view.TableColumn("σ", kind="error", digits=3, of=[rows[name].std for name in names]),
        ]
    caption = "Derived quantities of the best estimate of every folder, SI units"
    return [view.ReportTable.of("compared_estimate_derived", caption, columns)] if names else []
