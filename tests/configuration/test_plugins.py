"""A plug-in adds a limit, a criterion, a term, a format of tables, a reader and a stage."""

import subprocess
import sys
import textwrap

import pytest

from constraints.plugins import GROUP

MODULE = '''
    """Every kind of extension in one module."""

    from dataclasses import replace
    from typing import Annotated

    import casadi as ca
    import numpy as np

    from constraints import plain_limit
    from estimation.data.readers import delimited
    from expdesign.configuration import StageSection
    from expdesign.configuration.quantity import Length, Positive
    from expdesign.configuration.export import ExportSection
    from expdesign.export.formats import csv
    from expdesign.information.criteria import Criterion
    from expdesign.mechanism.term import Columns, Parameter, Term

    LIMIT = plain_limit("sway", "sway of the TCP", "m", "upper")
    CRITERION = Criterion(
        key="phi2",
        title="tr F^-2",
        larger_is_better=False,
        levels=(2.0,),
        value=lambda eigenvalues: float(np.sum(eigenvalues**-2.0)),
        cost=lambda logs, level: (float(np.sum(np.exp(-2 * logs))), logs, np.diag(logs)),
        from_cost=lambda cost, *_: cost,
    )
    TERM = Term(
        name="drag",
        meaning="constant drag of the platform",
        parameters=(Parameter("drag", "N", "drag", default=0.0),),
        columns=lambda _: Columns(along=ca.SX.ones(6, 1)),
    )


    class PlainOptions(ExportSection):
        """Options of a plain table."""

        spaces = ("strut",)
        shared = ("digits",)
        width: Annotated[Length, Positive] | None = None


    FORMAT = replace(csv.FORMAT, name="plain", options=PlainOptions)
    FORMATS = (replace(delimited.FORMATS[0], title="plain", extensions=(".plain",)),)


    class Warmup(StageSection):
        """A stage."""

        key = "warmup"
        distance: Annotated[Length, Positive] = 0.1
'''

USE = """
    from expdesign.configuration import InputError, load_run, resolved_yaml
    from expdesign.configuration.run import stage_keys
    from estimation.data.reading import file_formats

    def problem(**given):
        try:
            load_run({"name": "n", "robot": "palida"} | given)
        except InputError as error:
            (found,) = error.problems
            return found

    run = load_run(
        {
            "name": "n",
            "robot": "palida",
            "design": {"criterion": "phi2"},
            "export": [{"format": "plain", "width": "2 mm", "digits": 3}],
            "estimate": {"select": {"candidates": ["drag"]}},
            "warmup": {"distance": "20 mm"},
            "report": {},
        }
    ).run
    assert run.stages == ("design", "estimate", "export", "warmup", "report"), run.stages
    assert stage_keys()[-2:] == ("warmup", "report")
    assert run.section("warmup").distance == 0.02
    assert run.export[0].width == 0.002
    assert run.estimate.select.candidates[0].definition.parameters[0].name == "drag"
    assert load_run(run).run == run
    assert "distance: 0.02" in resolved_yaml(load_run(run))
    assert "sway" in problem(limits={"sway": -1}).key
    assert problem(export=[{"format": "plain", "widht": 1}]).nearest == "width"
    assert problem(warmup={"distance": 0}).key == "warmup.distance"
    assert problem(design={"criterion": "phi"}).nearest == "phi2"
    assert "plain" in [form.title for form in file_formats()]
"""


@pytest.mark.slow
def test_extensions_from_outside_the_packages(tmp_path, monkeypatch):
    (tmp_path / "outside.py").write_text(textwrap.dedent(MODULE), encoding="utf-8")
    about = tmp_path / "outside-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: outside\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\noutside = outside\n")
    path = [str(tmp_path), *sys.path]
    command = [sys.executable, "-c", f"import sys; sys.path[:0] = {path}\n{textwrap.dedent(USE)}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
