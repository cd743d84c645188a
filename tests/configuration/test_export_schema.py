"""`export:` in a run file."""

import pkgutil

import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
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


@pytest.mark.parametrize(
    ("export", "key", "message"),
    [
        ([{"format": "xps"}], "export[1].format", "'xps' is not a choice"),
        (["csv", "csv"], "export", "'csv' is listed twice"),
        ([{"format": "csv", "digits": 3}], "export[1].digits", "csv has no option 'digits'"),
        ([{"format": "xps-pvt", "unit": "mm"}], "export[1].unit", "unknown key 'unit'"),
        ([{"format": "xps-pvt", "digits": -1}], "export[1].digits", "-1 is out of range"),
        ([{"format": "xps-pvt", "segment": 0}], "export[1].segment", "0 is not positive"),
        ([{"format": "xps-pvt", "sign": 2}], "export[1].sign", "2 is not a sign"),
        (
            [{"format": "xps-pvt", "order": [1, 1, 2, 3, 4, 5]}],
            "export[1].order",
            "[1, 1, 2, 3, 4, 5] is not an order of the 6 struts",
        ),
        (
            ["csv", {"format": "xps-pvt", "offset": [0.6, 0.6]}],
            "export[2].offset",
            "there are 2 offsets where 6 are needed",
        ),
        (
            [{"format": "xps-pvt", "space": "pose", "offset": "home"}],
            "export[1].offset",
            "'offset' is about actuators, the table holds poses",
        ),
        (
            [{"format": "xps-pvt", "units": "mm", "counts_per_metre": 1e6}],
            "export[1].units",
            "units and counts_per_metre are both given",
        ),
    ],
)
def test_what_is_refused(export, key, message):
    with pytest.raises(InputError) as caught:
        run(*export)
    assert (key, message) in [(p.key, p.message) for p in caught.value.problems]


def test_two_tables_of_one_format():
    made = run("xps-pvt", {"format": "xps-pvt", "file": "slow", "segment": "20 ms"})
    assert [section.stem for section in made.run.export] == ["xps-pvt", "slow"]
