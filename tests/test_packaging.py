"""The distribution: its version, its command, its data, and what a wheel holds."""

import importlib.metadata
import importlib.resources
import tomllib
import zipfile
from configparser import ConfigParser
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from estimation.data.reading import file_formats

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("constraints", "expdesign", "estimation", "results")
LIBRARY_FOLDERS = ("robots", "runs")


@pytest.fixture(scope="module")
def project():
    with (ROOT / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The names in a wheel of this tree, and the text of its entry points."""
    folder = tmp_path_factory.mktemp("wheel")
    (path,) = map(Path, WheelBuilder(str(ROOT)).build(directory=str(folder)))
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        (entry_points,) = (name for name in names if name.endswith(".dist-info/entry_points.txt"))
        return path.name, frozenset(names), archive.read(entry_points).decode()


def test_version_of_pyproject_is_the_installed_one(project):
    assert importlib.metadata.version("expdesign") == project["version"]


def test_console_script_resolves(project):
    (script,) = importlib.metadata.distribution("expdesign").entry_points.select(
        group="console_scripts", name="expdesign"
    )
    assert script.value == project["scripts"]["expdesign"]
    assert callable(script.load())


@pytest.mark.parametrize("folder", LIBRARY_FOLDERS)
def test_library_data_is_reachable(folder):
    files = importlib.resources.files("expdesign").joinpath("library", folder)
    texts = {
        file.name: file.read_text(encoding="utf-8")
        for file in files.iterdir()
        if file.name.endswith(".yaml")
    }
    assert texts
    assert all(text.strip() for text in texts.values())


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_say_that_they_are_typed(package):
    assert importlib.resources.files(package).joinpath("py.typed").is_file()


def test_wheel_has_the_version(wheel, project):
    name, _, _ = wheel
    assert name == f"expdesign-{project['version']}-py3-none-any.whl"


@pytest.mark.parametrize("folder", LIBRARY_FOLDERS)
def test_wheel_holds_the_library(wheel, folder):
    _, names, _ = wheel
    here = ROOT / "expdesign" / "library" / folder
    shipped = {path.relative_to(ROOT).as_posix() for path in here.glob("*.yaml")}
    assert shipped
    assert shipped <= names


def test_wheel_holds_every_module_and_type_marker(wheel):
    _, names, _ = wheel
    modules = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    assert modules | {f"{package}/py.typed" for package in PACKAGES} <= names


def test_wheel_holds_nothing_but_the_packages(wheel, project):
    _, names, _ = wheel
    assert {name.partition("/")[0] for name in names} == {
        *PACKAGES,
        f"expdesign-{project['version']}.dist-info",
    }


def test_wheel_installs_the_console_script(wheel, project):
    _, _, text = wheel
    entry_points = ConfigParser()
    entry_points.read_string(text)
    assert dict(entry_points["console_scripts"]) == project["scripts"]


def test_the_extra_all_is_all_extras_but_the_developers(project):
    extras = dict(project["optional-dependencies"])
    everything = set(extras.pop("all"))
    extras.pop("dev")
    assert everything == {requirement for extra in extras.values() for requirement in extra}


def test_every_format_names_an_extra_that_brings_its_library(project):
    for found in file_formats():
        if found.library is not None:
            requirements = project["optional-dependencies"][found.extra]
            assert any(text.startswith(found.library) for text in requirements)
