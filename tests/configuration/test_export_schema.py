"""`export:` in a run file."""

import pkgutil

import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.export import export_section
from expdesign.export import formats
from expdesign.export.formats import table_formats


def run(*export):
    return load_run({"name": "n", "robot": "palida", "export": list(export)})


def test_a_format_has_axes_for_its_spaces():
    for form in table_formats().values():
        assert set(form.axes) == set(form.options.spaces)
        assert set(form.options.own_options()) <= set(form.options.model_fields)
        assert all(len(axes) == 6 for axes in form.axes.values())


def test_every_module_is_a_format():
    written = {module.name for module in pkgutil.iter_modules(formats.__path__)}
    assert written == {name.replace("-", "_") for name in table_formats()}


def test_names_and_sections(tmp_path):
    made = run("csv", {"format": "xps-pvt", "segment": "10 ms", "sign": -1, "offset": "home"})
    first, second = made.run.export
    assert (first.format, first.stem, first.coordinates) == ("csv", "csv", "strut")
    assert (second.segment, second.sign, second.offset) == (0.01, (-1,) * 6, "home")
    file = tmp_path / "again.yaml"
    file.write_text(resolved_yaml(made), encoding="utf-8")
    assert load_run(file).run.export == made.run.export


def test_two_tables_of_one_format():
    made = run("xps-pvt", {"format": "xps-pvt", "file": "slow", "segment": "20 ms"})
    assert [section.stem for section in made.run.export] == ["xps-pvt", "slow"]


def test_a_file_may_have_the_suffix_of_its_format():
    made = run({"format": "csv", "file": "motors.csv"}, {"format": "xps-pvt", "file": "motors.csv"})
    names = [section.stem + section.suffix for section in made.run.export]
    assert names == ["motors.csv", "motors.csv.trj"]
    scaled = export_section(format="csv", file="first.csv", scale=0.5)
    assert scaled.stem + scaled.suffix == "first-scale-0.5.csv"
    with pytest.raises(InputError, match="'motors' is listed twice"):
        run({"format": "csv", "file": "motors"}, {"format": "csv", "file": "motors.csv"})
