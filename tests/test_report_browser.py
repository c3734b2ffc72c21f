"""The report in a browser: headless Chromium, offline, driven as a reader would.

Without Chromium these tests are skipped and say which packages they need (`apt install chromium
chromium-driver`): a clean machine may not have a browser, and the numbers in the page are tested
without one in test_report.py. With `TRAJOPT_BROWSER=required` in the environment they fail instead.
"""

from __future__ import annotations

import base64
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from test_report import NASTY, made
from test_report import run as made_on

from trajopt import Limits, Problem
from trajopt.benchmark import report, run, store, suite
from trajopt.benchmark.results import Results
from trajopt.benchmark.trial import judge
from trajopt.planner import load

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--force-prefers-reduced-motion", "--window-size=1280,900",
)  # fmt: skip
PLANNERS = ("toppra", "unoptimised", "pso:iterations=20")
STIFF = Problem([[0.0], [1.0]], Limits([1.0], [1.0], [2.0]), "stiff")

Script = Callable[..., Any]


def _missing() -> str:
    absent = [p for p, name in (("chromium", "chromium"), ("chromium-driver", "chromedriver"))
              if not shutil.which(name)]  # fmt: skip
    return f"needs a browser: apt install {' '.join(absent)}" if absent else ""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    if missing := _missing():
        (pytest.fail if os.environ.get("TRAJOPT_BROWSER") == "required" else pytest.skip)(missing)
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A real comparison, read back from its files, and made-up trials that fail or cheat."""
    folder = tmp_path_factory.mktemp("results")
    planners = [(spec.partition(":")[0], load(spec)) for spec in PLANNERS]
    run.compare([suite.load("one-joint")], planners, folder, seeds=3)
    stiff = [*made_on("mine", 3.0, 4.0, on=STIFF), *judge(load("toppra"), STIFF, [0], "toppra")]
    return Results([*store.Store(folder).read(), *stiff, *made()])


@pytest.fixture(scope="module")
def page(browser: Any, results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report.write(results, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture
def script(browser: Any, page: Path) -> Script:
    """The page, ready, nothing filtered; runs JavaScript in it, which may be asynchronous."""
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    browser.set_script_timeout(20)
    if browser.current_url.partition("#")[0] != page.as_uri():
        browser.get(page.as_uri())
    _run(browser, """while (!document.documentElement.dataset.ready)
        await new Promise((go) => setTimeout(go, 20));
        for (const id of ["search", "by-planner", "by-status"]) {
            const box = document.getElementById(id);
            box.value = ""; box.dispatchEvent(new Event("input"));
        }
        document.getElementById("trials").close();""")  # fmt: skip
    return lambda text, *arguments: _run(browser, text, *arguments)


def _run(browser: Any, text: str, *arguments: Any) -> Any:
    body = f"const done = arguments[arguments.length - 1]; (async (...args) => {{ {text} }})"
    return browser.execute_async_script(f"{body}(...arguments).then(done)", *arguments)


PAUSE = "await new Promise((go) => setTimeout(go, 60));"
COLUMN = """return [...document.querySelectorAll('#result-table tbody tr:not(.out):not(.beyond)')]
    .map((row) => row.cells[args[0]].dataset.value ?? row.cells[args[0]].textContent.trim())"""

OPEN = """const panel = [...document.querySelectorAll('details.problem')]
    .find((d) => d.querySelector('b').textContent === args[0]);
    panel.open = true;
    for (let i = 0; i < 100 && panel.querySelectorAll('.main-svg').length < args[1]; i += 1)
        await new Promise((go) => setTimeout(go, 20));
    return [...panel.querySelectorAll('.chart')].map((c) => c.data)"""


def header(script: Script, title: str) -> int:
    """Click a column's heading and return the column."""
    column: int = script("""const buttons = [...document.querySelectorAll('#result-table button')];
        const button = buttons.find((b) => b.textContent === args[0]);
        button.click(); return Number(button.dataset.column)""", title)  # fmt: skip
    return column


def test_it_opens_offline_without_a_complaint(browser: Any, script: Script, page: Path) -> None:
    assert browser.get_log("browser") == []
    requests = [e["message"] for e in browser.get_log("performance")
                if '"Network.requestWillBeSent"' in e["message"]]  # fmt: skip
    assert not [r for r in requests if '"url":"http' in r]
    assert script("return document.getElementById('broken').hidden")
    assert script("return document.querySelectorAll('.chart .main-svg').length") > 4


def test_sorting_is_by_number_both_ways_and_none_comes_last(script: Script) -> None:
    column = header(script, "certified (s)")
    up = script(COLUMN, column)
    values = [float(v) for v in up if v]
    assert values == sorted(values)
    assert max(values) > 2 > min(values)
    assert "" in up
    assert all(up[: len(values)])
    header(script, "certified (s)")
    assert [float(v) for v in script(COLUMN, column) if v] == values[::-1]
    assert script(COLUMN, column)[-1] == ""
    column = header(script, "planner")
    names = script(COLUMN, column)
    assert names == sorted(names, key=str.casefold)


def test_filters_hide_rows_and_say_how_many(script: Script, results: Results) -> None:
    summary = results.summary()
    set_ = """const box = document.getElementById(args[0]); box.value = args[1];
        box.dispatchEvent(new Event('input'));"""
    script(set_, "search", "ONE-J")
    assert set(script(COLUMN, 0)) == {"one-joint"}
    assert script("return document.getElementById('shown').textContent").startswith("4 of ")
    script(set_, "search", "")
    script(set_, "by-status", "unsupported")
    assert len(script(COLUMN, 0)) == (summary["status"] == "unsupported").sum() == 1
    script(set_, "by-status", "")
    choice = """return [...document.getElementById('by-planner').options]
        .find((o) => o.text === args[0]).value"""
    script(set_, "by-planner", script(choice, "toppra"))
    assert len(script(COLUMN, 0)) == (summary["label"] == "toppra").sum()


def test_a_planner_disappears_from_tables_and_charts_and_comes_back(script: Script) -> None:
    state = """return [...document.querySelectorAll('.chart')].flatMap((c) => (c.data ?? [])
        .filter((t) => t.name === args[0]).map((t) => t.visible))"""
    click = (
        """const button = [...document.querySelectorAll('.toggle')]
        .find((b) => b.textContent.trim() === args[0]); button.click();"""
        + PAUSE
    )
    script(OPEN, "one-joint", 4)
    before = script(COLUMN, 1)
    assert set(script(state, "unoptimised")) == {True}
    script(click, "unoptimised")
    assert set(script(state, "unoptimised")) == {False}
    assert "unoptimised" not in script(COLUMN, 1)
    script(click, "unoptimised")
    assert script(COLUMN, 1) == before
    assert set(script(state, "unoptimised")) == {True}


def shown(results: Results) -> pd.DataFrame:
    return results.summary().set_index(["problem", "label"])


def test_the_numbers_that_are_read_are_those_of_the_files(script: Script, results: Results) -> None:
    rows = script("""return [...document.querySelectorAll('#result-table tbody tr')]
        .map((row) => [...row.cells].map((cell) => cell.innerText.trim()))""")  # fmt: skip
    summary = shown(results)
    assert len(rows) == len(summary)
    for name, label, solved, kept, median, _, gap, *_ in rows:
        own = summary.loc[(name, label)]
        assert solved == f"{own['solved']} of {own['runs']}"
        assert kept == f"{100 * own['kept']:.0f} %"
        if np.isfinite(own["median"]):
            assert float(median) == pytest.approx(own["median"], abs=5.1e-5)
        else:
            assert median == "–" or median.startswith("≥")
        if np.isfinite(own["gap"]):
            assert float(gap.replace("−", "-")) == pytest.approx(100 * own["gap"], abs=0.051)


def test_a_number_leads_to_its_trials_and_they_are_those_of_the_files(
    script: Script, results: Results
) -> None:
    script("""const row = [...document.querySelectorAll('#result-table tbody tr')].find((r) =>
        r.cells[0].textContent === 'one-joint' && r.cells[1].textContent.includes('pso'));
        row.querySelector('a[href$="-median"]').click();""" + PAUSE)  # fmt: skip
    assert script("return document.getElementById('trials').open")
    ids = script("return [...document.querySelectorAll('#trial-table tbody tr')].map((r) => r.id)")
    values = script("""return [...document.querySelectorAll('#trial-table tbody tr')]
        .map((r) => Number(r.cells[3].dataset.value))""")  # fmt: skip
    trials = {f"trial-{t.id}": t for t in results.items}
    assert [trials[i].seed for i in ids] == [0, 1, 2]
    assert values == [trials[i].certified_duration for i in ids]
    bold = script(
        "return [...document.querySelectorAll('.from')].map((c) => Number(c.dataset.value))"
    )
    assert bold == [np.median(values)]
    text = script("return document.getElementById('trial').innerText")
    chosen = ids[values.index(bold[0])].removeprefix("trial-")
    assert f"trials/{chosen}.h5" in text
    assert (
        f"trajopt plan one-joint --planner pso:iterations=20 --seed {values.index(bold[0])}" in text
    )
    assert "inertia=0.7298" in text


def test_a_failure_leads_to_its_message_and_closes_again(script: Script, results: Results) -> None:
    (lost,) = [t for t in results.items if t.label == NASTY]
    script(f"location.hash = 'trial-{lost.id}';" + PAUSE)
    text = script("return document.getElementById('trial').innerText")
    assert lost.message.strip() in text
    assert "failed" in text
    script("document.querySelector('#trials form button').click();" + PAUSE)
    assert not script("return document.getElementById('trials').open || location.hash.length")


def test_suspicious_trials_are_in_the_red_box(script: Script) -> None:
    colour = script("return getComputedStyle(document.getElementById('suspicious')).borderColor")
    assert colour == "rgb(176, 0, 32)"
    script("document.querySelector('#suspicious a').click();" + PAUSE)
    assert script("return document.getElementById('trials-title').textContent") == "fast on one"


def test_a_problem_is_drawn_when_it_is_opened(script: Script, results: Results) -> None:
    durations, _, moved, use = script(OPEN, "stiff", 4)
    own = {t.certified_duration for t in results.items
           if t.problem.name == "stiff" and t.certified_duration}  # fmt: skip
    assert {x for trace in durations for x in trace["x"]} == own
    assert {trace["yaxis"] for trace in moved} == {"y", "y2", "y3", "y4"}  # with jerk
    assert np.max(use[0]["z"]) <= 1


def test_a_suite_of_its_own_can_be_chosen(script: Script) -> None:
    names = script("return [...document.getElementById('suite').options].map((o) => o.text)")
    assert names == ["all problems (4)", "limits: velocity, acceleration (3)"]
    note = "return document.getElementById('suite-note').textContent"
    before = script(note)
    script("""const box = document.getElementById('suite'); box.value = 1;
        box.dispatchEvent(new Event('change'));""" + PAUSE)  # fmt: skip
    assert script(note) != before


@pytest.mark.parametrize("width", [320, 390])
def test_a_phone_does_not_scroll_sideways(browser: Any, script: Script, width: int) -> None:
    size = {"width": width, "height": 800, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    script(PAUSE)
    assert script("return document.documentElement.scrollWidth") <= width
    labels = "return getComputedStyle(document.querySelector('td[data-label]'), '::before').content"
    assert script(labels) != "none"


def test_paper_has_the_charts_and_no_controls(browser: Any, script: Script) -> None:
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    script("window.dispatchEvent(new Event('beforeprint'));" + PAUSE)
    visible = """return [...document.querySelectorAll(args[0])].filter((e) => e.checkVisibility())
        .map((e) => e.getBoundingClientRect().width)"""
    assert script(visible, "nav, #search, .modebar, dialog") == []
    widths = script(visible, ".chart .main-svg")
    assert len(widths) > 4
    assert max(widths) <= 690  # px: A4 less two margins of 14 mm
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
    assert base64.b64decode(printed["data"]).startswith(b"%PDF")
