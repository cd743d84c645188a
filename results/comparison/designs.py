"""Comparison of designs: criteria, precision, effort, limits and their costs.

The information F of a motion depends on joints, first cardan axes, threads, gravity, the model with
its constants, and the noise of the forces. Machines that differ in one of them differ in det F for
the same design, so that only designs for the same machine have an efficiency. Values of the
parameters, limits, home and names do not distinguish machines. Earlier recordings (`design.prior`)
add information that is not the motion's, and a motion may have been designed together with others
(`design.others`): designs that differ in these have no efficiency either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.design import DesignSection, TaskSection
from expdesign.experiment import DesignResult
from expdesign.experiment.judging import count_experiment_samples, noise_evaluator
from expdesign.experiment.plan import Prediction
from expdesign.experiment.precision import experiment_information, predicted_errors
from expdesign.experiment.sensitivity import limit_sensitivity
from expdesign.information.criteria import criteria
from expdesign.information.fisher import SingularInformationError, log_det, parameter_covariance
from expdesign.information.identifiable import IDENTIFIABLE, listed
from expdesign.progress import track
from expdesign.robot.derived import ErrorShares
from results.figures.parameters import ParameterSeries, compared_precision_figure
from results.notation import count_text, duration, percent
from results.views.design import costliest_fact, gains_table
from results.views.folder import RunFolder
from results.views.parameter_blocks import symbols_blocks
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    Value,
)

_COUNTED = "joints, first cardan axes, gravity and noise of the forces"
"""Properties of a machine, in words, where the parameters are the same."""
_SAME = 1e-9
"""Difference, relative to the largest number of the kind, up to which machines are the same."""


def compare_designs(
    folders: Mapping[str, RunFolder], precision: float, quick: bool = False
) -> StageView:
    """Return the comparison of the designs of folders; a quick one without the costs of limits."""
    designs = tuple(
        ComparedDesign(
            label,
            folder.result(DesignResult),
            bool(folder.changes.of("design")),
        )
        for label, folder in folders.items()
    )
    comparison = DesignComparison(designs, precision)
    blocks: list[Block] = []
    facts: list[Fact] = []
    sentence = f"{count_text(len(designs), 'design')}."
    if comparison.comparable:
        blocks += [
            _criteria_table(comparison),
            Drawing(compared_precision_figure, comparison.precision_series),
            _effort_table(comparison),
            *_derived_tables(designs),
            _precision_table(comparison),
            *symbols_blocks(designs[0].names, screen=True),
        ]
        text, best = _best_in_words(comparison)
        sentence += text
        facts += best
    blocks.append(_limits_table(designs))
    if not quick:
        costs = {
            design.label: limit_sensitivity(design.result.configuration, design.result.trajectory)
            for design in track("cost of each limit", designs)
        }
        blocks.append(gains_table(costs, "the optimum next to the design"))
        sound = (design.label for design in designs if not design.changed)
        found = (costliest_fact(costs[label], f"{label}: ") for label in sound)
        facts += [fact for fact in found if fact is not None]
        if not all(each.explained for each in costs.values()):
            text = (
                "Where the limits leave more than 10 % of the cost's gradient unexplained, the "
                "design is not near an optimum, and the costs of its limits are not shown."
            )
            blocks.append(TextBlock(text, Level.CAUTION))
    # No column of a table: tables are the same bytes whenever the same seeds were used.
    seconds = {d.label: d.result.solver.seconds for d in designs if not d.changed}
    each = ", ".join(f"{label}: {duration(value)}" for label, value in seconds.items())
    facts += [Fact("search", duration(sum(seconds.values())), each)] if seconds else []
    verdict = StageVerdict("Designs", Level.NEUTRAL, "compared", sentence, "designs")
    return StageView(verdict, tuple(blocks), tuple(facts), tuple(_differences(comparison)))


@dataclass(frozen=True, eq=False)
class ComparedDesign:
    """One design and its name in the comparison."""

    label: str
    result: DesignResult
    changed: bool = False
    """Whether its files or inputs were changed by hand: its claims may not hold for them."""

    @property
    def status(self) -> str:
        """Status of the design, or that it was changed."""
        return "changed" if self.changed else self.result.status

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that the design judges."""
        return self.result.parameter_names

    @property
    def section(self) -> DesignSection:
        """Settings of the design."""
        return self.result.configuration.run.design

    @property
    def robot(self) -> ResolvedRobot:
        """Robot of the design."""
        return self.result.configuration.robot

    @property
    def nominal(self) -> Array:
        """Nominal values of the parameters for the design's robot, (m,)."""
        return np.array([parameter.nominal for parameter in self.result.parameters])

    def information(self, samples: float) -> Array:
        """Return F for so many samples, SI, (m, m)."""
        return self.result.information / self.result.samples * samples

    def log_det(self, samples: float) -> float | None:
        """Return log det F for so many samples, SI; None when F is singular."""
        try:
            return log_det(self.information(samples), self.names)
        except SingularInformationError:
            return None

    def relative_std(self, samples: float) -> Array:
        """Return the standard deviations relative to the own nominal values, (m,); NaN for none.

        Noise alone falls with the square root of the samples from the design's own experiment,
        which `tables/parameters.csv` states. A prior is the same for any number of samples.
        """
        if self.section.is_change:
            std = self._std_of_change(samples)
        elif not self._by_noise_alone:
            prediction = self._prediction
            std = prediction.errors(samples / prediction.samples).std[-len(self.names) :]
        else:
            own = np.array([parameter.std for parameter in self.result.parameters])
            std = own * np.sqrt(self.result.predicted_std.experiment.samples / samples)
        return np.asarray(std / self._sizes, dtype=np.float64)

    def periods(self, precision: float, sampling: float) -> Array:
        """Return the periods that each parameter needs for a relative σ, (m,); inf: no number.

        With a prior they are further periods, NaN for the change since a prior.
        """
        if self.section.is_change:
            return np.full(len(self.names), np.nan)
        if self._by_noise_alone:
            one = self.relative_std(self.result.trajectory.period * sampling)
            return np.maximum(np.ceil((one / precision) ** 2 - 1e-9), 1.0)
        found, first = np.full(len(self.names), np.nan), -len(self.names)
        for place, size in enumerate(self._sizes.tolist()):
            if np.isfinite(size):
                ratio = partial(_ratio, place=first + place, wanted=precision * size)
                own = self._prediction.fewest_periods(ratio)
                found[place] = own if np.isfinite(own) else np.inf
        own_sampling = self.result.configuration.run.experiment.sampling
        return np.ceil(found * own_sampling / sampling - 1e-9)

    @property
    def objective(self) -> tuple[Any, ...]:
        """Criterion with the quantities that it judges, and whether it counts the tolerances."""
        section = self.section
        scaling = "" if section.criterion == "d" else section.scaling
        total = bool(self.result.systematic) and section.counts == "total"
        return section.criterion, scaling, section.interest, total

    def interest_std(
        self,
        interest: Sequence[str] | None,
        samples: float,
        reference: ComparedDesign,
        *,
        scaled: bool,
    ) -> Array:
        """Return the standard deviations of quantities of interest; None: of all parameters.

        They are in SI, or relative to the scales of `design.scaling: nominal`. Tolerances,
        estimator and prior are those of the reference.
        """
        if self.section.is_change:
            return self.relative_std(samples)
        prediction = Prediction.of(reference.result.configuration, self.result.trajectory)
        std = prediction.errors(samples / prediction.samples).std
        if scaled:
            evaluator = prediction.evaluator
            scales = evaluator.robot.scales[evaluator.columns]
            std = std / np.linalg.norm(prediction.rows * scales, axis=1)
        wanted = {*(self.names if interest is None else interest)}
        pairs = zip(prediction.groups, prediction.names, strict=True)
        return std[[bool({*pair} & wanted) for pair in pairs]]

    @property
    def _by_noise_alone(self) -> bool:
        return not self.result.systematic and self.section.prior is None

    @cached_property
    def _prediction(self) -> Prediction:
        """Errors for any number of periods."""
        return Prediction.of(self.result.configuration, self.result.trajectory)

    def _std_of_change(self, samples: float) -> Array:
        """Return the standard deviations of the change since a prior, (m,), SI."""
        configuration, motion = self.result.configuration, self.result.trajectory
        periods = samples / (motion.period * configuration.run.experiment.sampling)
        configuration = configuration.with_section("experiment", periods=periods)
        evaluator = noise_evaluator(configuration)
        information, total = experiment_information(evaluator, motion, configuration)
        return predicted_errors(configuration, evaluator, motion, information, total).std

    @property
    def _sizes(self) -> Array:
        return np.where(self.nominal == 0, np.nan, np.abs(self.nominal))


def _ratio(errors: ErrorShares, place: int, wanted: float) -> float:
    return float(errors.std[place]) / wanted


@dataclass(frozen=True, eq=False)
class DesignComparison:
    """Designs, at least one, on the basis of the first; precision: the relative σ wanted."""

    designs: tuple[ComparedDesign, ...]
    precision: float

    @property
    def comparable(self) -> bool:
        """Whether all designs judge the same parameters."""
        return all(design.names == self.designs[0].names for design in self.designs)

    @property
    def samples(self) -> int:
        """Number of samples of the criteria: those of the first design's period."""
        return self.designs[0].result.samples

    @property
    def sampling(self) -> float:
        """Sampling rate of the common experiment, Hz."""
        return float(self.designs[0].result.configuration.run.experiment.sampling)

    @property
    def experiment_samples(self) -> int:
        """Samples of the common experiment: the first design's."""
        return self.designs[0].result.predicted_std.experiment.samples

    @property
    def same_nominal(self) -> bool:
        """Whether all robots have the same nominal values."""
        first = self.designs[0].nominal
        return all(np.array_equal(design.nominal, first) for design in self.designs)

    @property
    def whose(self) -> str:
        """Basis of relative standard deviations, in words."""
        return "the nominal value" if self.same_nominal else "its own robot's nominal value"

    @property
    def information(self) -> str:
        """Symbol of the compared information: F, or S of designs with a prior."""
        symbols = sorted({design.section.information for design in self.designs})
        return symbols[0] if len(symbols) == 1 else f"({' or '.join(symbols)})"

    @cached_property
    def machine_count(self) -> int:
        """Number of different machines."""
        found: list[ResolvedRobot] = []
        for design in self.designs:
            if all(_robot_differences(one, design.robot) for one in found):
                found.append(design.robot)
        return len(found)

    @cached_property
    def groups(self) -> tuple[tuple[ComparedDesign, ...], ...]:
        """The designs by machine, prior and other motions, in their order."""
        found: list[list[ComparedDesign]] = []
        for design in self.designs:
            for group in found:
                differ = _robot_differences(group[0].robot, design.robot)
                if not (differ or _recording_differences(group[0], design)):
                    group.append(design)
                    break
            else:
                found.append([design])
        return tuple(map(tuple, found))

    @cached_property
    def efficiencies(self) -> dict[str, float | None]:
        """D-efficiency of each design relative to the best of its group.

        None where F is singular, for a changed design, and for the only other one of a group
        among several designs.
        """
        count = len(self.designs[0].names)
        found: dict[str, float | None] = {}
        for designs in self.groups:
            values = {
                design.label: None if design.changed else design.log_det(self.samples)
                for design in designs
            }
            best = max((value for value in values.values() if value is not None), default=0.0)
            alone = sum(not design.changed for design in designs) == 1 < len(self.designs)
            for label, value in values.items():
                found[label] = None
                if value is not None and not alone:
                    found[label] = float(np.exp((value - best) / count))
        return {design.label: found[design.label] for design in self.designs}

    @cached_property
    def periods(self) -> dict[str, Array]:
        """Periods that each parameter needs for the precision wanted, (m,), by design."""
        return {
            design.label: design.periods(self.precision, self.sampling) for design in self.designs
        }

    @property
    def precision_series(self) -> ParameterSeries:
        """Predicted standard deviations of the common experiment, %."""
        samples = self.experiment_samples
        percents = {d.label: 100 * d.relative_std(samples) for d in self.designs}
        return ParameterSeries(self.designs[0].names, percents)


def _differences(comparison: DesignComparison) -> list[str]:
    first, found = comparison.designs[0], []
    if not comparison.comparable:
        found.append(
            "The designs judge different parameters: their criteria cannot be compared, and "
            "are left out"
        )
    for design in comparison.designs[1:]:
        own, other = design.robot.name, first.robot.name
        names = f" ({own}; {first.label}: {other})" if own != other else ""
        if reasons := _robot_differences(first.robot, design.robot):
            found.append(
                f"{design.label} was designed for another robot than {first.label}{names}: "
                f"other {', '.join(reasons)}. Their information differs by the machine and "
                "not only by the design: no efficiency is stated between them"
            )
        elif reasons := _recording_differences(first, design):
            found.append(
                f"{design.label} differs from {first.label} in {' and '.join(reasons)}: no "
                "efficiency is stated between them"
            )
        elif names:
            found.append(
                f"{design.label} was designed for a robot of another name than "
                f"{first.label}{names}, in what counts the same"
            )
        if comparison.comparable and not np.array_equal(design.nominal, first.nominal):
            found.append(
                f"{design.label} has other nominal values than {first.label}: its precision "
                "is relative to its own"
            )
    for design in comparison.designs:
        if design.section.prior is not None:
            found.append(
                f"The information and the precision of {design.label} include its prior "
                "(design.prior), however long the experiment is; its periods are further ones"
            )
        if design.section.others:
            found.append(
                f"{design.label} was designed together with other motions (design.others): its "
                "numbers are those of its own motion"
            )
    return found


def _recording_differences(one: ComparedDesign, other: ComparedDesign) -> list[str]:
    """Return the differences in the further recordings of two designs, in words."""
    found = list[str]()
    weights = [count_experiment_samples(each.result.configuration) for each in (one, other)]
    if one.section.priors != other.section.priors:
        found.append("its earlier recordings (design.prior)")
    elif one.section.priors and weights[0] != weights[1]:
        found.append("its measuring time, and so in the weight of design.prior")
    if one.section.others or other.section.others:
        found.append("the other motions of its experiment (design.others)")
    return found


def _robot_differences(one: ResolvedRobot, other: ResolvedRobot) -> list[str]:
    """Return the differences that make two robots different machines, in words."""
    noises = [robot.noise for robot in (one, other)]
    covariances = [None if noise is None else noise.force_covariance for noise in noises]
    spectra = [
        None
        if noise is None or noise.force_spectrum is None or stated is None
        else stated.force_spectrum
        for noise, stated in zip(
            noises, [robot.description.noise for robot in (one, other)], strict=True
        )
    ]
    pairs: tuple[tuple[str, Array | None, Array | None], ...] = (
        ("joints of the base", one.base_joints, other.base_joints),
        ("joints of the platform", one.platform_joints, other.platform_joints),
        ("first cardan axes", one.alpha_axes, other.alpha_axes),
        ("gravity", one.gravity, other.gravity),
        ("noise of the forces", covariances[0], covariances[1]),
    )
    found = [words for words, first, second in pairs if not _same(first, second)]
    found += ["spectrum of the force noise"] if spectra[0] != spectra[1] else []
    if one.terms != other.terms:
        return [*found, "terms of the model"]
    pairs = (
        ("constants of the terms", np.array(one.constants), np.array(other.constants)),
        ("threads of the struts", _threads(one), _threads(other)),
    )
    return found + [words for words, first, second in pairs if not _same(first, second)]


def _threads(robot: ResolvedRobot) -> Array | None:
    """Return lead and axes of struts that move on their threads; None without."""
    if robot.platform_cardan_axes is None:
        return None
    return np.append(robot.platform_cardan_axes, robot.thread_lead)


def _same(first: Array | None, second: Array | None) -> bool:
    if first is None or second is None:
        return first is second
    largest = float(np.max(np.abs(first), initial=0.0))
    return bool(np.allclose(first, second, rtol=0, atol=_SAME * largest))


def _best_in_words(comparison: DesignComparison) -> tuple[str, list[Fact]]:
    """Return the best design of each machine and how much worse the others are.

    Designs for the information of a motion are compared by it, all others by the standard
    deviations that they predict.
    """
    several = len(comparison.groups) > 1
    text, facts = "", []
    for designs in comparison.groups:
        known = [each for each in designs if comparison.efficiencies[each.label] is not None]
        if not known:
            continue
        among = f" of {listed([each.label for each in known])}" if several else ""
        if {each.objective for each in known} == {("d", "", None, False)}:
            found = [_most_informative(comparison, known, among)]
        else:
            objectives = dict.fromkeys(each.objective[:3] for each in known)
            found = [_most_precise(comparison, known, each, among) for each in objectives]
        text += "".join(sentence for sentence, _ in found)
        facts += [fact for _, fact in found]
    if comparison.machine_count > 1:
        text += (
            f" They are for {comparison.machine_count} different robots ({_COUNTED}), between "
            "which there is no efficiency; precision is relative to each one's own nominal values."
        )
    elif several:
        text += (
            " They differ in their priors or in further motions, and between those that do there "
            "is no efficiency."
        )
    return text, facts


def _most_informative(
    comparison: DesignComparison, designs: Sequence[ComparedDesign], among: str
) -> tuple[str, Fact]:
    """Return the design with the most information and the others' efficiencies."""
    log_det = criteria()["d"].named(comparison.information)
    shares = {each.label: comparison.efficiencies[each.label] or 0.0 for each in designs}
    best = max(shares, key=lambda label: shares[label])
    others = ", ".join(
        f"{label} has {percent(value)} of its information per parameter"
        for label, value in shares.items()
        if label != best
    )
    sentence = f" {best} has the largest {log_det}{among}{f'; {others}' if others else ''}."
    return sentence, Fact(f"largest {log_det}", best, f"for {comparison.samples} samples")


def _most_precise(
    comparison: DesignComparison,
    designs: Sequence[ComparedDesign],
    objective: tuple[str, str, Sequence[str] | TaskSection | None],
    among: str,
) -> tuple[str, Fact]:
    """Return the design with the smallest predicted standard deviations and those of the others.

    The objective is a criterion, its scaling and the quantities of interest. The standard
    deviations are summarised as in `plan`: rms (criterion a), the largest (e), or geometric mean.
    """
    criterion, scaling, interest = objective
    samples = comparison.experiment_samples
    name, summarise = _SUMMARIES.get(criterion, _GEOMETRIC)
    if isinstance(interest, TaskSection):
        whose, interest = "all parameters, not of the forces along the task", None
        name, summarise = _GEOMETRIC
    else:
        whose = listed(interest or ["all parameters"])
    reference = next((each for each in designs if each.objective[-1]), designs[0])
    if any(each.robot.tolerances != reference.robot.tolerances for each in designs):
        whose += f" with the tolerances of {reference.label}"
    scaled = scaling == "nominal"
    stds = np.array(
        [each.interest_std(interest, samples, reference, scaled=scaled) for each in designs]
    )
    means = summarise(stds[:, np.all(stds > 0, axis=0)])
    best = int(np.argmin(means))
    others = ", ".join(
        f"{each.label} has {percent(mean / means[best])} of them"
        for each, mean in zip(designs, means, strict=True)
        if each is not designs[best]
    )
    title = f"smallest predicted σ of {whose}"
    if name != _GEOMETRIC[0]:
        title += f" ({name})"
    sentence = f" {designs[best].label} has the {title}{among}{f'; {others}' if others else ''}."
    note = f"{name} for {samples} samples"
    return sentence, Fact(title, designs[best].label, note)


_Summary = tuple[str, Callable[[Array], Array]]
_GEOMETRIC: _Summary = ("geometric mean", lambda stds: np.exp(np.mean(np.log(stds), axis=1)))
_SUMMARIES: dict[str, _Summary] = {
    "a": ("rms", lambda stds: np.sqrt(np.mean(stds**2, axis=1))),
    "e": ("largest", lambda stds: np.max(stds, axis=1)),
}
"""Name and function, (designs, n) → (designs,), of the summary by criterion."""


def _criteria_table(comparison: DesignComparison) -> ReportTable:
    designs, samples, shares = comparison.designs, comparison.samples, comparison.efficiencies
    log_det = criteria()["d"].named(comparison.information)
    columns = [
        TableColumn("design", kind="text", of=list(shares)),
        TableColumn(log_det, digits=6, of=[design.log_det(samples) for design in designs]),
        TableColumn("D-efficiency", "%", factor=100, of=list(shares.values())),
    ]
    for name, scaled in (("SI", False), ("nominal", True)):
        spectra = [_spectrum(design, samples, scaled=scaled) for design in designs]
        trace, smallest, condition = zip(*spectra, strict=True)
        columns += [
            TableColumn(f"trace {comparison.information}⁻¹, {name}", of=trace),
            TableColumn(f"smallest eigenvalue, {name}", of=smallest),
            TableColumn(f"condition, {name}", of=condition),
        ]
    best = "the best"
    if comparison.machine_count > 1:
        best += (
            f" of the same robot ({_COUNTED}), empty where no other design is of it: the "
            "information of different robots differs by the machine and not only by the design"
        )
    elif len(comparison.groups) > 1:
        best += " with the same prior and no other motions, empty where there is no such design"
    caption = (
        f"Criteria of every design for {samples} samples, in SI units and in units of "
        f"{comparison.whose}; D-efficiency relative to {best}"
    )
    return ReportTable.of("criteria", caption, columns)


def _spectrum(design: ComparedDesign, samples: float, *, scaled: bool) -> tuple[float | None, ...]:
    """Return trace of F⁻¹, smallest eigenvalue and condition number, in SI or nominal scaling."""
    information, robot = design.information(samples), design.result.robot
    try:
        covariance = parameter_covariance(information, design.names)
    except SingularInformationError:
        return None, None, None
    places = [robot.parameter_names.index(name) for name in design.names]
    scale = robot.scales[places] if scaled else np.ones(len(places))
    outer = np.multiply.outer(scale, scale)
    inverse = covariance / outer
    # The small eigenvalues come from the inverse, where they keep their digits.
    smallest = 1 / float(np.linalg.eigvalsh(inverse)[-1])
    largest = float(np.linalg.eigvalsh(information * outer)[-1])
    return float(np.trace(inverse)), smallest, largest / smallest


def _precision_table(comparison: DesignComparison) -> ReportTable:
    designs = comparison.designs
    columns = [TableColumn("parameter", kind="parameter", of=designs[0].names)]
    if comparison.same_nominal:
        columns.append(TableColumn("nominal", of=designs[0].nominal))
    else:
        columns += [TableColumn(f"nominal, {each.label}", of=each.nominal) for each in designs]
    columns += [
        TableColumn(f"σ, {label}", "%", digits=3, of=percents)
        for label, percents in comparison.precision_series.values.items()
    ]
    columns += [TableColumn(f"periods, {label}", of=n) for label, n in comparison.periods.items()]
    caption = (
        f"Predicted standard deviations for {comparison.experiment_samples} samples at "
        f"{comparison.sampling:g} Hz whatever the period, in percent of "
        f"{comparison.whose}, and the periods that each design needs for "
        f"{100 * comparison.precision:g} %, as by `expdesign plan`"
    )
    if any(design.section.prior is not None for design in designs):
        caption += "; a prior counts entirely, and periods are further ones"
    return ReportTable.of("compared_parameters", caption, columns, screen=True)


def _derived_tables(designs: tuple[ComparedDesign, ...]) -> list[Block]:
    by_label = {each.label: {row.quantity: row for row in each.result.derived} for each in designs}
    first = {name: row for rows in by_label.values() for name, row in rows.items()}
    columns = [
        TableColumn("quantity", kind="text", of=lambda name: name),
        TableColumn("unit", kind="text", of=lambda name: first[name].unit),
    ]
    for label, rows in by_label.items():
        std = {name: row.std for name, row in rows.items()}
        columns.append(TableColumn(f"σ, {label}", digits=3, of=std.get))
    caption = "Predicted standard deviations of derived quantities, each for its own experiment, SI"
    table = ReportTable.of("compared_design_derived", caption, columns, list(first), screen=True)
    return [table] if first else []


def _effort_table(comparison: DesignComparison) -> ReportTable:
    designs, samples = comparison.designs, comparison.experiment_samples
    shares = [design.relative_std(samples) for design in designs]
    hopeless: Mask = np.all([~(share <= IDENTIFIABLE) for share in shares], axis=0)
    results = [design.result for design in designs]
    efforts = [
        _effort(design, np.where(hopeless, np.nan, comparison.periods[design.label]))
        for design in designs
    ]
    median, most, decisive, time = zip(*efforts, strict=True)
    columns = (
        TableColumn("design", kind="text", of=[design.label for design in designs]),
        TableColumn("status", kind="outcome", of=[design.status for design in designs]),
        TableColumn("criterion", kind="text", of=[result.criterion for result in results]),
        TableColumn("harmonics", of=[result.harmonics for result in results]),
        TableColumn("period", "s", of=[result.trajectory.period for result in results]),
        TableColumn("periods, median parameter", of=median),
        TableColumn("periods, all parameters", of=most),
        TableColumn("decided by", kind="parameter", of=decisive),
        TableColumn("measuring", "s", of=time),
    )
    caption = (
        f"Periods and time that each design needs for σ = {100 * comparison.precision:g} % of "
        f"{comparison.whose}, measured at {comparison.sampling:g} Hz"
    )
    if np.any(hopeless):
        left_out = ", ".join(np.array(designs[0].names)[hopeless])
        caption += (
            f"; without {left_out}, which no design identifies in its experiment: fix it, or give "
            "a prior"
        )
    return ReportTable.of("effort", caption, columns)


def _effort(design: ComparedDesign, periods: Array) -> tuple[Value, Value, str, Value]:
    """Return median and largest number of periods, the parameter that decides, and the time, s."""
    if not np.any(np.isfinite(periods)):
        return None, None, "–", None
    worst = int(np.nanargmax(periods))
    most = float(periods[worst])
    time = most * design.result.trajectory.period
    return float(np.nanmedian(periods)), most, design.names[worst], time


def _limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    checks = {design.label: design.result.checks for design in designs}
    titles = {check.key: check.title for own in checks.values() for check in own}
    columns = [TableColumn("limit", kind="text", of=titles.get)]
    for design in designs:
        used = {check.key: check.used for check in design.result.checks if not design.changed}
        columns.append(TableColumn(design.label, "%", of=used.get, factor=100))
    return ReportTable.of("compared_limits", "Used share of every limit", columns, titles)
