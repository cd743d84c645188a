"""The reference tables of the docs agree with the code."""

import ast
import itertools
import re
from fnmatch import fnmatch

import numpy as np
import pytest
from pydantic_core import PydanticUndefined
from typer.main import get_command

from constraints import limit_definitions
from estimation.data.reading import file_formats
from estimation.twin.truth import MEASUREMENT
from expdesign.cli.app import app
from expdesign.configuration import DataSection, ExportSection, RunDescription
from expdesign.configuration.bodies import BodyDescription
from expdesign.configuration.design import (
    MOST_DESIGNS,
    DesignSection,
    MotionSection,
    TrajectorySection,
    path_units,
)
from expdesign.configuration.estimate import (
    EstimateSection,
    MonteCarloSection,
    SelectSection,
)
from expdesign.configuration.experiment import (
    Cogging,
    ExperimentSection,
    FeedforwardSection,
    ForceConstantError,
    HumDisturbance,
    Lost,
    Outliers,
    Quantisation,
    TrackingError,
    ValidationMotion,
)
from expdesign.configuration.export import export_formats
from expdesign.configuration.geometry import JointRing
from expdesign.configuration.limits import CHARACTERISTIC_LENGTH
from expdesign.configuration.parameters import Screw
from expdesign.configuration.quantity import quantity_of_unit, unit_symbols
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.run import ReportSettings
from expdesign.export.formats import table_formats
from expdesign.information.criteria import criteria
from expdesign.library import robot_files, run_files
from expdesign.mechanism.graph import HexapodGraph
from expdesign.mechanism.term import (
    ALPHA_RATE,
    BETA_RATE,
    PLATFORM_RATE,
    STRUT_SPEED,
    parameters_of,
)
from expdesign.mechanism.terms import DEFAULT, term_definitions, terms_named
from expdesign.recheck.limit_check import TOLERANCE, grid_points
from expdesign.robot import load_robot
from expdesign.robot.derived import ALONE, derived_quantities
from expdesign.runfolder.documentation import all_results, documented_page
from expdesign.stages.registry import stages
from results.figures.design import DESIGN_FIGURES
from results.figures.studies import STUDY_FIGURES
from tests.docs.pages import ROOT, codes, parse, table

DOCS = ROOT / "docs"
RUN_FILES, ROBOTS, LIMITS = DOCS / "run-files.md", DOCS / "robots.md", DOCS / "limits.md"
RUN_FOLDER, DATA = DOCS / "run-folder.md", DOCS / "data.md"
VIEWS, COMPARISONS = ROOT / "results" / "views", ROOT / "results" / "comparison"
TABLES_PAGE = DOCS / "controller-tables.md"


def _fields(model):
    """Return the keys of a section; those of all formats for the options of tables."""
    models = [*export_formats().values(), model] if model is ExportSection else [model]
    return {info.alias or name: info for one in models for name, info in one.model_fields.items()}


def _documented(page, heading):
    """Return key → cell of the default, of every key of a table."""
    return {key: row[1] for row in table(page, heading) for key in codes(row[0])}


def _required(model):
    """Return values of the required keys of a section."""
    if model is RunDescription:
        return {"name": "n", "robot": "palida"}
    if model is RobotDescription:
        return {
            "name": "n",
            "home": [0, 0, 1, 0, 0, 0],
            "base_joints": [[j, 0, 0] for j in range(6)],
            "platform_joints": [[j, 1, 0] for j in range(6)],
            "parameters": {
                parameter.name: 1
                for parameter in parameters_of(terms_named(DEFAULT, general=False))
            },
        }
    small = {
        Cogging: {"amplitude": 12, "pitch": 0.03},
        ValidationMotion: {"motion": "circle"},
        ExportSection: {"format": "csv"},
        JointRing: {"radius": 0.3, "half_angle": 0.1, "pairs": "1-2"},
        BodyDescription: {"mass": 1},
        Screw: {"lead": 0.005},
        Outliers: {"share": 0.1},
        HumDisturbance: {"amplitude": 5},
        Lost: {"share": 0.1},
        SelectSection: {"candidates": ["force_offset"]},
    }
    return small.get(model, {})


@pytest.mark.parametrize(
    ("model", "page", "heading"),
    [
        (RunDescription, RUN_FILES, "## Top level"),
        (TrajectorySection, RUN_FILES, "## trajectory"),
        (DesignSection, RUN_FILES, "## design"),
        (MotionSection, RUN_FILES, "## motion"),
        (ExperimentSection, RUN_FILES, "## experiment"),
        (TrackingError, RUN_FILES, "### tracking_error"),
        (Cogging, RUN_FILES, "### cogging"),
        (Quantisation, RUN_FILES, "### quantisation"),
        (ForceConstantError, RUN_FILES, "### force_constant"),
        (HumDisturbance, RUN_FILES, "### hum"),
        (Lost, RUN_FILES, "### lost"),
        (Outliers, RUN_FILES, "### outliers"),
        (MonteCarloSection, RUN_FILES, "## montecarlo"),
        (RobotDescription, ROBOTS, "## Robot file"),
        (JointRing, ROBOTS, "### Joints on a circle"),
        (BodyDescription, ROBOTS, "### Bodies"),
        (Screw, ROBOTS, "### Drives"),
        (EstimateSection, RUN_FILES, "## estimate"),
        (SelectSection, RUN_FILES, "### select"),
        (ValidationMotion, RUN_FILES, "## validate"),
        (FeedforwardSection, RUN_FILES, "## feedforward"),
        (DataSection, DATA, "## data"),
        (ExportSection, TABLES_PAGE, "## Options"),
        (ReportSettings, DOCS / "reports.md", "## report"),
    ],
    ids=lambda value: value if isinstance(value, str) else getattr(value, "__name__", ""),
)
def test_keys_and_defaults_are_the_schemas(model, page, heading):
    documented, fields = _documented(page, heading), _fields(model)
    assert set(documented) == set(fields)
    needed = _required(model)
    for key, cell in documented.items():
        info = fields[key]
        if cell == "required":
            assert info.is_required(), key
            continue
        assert not info.is_required(), key
        if not codes(cell):
            default = info.default if info.default is not PydanticUndefined else {}
            if cell == "none":
                assert default in (None, {}) or key == "limits", key
            continue
        name = next(n for n, i in model.model_fields.items() if i is info)
        given = model.model_validate(needed | {key: parse(codes(cell)[0])})
        assert getattr(given, name) == getattr(model.model_validate(needed), name), key


def _names_on_screen():
    """Yield the names of facts and columns in the sources of views and comparisons."""
    for path in [*VIEWS.glob("*.py"), *COMPARISONS.glob("*.py")]:
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = getattr(call, "func", None)
            name = getattr(name, "id", getattr(name, "attr", ""))
            if name in ("Fact", "TableColumn", "column", "text_columns"):
                for one in call.args if name == "text_columns" else call.args[:1]:
                    yield from (
                        part.value
                        for part in ast.walk(one)
                        if isinstance(part, ast.Constant) and isinstance(part.value, str)
                    )


def _defined(words, terms):
    pattern = rf"(?<!\w){re.escape(words)}(?!\w)"
    return re.search(pattern, terms, re.IGNORECASE) is not None


def test_the_glossary_has_every_name_on_screen():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    terms = "; ".join(re.findall(r"^\| \*\*(.+?)\*\* \|", text, re.MULTILINE))
    names = {name.strip(" ,:⁻¹") for name in _names_on_screen()} - PLAIN
    assert len(names) > 150
    assert sorted(name for name in names if name and not _defined(name, terms)) == []
    names = {*derived_quantities(load_robot("palida")).names, ALONE, "motor_inertia"}
    derived = {re.sub(r"_([xyz]|[xyz]{2}|\d)$", "_", name) for name in names}
    assert sorted(name for name in derived if f"`{name}" not in text and name not in terms) == []
    for criterion in ("log det F", "log det S"):
        assert criterion in terms


PLAIN = {
    *("SHA-256 of the result", "name", "folder", "file", "unit", "column", "row", "rows", "no."),
    *("value", "reason", "outcome", "observation", "assumption", "advice", "of", "from", "to"),
    *("motor", "parameter", "quantity"),
    *("axis", "99.9 % of calls", "call, median", "longest call", "expdesign", "format"),
}
"""Words of headings that need no definition."""


def test_every_limit_has_its_row():
    rows = {codes(row[0])[0]: row for row in table(LIMITS, "# Limits")}
    assert set(rows) == set(limit_definitions())
    for key, definition in limit_definitions().items():
        _, unit, kind, count, _, seen = rows[key]
        assert (unit, kind) == (definition.unit, definition.kind), key
        if definition.components:
            assert count == ", ".join(definition.components), key
        else:
            word = "strut" if definition.per_actuator else "pair" if definition.pairs else ""
            assert count == (f"per {word}" if word else "one"), key
        assert seen.startswith("the same") == (definition.smooth is None), key


def test_the_page_of_limits_is_complete():
    text = LIMITS.read_text(encoding="utf-8")
    assert f"`{CHARACTERISTIC_LENGTH}`" in text
    listed = re.findall(r"``(\w+)``", HexapodGraph.quantities.__doc__)
    assert len(listed) > 10
    for name in listed:
        assert f"`{name}`" in text


@pytest.mark.parametrize("page", ["criteria.md", "formulation.md"])
def test_every_criterion_has_its_row(page):
    heading = "# Criteria" if page == "criteria.md" else "## Objective"
    rows = {codes(row[0])[0]: row for row in table(DOCS / page, heading)}
    assert set(rows) == set(criteria())
    for key, criterion in criteria().items():
        if page == "criteria.md":
            assert rows[key][2] == ("no" if criterion.invariant else "yes")
            levels = "exact"
            if len(criterion.levels) > 1:
                levels = ", ".join(f"{level:g}" for level in criterion.levels)
            assert rows[key][3] == levels
        else:
            assert ("larger is better" in rows[key][1]) == criterion.larger_is_better


def parameter_rows():
    """Return the rows of the table of parameters; those that differ only in the name are one."""
    rows = {}
    for term in term_definitions().values():
        for p in term.parameters:
            bound = "" if p.lower == -np.inf else f"{'>' if p.strict else '≥'} {p.lower:g}"
            bound = bound if p.upper == np.inf else f"≤ {p.upper:g}"
            unit = p.unit.replace("^2", "²").replace("^3", "³")
            rest = f"{unit} | {bound} | {p.scale.text} | `{term.name}` | {p.meaning}"
            rows.setdefault(rest, []).append(f"`{p.name}`")
    return [
        f"{f'{names[0]} … {names[-1]}' if len(names) > 3 else ', '.join(names)} | {rest}"
        for rest, names in rows.items()
    ]


def term_rows():
    rates = {STRUT_SPEED: "$\\dot l$", ALPHA_RATE: "$\\dot\\alpha$", BETA_RATE: "$\\dot\\beta$"}
    rates[PLATFORM_RATE] = "$v$, $\\omega$"
    ends = {
        name: dict.fromkeys((t.parameters[0].name, t.parameters[-1].name))
        for name, t in term_definitions().items()
    }
    return [
        f"`{name}` | {' … '.join(f'`{end}`' for end in ends[name])} | "
        f"{', '.join(rates[rate] for rate in term.rates)} | "
        f"{', '.join(f'`{c.name}` [{c.unit}]' for c in term.constants)} | {term.meaning}"
        for name, term in term_definitions().items()
    ]


def test_the_run_folder_has_a_row_for_every_file_of_a_stage():
    rows = [name for row in table(RUN_FOLDER, "# Run folder") for name in codes(row[0])]
    for stage in stages().values():
        for file in (stage.file, *stage.writes):
            assert any(fnmatch(row, file) or fnmatch(file, f"{row}*") for row in rows), file


def test_the_page_of_commands_has_a_row_for_every_command_and_option():
    commands = get_command(app).commands
    listed = table(DOCS / "commands.md", "# Commands")
    rows = {codes(row[0])[0].split()[1]: row[0] for row in listed}
    assert set(rows) == set(commands)
    called = {"experiment": "simulate", "goals": "plan", "feedforward": "run", "sweep": "run"}
    called["motions"] = "design"
    assert {called.get(name, name) for name in stages()} <= set(rows)
    for name, row in rows.items():
        options = {option for parameter in commands[name].params for option in parameter.opts}
        named = set(re.findall(r"--[a-z]+", row))
        assert named <= options, name
        # Options of a table or a machine are in a document of their own, `--json` is in all.
        if name not in ("export", "init"):
            assert {o for o in options if o.startswith("--")} - named <= {"--json", "--help"}, name


def test_every_option_for_a_machine_has_its_row():
    options = {o for parameter in get_command(app).commands["init"].params for o in parameter.opts}
    rows = table(ROBOTS, "## A machine of your own")
    documented = {name for row in rows for name in codes(row[0])}
    assert documented == {o for o in options if o.startswith("--")} - {"--json"}


def test_every_term_has_its_row():
    rows = table(DOCS / "model.md", "### Terms")
    assert [" | ".join(row) for row in rows] == term_rows()


def test_parameters_and_their_units():
    rows = table(DOCS / "model.md", "## Energies and parameters")
    assert [" | ".join(row) for row in rows] == parameter_rows()


def test_robots_and_runs_that_ship():
    rows = table(ROBOTS, "## Robots that ship")
    assert sorted(codes(row[0])[0] for row in rows) == sorted(robot_files())
    text = RUN_FILES.read_text(encoding="utf-8")
    for name in run_files():
        assert f"`{name}`:" in text


def test_columns_of_the_measurement():
    names = []
    for row in table(RUN_FOLDER, "## measurement.csv"):
        if "…" not in row[0]:
            names += codes(row[0])
            continue
        stem = codes(row[0])[0].removesuffix("1")
        names += [f"{stem}{j}" for j in range(1, 7)]
    assert names == [column.name for column in MEASUREMENT.columns]


def test_tables_of_the_run_folder_are_up_to_date():
    page = RUN_FOLDER.read_text(encoding="utf-8")
    assert page == documented_page(page, all_results()), "run `make docs-tables`"
    for kind in all_results():
        assert f"{kind.FILE} -->" in page or f"### {kind.FILE}" in page


def test_formats_of_measured_data():
    rows = {row[0]: row[1:] for row in table(DATA, "# Measured data")}
    assert list(rows) == sorted(rows)
    assert set(rows) == {found.title for found in file_formats()}
    for found in file_formats():
        files, needs = rows[found.title]
        assert tuple(codes(files)) == found.extensions
        wanted = [f"pip install expdesign[{found.extra}]"] if found.extra else []
        assert codes(needs) == wanted


def test_key_paths_of_a_sweep():
    rows = [name for row in table(RUN_FILES, "## sweep") for name in codes(row[0])]
    shapes = {name.replace("KEY", "*").replace("COMPONENT", "*") for name in rows}
    for path in path_units():
        assert any(fnmatch(path, shape) for shape in shapes), path
    text = RUN_FILES.read_text(encoding="utf-8")
    assert f"combination, {MOST_DESIGNS} at most" in text.replace("\n", " ")


def test_figures_of_the_study():
    rows = [codes(row[0])[0] for row in table(RUN_FOLDER, "### Figures of the study")]
    assert rows == [definition.key for definition in STUDY_FIGURES]


def test_formats_of_controller_tables():
    words = {"LINEAR": "straight", "CUBIC": "cubic Hermite", "QUINTIC": "quintic Hermite"}
    rows = {codes(row[0])[0]: row[2:] for row in table(TABLES_PAGE, "# Controller tables")}
    assert list(rows) == sorted(table_formats())
    for name, form in table_formats().items():
        spaces, steps, between = rows[name]
        assert tuple(codes(spaces)) == export_formats()[name].spaces
        assert steps == ("every `segment`" if form.uniform else "at most `segment` apart")
        assert between == words[form.interpolation.name]


def test_clocks_and_limits_of_controllers():
    rows = {
        codes(row[0])[0]: row[1:4]
        for row in table(TABLES_PAGE, "## The clocks and limits of the controllers")
    }
    facts = {n: [f.clock, f.capacity, f.executed] for n, f in table_formats().items()}
    assert rows == facts


def test_figures():
    rows = [codes(row[0])[0] for row in table(RUN_FOLDER, "## figures")]
    assert rows == [definition.key for definition in DESIGN_FIGURES]


def test_the_grid_of_the_recheck():
    text = (DOCS / "formulation.md").read_text(encoding="utf-8")
    assert r"\max(4000,\,20\cdot\texttt{samples})" in text
    assert [grid_points(samples) for samples in (10, 200, 1000)] == [4000, 4000, 20000]
    assert "10⁻⁶ of its range" in text
    assert TOLERANCE == 1e-6


def test_units():
    rows = {row[0]: codes(row[1]) for row in table(RUN_FILES, "## Units")}
    assert sorted(itertools.chain(*rows.values())) == sorted(unit_symbols())
    for kind, symbols in rows.items():
        for symbol in symbols:
            name = quantity_of_unit(symbol).name.replace("duration", "time")
            assert name.split(maxsplit=1)[1] == kind, symbol
