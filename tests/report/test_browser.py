"""Reports in a real browser: no errors, nothing loaded, the view moves, tables sort, it prints."""

import json
import math
import re

import pytest

from estimation.identification import estimate_parameters, estimation_result
from expdesign.stages.registry import reported_stages
from results.render.markup import html_page
from results.render.run_report import write_report
from results.views.estimate import estimates_table
from results.views.view import Page, PageSection
from tests.estimation.cases import measured, run, trajectory
from tests.report.browser import chromium
from tests.report.conftest import HOSTILE
from tests.tiny_run import run_every_stage

pytestmark = pytest.mark.system("chromium")

VIEW = "document.querySelector('figure.view')"


@pytest.fixture(scope="module")
def whole(tiny_result, tmp_path_factory):
    """Return a run folder with every stage, with figures that are rendered."""
    folder = tmp_path_factory.mktemp("rendered") / "tiny"
    run_every_stage(folder, title=HOSTILE, design=tiny_result)
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("browser")) as found:
        yield found


def show(browser, path, width=1360):
    browser.open(path, width=width)
    browser.wait(f"{VIEW}.dataset.ready !== undefined")


@pytest.fixture
def opened(browser, whole):
    """Return the browser with the report: loading takes seconds, tests leave it of use to others.

    What was changed in it before, such as the view's moment, no test may rely on.
    """
    page = whole / "report.html"
    if browser.shown != (page, 1360):
        show(browser, page)
    browser.frames(2)  # what was said of the test before has arrived then
    browser.console.clear()
    return browser


def errors(browser):
    # The plotting library's hint about its own speed is a warning, and no error.
    return [entry for entry in browser.console if "willReadFrequently" not in str(entry)]


def test_no_error_and_nothing_is_loaded(browser, whole):
    browser.console.clear()
    browser.requests.clear()
    show(browser, whole / "report.html")
    assert browser.run(f"{VIEW}.dataset.ready") == "yes"
    assert errors(browser) == []
    assert {url.partition(":")[0] for url in browser.requests} <= {"file", "data", "blob"}
    assert sum(url.startswith("file:") for url in browser.requests) == 1


def test_the_network_is_forbidden(opened):
    failed = opened.run("fetch('https://example.com').then(() => false, () => true)")
    assert failed
    loaded = opened.run(
        "new Promise(done => { const i = new Image(); i.onload = () => done(true);"
        " i.onerror = () => done(false); i.src = 'https://example.com/a.png'; })"
    )
    assert not loaded


def test_the_view_moves(opened):
    before = opened.screenshot("figure.view .stage")
    moment = opened.run(f"Number({VIEW}.dataset.frame)")
    opened.run(f"{VIEW}.querySelector('.play').click()")
    opened.wait(f"Math.abs(Number({VIEW}.dataset.frame) - {moment}) > 3")
    assert opened.run(f"{VIEW}.querySelector('.play').textContent") == "Pause"
    opened.run(f"{VIEW}.querySelector('.play').click()")
    opened.frames(2)
    frame = opened.run(f"{VIEW}.dataset.frame")
    after = opened.screenshot("figure.view .stage")
    assert before != after
    opened.frames(10)
    assert opened.run(f"{VIEW}.dataset.frame") == frame
    assert errors(opened) == []


def test_the_slider_sets_the_moment(opened):
    opened.run(
        f"(() => {{ const s = {VIEW}.querySelector('.position'); s.value = 7;"
        " s.dispatchEvent(new Event('input')); })()"
    )
    opened.wait(f"{VIEW}.dataset.frame === '7'")
    assert re.fullmatch(r"t = \d\.\d{3} s", opened.run(f"{VIEW}.querySelector('.clock').value"))


def test_the_limits_of_the_moment_are_shown(opened):
    data = json.loads(opened.run(f"{VIEW}.querySelector('script.data').textContent"))
    found = [[data["limits"][k] for k in now] for now in data["reached"]]
    busiest = max(range(len(found)), key=lambda frame: len(found[frame]))
    of_a_strut = [k for k, now in enumerate(found) if any(one["struts"] for one in now)]
    free = [k for k, now in enumerate(found) if not now]
    for frame in (busiest, *of_a_strut[:1], *free[:1]):
        opened.run(
            f"(() => {{ const s = {VIEW}.querySelector('.position'); s.value = {frame};"
            " s.dispatchEvent(new Event('input')); })()"
        )
        opened.wait(f"{VIEW}.dataset.frame === '{frame}'")
        words = opened.run(f"{VIEW}.querySelector('.reached').value")
        for one in found[frame]:
            assert one["title"] in words
            assert one["row"] in words
        struts = {j for one in found[frame] for j in one["struts"]}
        # Three places of one line for each strut, the last of them a gap.
        drawn = [opened.run(f"{VIEW}.querySelector('.stage').data[{k}].x.length") for k in (0, 7)]
        assert drawn == [3 * (6 - len(struts)), 3 * len(struts)]
    assert errors(opened) == []


@pytest.mark.parametrize("playing", [False, True])
def test_the_view_is_rotated_by_the_mouse(opened, playing):
    opened.run(f"{VIEW}.scrollIntoView({{behavior: 'instant'}})")
    turned_by_hand = f"{VIEW}.querySelector('.stage')._fullLayout.scene._scene.getCamera().eye"
    before = opened.run(turned_by_hand)
    x, y = opened.run(f"(r => [r.x + r.width / 2, r.y + 150])({VIEW}.getBoundingClientRect())")
    if playing:
        opened.run(f"{VIEW}.querySelector('.play').click()")
    moment = int(opened.run(f"{VIEW}.dataset.frame"))
    press = {"button": "left", "clickCount": 1}
    opened.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    opened.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **press)
    for step in range(1, 8):
        opened.call(
            "Input.dispatchMouseEvent", type="mouseMoved", x=x + 15 * step, y=y, buttons=1, **press
        )
        if playing:
            opened.wait(f"Number({VIEW}.dataset.frame) !== {moment}")
            moment = int(opened.run(f"{VIEW}.dataset.frame"))
        opened.frames(1)
    opened.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 105, y=y, **press)
    opened.frames(20)
    if playing:
        opened.run(f"{VIEW}.querySelector('.play').click()")
        opened.frames(2)
    after = opened.run(turned_by_hand)
    # About the vertical; how far depends on how fast the hand was.
    assert math.hypot(after["x"] - before["x"], after["y"] - before["y"]) > 0.1
    assert math.hypot(after["x"], after["y"]) == pytest.approx(math.hypot(1.06, 1.2))
    assert after["z"] == pytest.approx(before["z"])
    opened.run(f"{VIEW}.querySelector('.home').click()")
    opened.frames(2)
    home = opened.run(turned_by_hand)
    assert [home[k] for k in "xyz"] == pytest.approx([1.06, -1.2, 0.72])
    assert errors(opened) == []


COLUMN = """
[...document.querySelectorAll('#table-parameters tbody tr')]
  .map(row => row.cells[%d].dataset.sort ?? row.cells[%d].dataset.text)
"""


def test_tables_sort_by_number_and_by_word(opened):
    def column(k):
        return opened.run(COLUMN % (k, k))

    def click(k):
        opened.run(f"document.querySelectorAll('#table-parameters th')[{k}].click()")

    names, original = column(0), [float(cell) for cell in column(2)]
    click(2)
    assert [float(cell) for cell in column(2)] == sorted(original)
    assert column(0) != names
    click(2)
    assert [float(cell) for cell in column(2)] == sorted(original, reverse=True)
    click(0)
    expected = [f"p{k}" for k in range(1, 11)]
    assert [name for name in column(0) if name in expected] == expected
    sort = "document.querySelectorAll('#table-parameters th')[0].getAttribute('aria-sort')"
    assert opened.run(sort) == "ascending"


def test_tables_are_copied_with_all_digits(opened, whole):
    opened.run(
        "Object.defineProperty(navigator, 'clipboard', {configurable: true, value:"
        " {writeText: text => { window.copied = text; return Promise.resolve(); }}})"
    )
    opened.run("document.querySelector('#table-parameters button.copy').click()")
    opened.wait("window.copied !== undefined")
    lines = [line.split("\t") for line in opened.run("window.copied").splitlines()]
    assert lines[0][:3] == ["parameter", "unit", "nominal"]
    table = (whole / "tables" / "parameters.csv").read_text(encoding="utf-8").splitlines()
    assert {(line[0], line[3]) for line in lines[1:]} == {
        (row.split(",")[0], row.split(",")[3]) for row in table[1:]
    }


def test_it_prints(opened):
    pdf = opened.pdf()
    assert pdf.startswith(b"%PDF")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 4 <= pages <= 30
    opened.call("Emulation.setEmulatedMedia", media="print")
    try:
        shown = "getComputedStyle(document.querySelector('%s')).display"
        assert opened.run(shown % "figure.view .snapshot") == "block"
        assert opened.run(f"{VIEW}.querySelector('.snapshot').naturalWidth") > 500
        for hidden in ("nav.contents", "figure.view .stage", ".controls", "button.copy"):
            assert opened.run(shown % hidden) == "none"
    finally:
        opened.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("width", [1360, 420])
def test_nothing_sticks_out(browser, whole, width):
    page = whole / "report.html"
    if browser.shown != (page, width):
        show(browser, page, width)
    assert browser.run("document.documentElement.scrollWidth") <= width


def test_the_widest_table_fits_a_laptop_and_scrolls_on_a_phone(browser, tmp_path):
    """With the shares of tolerances and the truth, in the widest numbers."""
    motion = trajectory(100, 0.01)
    sections = {"tolerances": {"strut_length": "1 mm"}}
    config = run({"harmonics": 2, "estimators": ["gm"]}, **sections)
    record = estimation_result(estimate_parameters(config, measured(motion, 1, step=0.01), motion))
    truth = {row.parameter: row.value * 1.0001 for row in record.by_estimator()["gm"]}
    table = estimates_table(record, truth)
    assert {"σ random", "σ systematic", "truth"} <= {column.title for column in table.columns}
    page = tmp_path / "page.html"
    section = PageSection("estimate", "Estimate", (table,))
    page.write_text(html_page(Page("t", "s", "d", (), (), (section,))), encoding="utf-8")
    scroll = "document.querySelector('.scroll')"
    browser.open(page, width=1200)
    assert browser.run(f"{scroll}.scrollWidth <= {scroll}.clientWidth")
    browser.open(page, width=420)
    assert browser.run(f"{scroll}.scrollWidth > {scroll}.clientWidth")
    assert browser.run(f"({scroll}.scrollLeft = 200, {scroll}.scrollLeft)") == 200


def test_without_webgl_the_rest_is_there(browser, folder):
    write_report(folder, reported_stages())
    page = folder / "report.html"
    text = page.read_text(encoding="utf-8")
    broken = (
        "<script>HTMLCanvasElement.prototype.getContext = () => null;"
        " window.DecompressionStream = undefined;</script>"
    )
    page.write_text(text.replace("<body>", f"<body>{broken}"), encoding="utf-8")
    browser.open(page)
    browser.wait(f"{VIEW}.dataset.ready !== undefined")
    assert browser.run(f"{VIEW}.dataset.ready") == "no"
    assert browser.run(f"{VIEW}.querySelector('.unavailable').hidden") is False
    browser.run("document.querySelectorAll('#table-parameters th')[2].click()")
    sort = "document.querySelectorAll('#table-parameters th')[2].getAttribute('aria-sort')"
    assert browser.run(sort) == "ascending"
