"""The report in a browser: headless Chromium, offline, driven as a reader would.

Without Chromium these tests are skipped and say which packages they need (`apt install chromium
chromium-driver`): a clean machine may not have a browser, and the numbers in the page are tested
without one in test_report.py. With `TRAJOPT_BROWSER=required` in the environment they fail instead.
"""

from __future__ import annotations

import base64
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import browser as chromium
import numpy as np
import pandas as pd
import pytest
import screens
from PIL import Image
from scipy import stats
from statsmodels.stats.multitest import multipletests
from test_report import NASTY, made
from test_report import run as made_on

from trajopt import Limits, Problem, Status
from trajopt import comparison as run
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load
from trajopt.views import report
from trajopt.views.results import Results

PLANNERS = ("toppra", "unoptimised", "pso:iterations=20")
STIFF = Problem([[0.0], [1.0]], Limits([1.0], [1.0], [2.0]), "stiff")

Script = Callable[..., Any]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A real comparison, read back from its files, and made-up trials that fail or cheat."""
    folder = tmp_path_factory.mktemp("results")
    planners = [(spec.partition(":")[0], load(spec)) for spec in PLANNERS]
    run.compare([suite.load("one-joint")], planners, folder, seeds=3)
    stiff = [*made_on("mine", 3.0, 4.0, on=STIFF), *trials_of(load("toppra"), STIFF, [0], "toppra")]
    # the made-up `exact` is the later version of that planner, whichever test made it first
    later = [replace(trial, started="2100-01-01T00:00:00+00:00") for trial in made()]
    return Results([*store.Store(folder).read(), *stiff, *later])


@pytest.fixture(scope="module")
def page(browser: Any, results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    (folder / "trials").mkdir()
    return report.write(results, folder / "report.html")


@pytest.fixture
def script(browser: Any, page: Path) -> Script:
    """The page, ready, nothing filtered; runs JavaScript in it, which may be asynchronous."""
    chromium.leave_size(browser)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    browser.set_script_timeout(20)
    if browser.current_url.partition("#")[0] != page.as_uri():
        browser.get(page.as_uri())
    chromium.run(
        browser,
        chromium.READY
        + """
        for (const id of ["search", "by-planner", "by-status"]) {
            const box = document.getElementById(id);
            box.value = ""; box.dispatchEvent(new Event("input"));
        }
        document.getElementById("trials").close();""",
    )
    return lambda text, *arguments: chromium.run(browser, text, *arguments)


PAUSE = "await new Promise((go) => setTimeout(go, 150));"
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
    column: int = script(
        """const buttons = [...document.querySelectorAll('#result-table button')];
        const button = buttons.find((b) => b.textContent === args[0]);
        button.click(); return button.parentNode.cellIndex""",
        title,
    )
    return column


def test_it_opens_offline_without_a_complaint(browser: Any, script: Script, page: Path) -> None:
    assert browser.get_log("browser") == []
    requests = [
        e["message"]
        for e in browser.get_log("performance")
        if '"Network.requestWillBeSent"' in e["message"]
    ]
    assert not [r for r in requests if '"url":"http' in r]
    assert script("return document.getElementById('broken').hidden")
    assert script("return document.querySelectorAll('.chart .main-svg').length") > 4


def test_the_charts_are_there_when_the_page_has_loaded(browser: Any, page: Path) -> None:
    """So are they in a picture that a program takes of it; and Plotly knows all that is asked."""
    browser.get("about:blank")
    browser.get(page.as_uri())  # until it has loaded
    assert browser.execute_script("return document.documentElement.dataset.ready") == "1"
    assert browser.execute_script("return document.querySelector('iframe')") is None
    unknown = """return [...document.querySelectorAll('.chart')].filter((c) => c.layout)
        .flatMap((c) => Plotly.validate(c.data, c.layout) ?? [])
        .filter((fault) => ['schema', 'value'].includes(fault.code)).map((fault) => fault.msg)"""
    assert browser.execute_script(unknown) == []


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


def test_every_table_is_sorted_by_its_headings(script: Script) -> None:
    """Numbers as numbers, − as a sign, none last; of planners by name."""
    click = """const table = document.getElementById(args[0]);
        const found = [...table.querySelectorAll('thead button')];
        found.find((b) => b.textContent === args[1]).click();
        const column = found.findIndex((b) => b.textContent === args[1]);
        return [...table.tBodies[0].rows].map((r) => r.cells[column].textContent.trim())"""
    for _ in range(2):  # up, and down again
        gaps = script(click, "planner-table", "median gap (%)")
        known = [float(text.replace("−", "-")) for text in gaps if text[-1].isdigit()]
        assert len(set(known)) > 1
        assert known == sorted(known, reverse=bool(_))
    names = script(click, "planner-table", "planner")
    assert names == sorted(names, key=str.casefold)


def test_a_table_is_one_tab_stop_and_arrow_keys_move_in_it(script: Script) -> None:
    stops = """return [...document.querySelectorAll('table.sortable, .legend')]
        .filter((box) => box.checkVisibility())
        .map((box) => [...box.querySelectorAll('a, button, summary')]
            .filter((own) => own.tabIndex >= 0 && own.checkVisibility()).length)"""
    counts = script(stops)
    assert len(counts) >= 4
    assert set(counts) == {1}
    moved = """const table = document.getElementById('result-table');
        table.querySelector('[tabindex="0"]').focus();
        const at = () => [document.activeElement.closest('tr').rowIndex,
            document.activeElement.textContent];
        return [at(), ...args[0].map((key) => {
            document.activeElement.dispatchEvent(
                new KeyboardEvent('keydown', { key, bubbles: true }));
            return at();
        })]"""
    seen = script(moved, ["ArrowRight", "ArrowLeft", "ArrowLeft", "ArrowDown", "ArrowUp"])
    assert [text for _, text in seen[:4]] == ["problem", "planner", "problem", "problem"]
    assert seen[4][0] > 0
    assert seen[5] == seen[0]
    assert set(script(stops)) == {1}


def test_filters_hide_rows_and_say_how_many(script: Script, results: Results) -> None:
    summary = results.summary()
    set_ = """const box = document.getElementById(args[0]); box.value = args[1];
        box.dispatchEvent(new Event('input'));"""
    script(set_, "search", "ONE-J")
    assert set(script(COLUMN, 0)) == {"one-joint"}
    # the real `exact` is left out: the made-up one is its later version
    assert script("return document.getElementById('shown').textContent").startswith("3 of ")
    script(set_, "search", "")
    script(set_, "by-status", "unsupported")
    assert len(script(COLUMN, 0)) == (summary["status"] == "unsupported").sum() == 1
    script(set_, "by-status", "!unsupported")  # as the page opens
    assert len(script(COLUMN, 0)) == (summary["status"] != "unsupported").sum()
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
        .map((row) => [...row.cells].map((cell) => cell.innerText.trim()))""")
    summary = shown(results)
    assert len(rows) == len(summary)
    for name, label, solved, kept, median, _, gap, *_ in rows:
        own = summary.loc[(name, label)]
        assert solved == f"{own['solved']} of {own['runs']}"
        no_motion = np.isnan(own["median"])
        assert kept == ("–" if no_motion else f"{100 * own['kept']:.0f} %")
        if np.isfinite(own["median"]):
            assert float(median) == pytest.approx(own["median"], abs=5.1e-5)
        else:
            assert median == "–" or median.startswith("≥")
        if np.isfinite(own["gap"]):
            assert float(gap.replace("−", "-")) == pytest.approx(100 * own["gap"], abs=0.051)


def test_a_number_leads_to_its_trials_and_they_are_those_of_the_files(
    script: Script, results: Results
) -> None:
    script(
        """const row = [...document.querySelectorAll('#result-table tbody tr')].find((r) =>
        r.cells[0].textContent === 'one-joint' && r.cells[1].textContent.includes('pso'));
        row.querySelector('a[href$="-median"]').click();"""
        + PAUSE
    )
    assert script("return document.getElementById('trials').open")
    ids = script("return [...document.querySelectorAll('#trial-table tbody tr')].map((r) => r.id)")
    values = script("""return [...document.querySelectorAll('#trial-table tbody tr')]
        .map((r) => Number(r.cells[3].dataset.value))""")
    trials = {f"trial-{t.id}": t for t in results.items}
    assert [trials[i].seed for i in ids] == [0, 1, 2]
    assert values == [trials[i].certified_duration for i in ids]
    bold = script(
        "return [...document.querySelectorAll('.from')].map((c) => Number(c.dataset.value))"
    )
    assert bold == [np.median(values)]
    text = script("return document.getElementById('trial').innerText")
    chosen = ids[values.index(bold[0])].removeprefix("trial-")
    assert f"trials/{chosen}.json" in text
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
    own = {
        t.certified_duration
        for t in results.items
        if t.problem.name == "stiff" and t.certified_duration
    }
    assert {x for trace in durations for x in trace["x"]} == own
    assert {trace["yaxis"] for trace in moved} == {"y", "y2", "y3", "y4"}  # with jerk
    assert np.max(use[0]["z"]) <= 1


def test_a_suite_of_its_own_can_be_chosen(script: Script) -> None:
    names = script("return [...document.getElementById('suite').options].map((o) => o.text)")
    assert names == ["all problems (4)", "limits: velocity, acceleration (3)"]
    note = "return document.getElementById('suite-note').textContent"
    before = script(note)
    script(
        """const box = document.getElementById('suite'); box.value = 1;
        box.dispatchEvent(new Event('change'));"""
        + PAUSE
    )
    assert script(note) != before


RIVALS = ("mine", "other", "slow")


@pytest.fixture(scope="module")
def rivals() -> Results:
    """Eight problems of two suites; "other" has no answer to two of them, "slow" runs once."""
    rng = np.random.default_rng(3)
    items = []
    for n in range(8):
        name, best = f"{'random' if n < 5 else 'robots'}-{n}", 2.0 + n
        on = Problem([[0.0], [1.0 + n]], Limits([50.0 + n], [500.0]), name)
        items += made_on("spline353-nlp", best, on=on)
        for planner, runs, above in (("mine", 4, 0.02), ("other", 4, 0.04), ("slow", 1, 0.4)):
            lost = planner == "other" and n in (1, 6)
            found = np.round(best * (1 + rng.exponential(above, runs)), 3)
            items += made_on(planner, *([None] * 4 if lost else found.tolist()), on=on)
    return Results(items)


@pytest.fixture(scope="module")
def rival_page(rivals: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report.write(rivals, tmp_path_factory.mktemp("rivals") / "report.html")


@pytest.fixture
def open_rivals(browser: Any, rival_page: Path) -> Script:
    """The page, ready, every choice as it was when it opened."""
    chromium.leave_size(browser)
    browser.set_script_timeout(20)
    if browser.current_url.partition("#")[0] != rival_page.as_uri():
        browser.get(rival_page.as_uri())
    chromium.run(
        browser,
        chromium.READY
        + """
        for (const box of document.querySelectorAll("select")) {
            const first = [...box.options].findIndex((o) => o.defaultSelected);
            if (box.selectedIndex === Math.max(first, 0)) continue;
            box.selectedIndex = Math.max(first, 0); box.dispatchEvent(new Event("change"));
        }""",
    )
    return lambda text, *arguments: chromium.run(browser, text, *arguments)


LINES = """return [...document.querySelectorAll(`#${args[0]} tbody tr`)]
    .filter((r) => r.checkVisibility() && !r.dataset.of)
    .map((r) => [...r.cells].map((c) => c.innerText.trim()))"""
CHOOSE = (
    """const box = document.getElementById(args[0]);
    box.value = [...box.options].find((o) => o.text.startsWith(args[1])).value;
    box.dispatchEvent(new Event('change'));"""
    + PAUSE
)


def durations(results: Results, suite: str = "") -> dict[tuple[str, str], np.ndarray]:
    """Per problem and planner the certified durations of its runs, straight from the trials."""
    found: dict[tuple[str, str], list[float]] = {}
    for t in results.items:
        if t.problem.name.startswith(suite):
            d = np.inf if t.certified_duration is None else t.certified_duration
            found.setdefault((t.problem.name, t.label), []).append(d)
    return {key: np.array(own) for key, own in found.items()}


def _logs(own: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Log ratios; ±99 where one of the two has no answer."""
    return np.clip(np.log(own) - np.log(theirs), -99, 99)


def expected_pairs(results: Results, suite: str, against: str) -> dict[str, list[float]]:
    """Better, tied, worse, median ratio, A12 and Holm's p by SciPy, statsmodels and counting."""
    own = durations(results, suite)
    names = sorted({k[0] for k in own})
    labels = sorted({k[1] for k in own})
    middle = {b: np.array([np.median(own[n, b]) for n in names]) for b in labels}
    pairs = list(itertools.combinations(labels, 2))
    pvalues = []
    for a, b in pairs:
        apart = _logs(middle[a], middle[b])
        pvalues.append(stats.wilcoxon(apart, method=stats.PermutationMethod()).pvalue)
    holm = dict(zip(pairs, multipletests(pvalues, method="holm")[1], strict=True))
    return {
        a: [
            (middle[a] < middle[against]).sum(),
            (middle[a] == middle[against]).sum(),
            (middle[a] > middle[against]).sum(),
            np.exp(np.median(_logs(middle[a], middle[against]))),
            np.mean(
                [
                    np.mean(own[n, a][:, None] < own[n, against])
                    + np.mean(own[n, a][:, None] == own[n, against]) / 2
                    for n in names
                ]
            ),
            holm[tuple(sorted((a, against)))],
        ]
        for a in labels
        if a != against
    }


@pytest.mark.parametrize("suite", ["", "random"])
@pytest.mark.parametrize("against", RIVALS)
def test_the_differences_that_are_read_are_those_of_other_programs(
    open_rivals: Script, rivals: Results, against: str, suite: str
) -> None:
    open_rivals(CHOOSE, "against", against)
    open_rivals(CHOOSE, "suite", suite or "all problems")
    lines = open_rivals(LINES, "paired-table")
    expected = expected_pairs(rivals, suite, against)
    assert {line[0] for line in lines} == set(expected)
    for name, count, *numbers, chance, p, real in lines:
        own = expected[name]
        assert int(count) == (5 if suite else 8)
        assert [int(v) for v in numbers[:3]] == own[:3]
        assert float(numbers[3]) == pytest.approx(own[3], abs=6e-6)
        assert float(chance.split()[0]) == pytest.approx(own[4], abs=0.0051)
        assert float(p) == pytest.approx(own[5], rel=0.006)
        untested = "5 families: cannot be tested"  # the smallest p is 2/2⁵
        shown = "yes" if own[5] < 0.05 else "not shown"
        assert real == (untested if suite else shown)
    text = open_rivals("return document.getElementById('rival').parentNode.innerText")
    assert f"against {against}" in text
    assert (suite or "all problems") in text


BOTH = """const row = [...document.querySelectorAll('#paired-table tbody tr')]
    .find((r) => !r.dataset.of && r.cells[0].innerText.trim() === args[0]);
    const both = row.nextElementSibling;
    return both.checkVisibility() ? [...both.cells].map((c) => c.innerText.trim()) : null"""


def test_where_both_answer_is_told_beside_all(open_rivals: Script, rivals: Results) -> None:
    open_rivals(CHOOSE, "against", "mine")
    own = durations(rivals)
    medians = {key: np.median(runs) for key, runs in own.items()}
    names = [n for n, label in own if label == "other" and np.isfinite(medians[n, label])]
    ratios = np.array([medians[n, "other"] / medians[n, "mine"] for n in names])
    _, count, better, tied, worse, ratio, _, _, _ = open_rivals(BOTH, "other")
    assert int(count) == len(names) == 6
    counts = [(ratios < 1).sum(), (ratios == 1).sum(), (ratios > 1).sum()]
    assert [int(better), int(tied), int(worse)] == counts
    assert float(ratio) == pytest.approx(np.exp(np.median(np.log(ratios))), abs=6e-6)
    assert open_rivals(BOTH, "slow") is None  # both answer everywhere


def test_runs_on_one_problem_are_compared_by_mann_and_whitney(
    open_rivals: Script, rivals: Results
) -> None:
    open_rivals(CHOOSE, "against", "mine")
    open_rivals(CHOOSE, "seed-problem", "robots-7")
    own = durations(rivals)
    mine = own["robots-7", "mine"]
    other = own["robots-7", "other"]
    ((name, runs, theirs, *medians, ratio, chance, p, _),) = open_rivals(LINES, "seed-table")
    assert (name, runs, theirs) == ("other", "4", "4")
    expected = [np.median(other), np.median(mine)]
    assert [float(m) for m in medians] == pytest.approx(expected, abs=6e-5)
    assert float(ratio) == pytest.approx(expected[0] / expected[1], abs=6e-6)
    test = stats.mannwhitneyu(mine, other, method="exact")
    assert float(chance.split()[0]) == pytest.approx(test.statistic / 16, abs=0.0051)
    assert float(p) == pytest.approx(test.pvalue, rel=0.006)  # one pair: nothing to adjust
    assert not open_rivals("return document.getElementById('no-rival').checkVisibility()")
    open_rivals(
        CHOOSE, "against", "slow"
    )  # which runs once: another takes its place, and it is said
    assert open_rivals(LINES, "seed-table")[0][0] == "other"
    said = open_rivals("return document.getElementById('no-rival').parentNode.innerText")
    assert said == "Every planner with several runs against mine, as slow has one run there."


def test_some_differences_are_real_and_some_are_not(open_rivals: Script) -> None:
    seen = set()
    for against in RIVALS:
        open_rivals(CHOOSE, "against", against)
        seen |= {line[-1] for line in open_rivals(LINES, "paired-table")}
    assert seen == {"yes", "not shown"}


def test_what_a_search_costs_is_what_its_runs_spent(open_rivals: Script, rivals: Results) -> None:
    # Each run has twice its duration after 10 evaluations, its duration after 100.
    lines = {line[0]: line[1:] for line in open_rivals(LINES, "ert-table")}
    own = durations(rivals)
    best = {n: d for (n, label), d in own.items() if label == "spline353-nlp"}
    assert set(lines) == {"mine", "other", "slow", "spline353-nlp"}
    for name, cells in lines.items():
        ratios = np.concatenate([d / best[n] for (n, b), d in own.items() if b == name])
        for cell, target in zip(cells, (1.1, 1.01, 1.001, 1.0001), strict=True):
            met = (ratios <= target).sum()
            ert, count = cell.replace("\u202f", "").split(maxsplit=1)
            assert count == f"{met} of {len(ratios)}"
            assert ert == (str(round(100 * len(ratios) / met)) if met else "∞")


def test_a_hidden_planner_is_not_compared(open_rivals: Script) -> None:
    before = open_rivals(LINES, "paired-table"), open_rivals(LINES, "ert-table")
    click = "document.querySelector(`.toggle[data-planner='${args[0]}']`).click()"
    k = open_rivals("""return [...document.querySelectorAll('#paired-table tbody tr')]
        .find((r) => r.cells[0].innerText.trim() === 'slow').dataset.planner""")
    open_rivals(click, k)
    for table in ("paired-table", "ert-table"):
        assert "slow" not in {line[0] for line in open_rivals(LINES, table)}
    open_rivals(click, k)
    assert (open_rivals(LINES, "paired-table"), open_rivals(LINES, "ert-table")) == before


def test_the_page_without_scripts_has_what_they_show_first(
    open_rivals: Script, rival_page: Path
) -> None:
    html = rival_page.read_text("utf-8")
    for name in ("paired-table", "ert-table"):
        written = open_rivals(
            """
            const page = new DOMParser().parseFromString(args[1], 'text/html');
            return [...page.querySelectorAll(`#${args[0]} tbody tr:not(.out):not(.both)`)]
                .map((r) => [...r.cells].map((c) => c.textContent.trim()))""",
            name,
            html,
        )
        assert written == open_rivals(LINES, name) != []


def test_the_two_choices_of_a_suite_are_one(open_rivals: Script) -> None:
    open_rivals(
        """const box = document.querySelectorAll('.suite')[1];
        box.value = 1; box.dispatchEvent(new Event('change'));"""
        + PAUSE
    )
    assert open_rivals("return document.getElementById('suite').value") == "1"
    assert open_rivals("return document.getElementById('suite-note').textContent")[0] == "5"


PHONE = 320  # px, the narrowest in use

FITTED = """return [...document.querySelectorAll('.chart')]
    .filter((c) => c.checkVisibility() && c.querySelector('.main-svg'))
    .map((c) => [c.querySelector('.main-svg').getBoundingClientRect().width,
                 c.parentNode.getBoundingClientRect().width])"""


@pytest.mark.parametrize("width", [390, 1440, 1920])
def test_a_chart_is_as_wide_as_its_column(
    browser: Any, script: Script, page: Path, width: int
) -> None:
    chromium.resize(browser, width, 900)
    browser.get("about:blank")
    browser.get(page.as_uri())
    script(chromium.READY)
    script(OPEN, "one-joint", 4)
    script(PAUSE)
    widths = script(FITTED)
    assert len(widths) >= 6
    for chart, column in widths:
        assert chart == pytest.approx(column, abs=2)
    assert script("return document.documentElement.scrollWidth") <= width
    chromium.leave_size(browser)
    script(PAUSE + PAUSE)
    assert all(chart == pytest.approx(column, abs=2) for chart, column in script(FITTED))


def test_the_screens_of_the_docs_are_of_their_size_and_nothing_stands_out(
    browser: Any, page: Path, tmp_path: Path
) -> None:
    row = screens.looked_at(browser, page, 390, "dark", tmp_path)
    assert row["page stands out, px"] == row["widest chart stands out, px"] == 0
    chromium.prefer(browser, "")
    chromium.leave_size(browser)
    for view in screens.VIEWS:
        with Image.open(tmp_path / f"{view}-390-dark.png") as picture:
            assert picture.size == (390, screens.HEIGHTS[390])
            grey = picture.convert("L")
            assert np.median(grey) < 64  # of 255: a dark page


def test_a_dark_page_has_light_ink_in_tables_and_charts(browser: Any, script: Script) -> None:
    script(OPEN, "one-joint", 4)
    looks = """const style = getComputedStyle(document.body);
        const charts = [...document.querySelectorAll('.chart')].filter((c) => c.layout);
        const lines = charts.flatMap((c) => c.data).map((t) => t.line?.color);
        return [style.color, style.backgroundColor,
            [...new Set(charts.map((c) => c.layout.font.color))], lines.includes('#000000')]"""
    drawn = """for (let i = 0; i < 100; i += 1) {
        const charts = [...document.querySelectorAll('.chart')].filter((c) => c.layout);
        if (charts.every((c) => c.layout.font.color === args[0])) return;
        await new Promise((go) => setTimeout(go, 20));
    }"""
    light = script(looks)
    chromium.prefer(browser, "dark")
    script(drawn, "#e9e9ea")
    ink, ground, fonts, black = script(looks)
    assert light[:3] == ["rgb(26, 26, 26)", "rgb(255, 255, 255)", ["#1a1a1a"]]
    assert (ink, ground, fonts, black) == (
        "rgb(233, 233, 234)",
        "rgb(22, 24, 28)",
        ["#e9e9ea"],
        False,
    )
    script("window.dispatchEvent(new Event('beforeprint'));")
    script(drawn, "#1a1a1a")
    assert script(looks)[2] == ["#1a1a1a"]  # on paper
    script("window.dispatchEvent(new Event('afterprint'));")
    script(drawn, "#e9e9ea")
    chromium.prefer(browser, "")
    script(drawn, "#1a1a1a")
    assert script(looks) == light


TRACE = f"""Traceback (most recent call last):
  File "/a/folder/{"deep/" * 40}solve.py", line 7, in solve
ValueError: operands_could_not_be_broadcast_{"together_" * 20}"""


@pytest.fixture(scope="module")
def crash(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A page with a crash, and the identity of its trial."""
    (lost,) = made_on("mine", None)
    crashed = replace(lost, status=Status.CRASHED, message=TRACE)
    folder = tmp_path_factory.mktemp("crash")
    return report.write(Results([crashed, *made()]), folder / "report.html"), crashed.id


def test_a_phone_shows_the_dialog_where_a_crash_trace_is_listed(
    browser: Any, crash: tuple[Path, str]
) -> None:
    page, crashed = crash
    chromium.resize(browser, PHONE, 800, scale=2)
    browser.get(page.as_uri())
    chromium.run(
        browser,
        chromium.READY
        + """
        const traces = document.querySelectorAll('.why details');
        for (const trace of traces) trace.open = true;""",
    )
    assert chromium.run(browser, "return document.documentElement.scrollWidth") <= PHONE
    left, right = chromium.run(
        browser,
        f"""location.hash = 'trial-{crashed}';{PAUSE}
        const box = document.getElementById('trials').getBoundingClientRect();
        return [box.left, box.right]""",
    )
    assert 0 <= left < right <= PHONE
    assert chromium.run(browser, "return visualViewport.scale") == 1


def test_a_phone_does_not_scroll_sideways(browser: Any, script: Script) -> None:
    chromium.resize(browser, PHONE, 800, scale=2)
    script(PAUSE)
    assert script("return document.documentElement.scrollWidth") <= PHONE
    labels = "return getComputedStyle(document.querySelector('td[data-label]'), '::before').content"
    assert script(labels) != "none"


def test_a_long_cell_of_a_phone_does_not_overlap_the_next(browser: Any, tmp_path: Path) -> None:
    """The peak of a quintic's velocity, 15/8 h/T, is above the limit by a little."""
    limit = 15 / 8 / 2 / 1.0003
    tight = Problem([[0.0], [1.0]], Limits([limit], [100.0]), "tight")
    page = report.write(Results(made_on("mine", *[2.0] * 30, on=tight)), tmp_path / "report.html")
    assert "× 1.0003" in page.read_text(encoding="utf-8")
    chromium.resize(browser, PHONE, 800, scale=2)
    browser.get(page.as_uri())
    over = """return [...document.querySelectorAll('.cards td > a')].filter((part) =>
        part.getBoundingClientRect().right > part.parentNode.getBoundingClientRect().right + 1)
        .map((part) => part.parentNode.textContent)"""
    assert chromium.run(browser, chromium.READY + over) == []


def test_a_phone_shows_all_of_the_differences(browser: Any, open_rivals: Script) -> None:
    chromium.resize(browser, PHONE, 800, scale=2)
    open_rivals(PAUSE)
    assert open_rivals("return document.documentElement.scrollWidth") <= PHONE
    for table in ("paired-table", "ert-table"):
        edges = """return [...document.querySelectorAll(`#${args[0]} td, #${args[0]} td *`)]
            .map((e) => e.getBoundingClientRect().right)"""
        assert max(open_rivals(edges, table)) <= PHONE


def test_paper_has_the_charts_and_no_controls(browser: Any, script: Script) -> None:
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    script("window.dispatchEvent(new Event('beforeprint'));" + PAUSE)
    visible = """return [...document.querySelectorAll(args[0])].filter((e) => e.checkVisibility())
        .map((e) => e.getBoundingClientRect().width)"""
    assert script(visible, "nav, #search, #against, .suite, .modebar, dialog") == []
    assert script(visible, "#paired-table, #rival") != []
    widths = script(visible, ".chart .main-svg")
    assert len(widths) > 4
    assert max(widths) <= 690  # px: A4 less two margins of 14 mm
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
    assert base64.b64decode(printed["data"]).startswith(b"%PDF")
