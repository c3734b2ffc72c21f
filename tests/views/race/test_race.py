"""The race: what is in its page, and in a browser, what a reader sees at each instant."""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import browser as chromium
import numpy as np
import pytest

from trajopt import InvalidInput, Limits, Problem, Trajectory
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load
from trajopt.views import race
from trajopt.views.figures.shown_motion import ShownMotion
from trajopt.views.race import course

PAPER = catalogue.load("six-axis")
PLANNERS = ("exact", "toppra", "ruckig-stop", "issa:iterations=20")
NASTY = '</script><img src=x onerror="document.title=1">&lt;'


def motions(problem: Problem, *planners: str) -> list[ShownMotion]:
    found = [load(name).solve(problem, seed=0).trajectory for name in planners]
    return [ShownMotion(name, name, own) for name, own in zip(planners, found, strict=True)]


@pytest.fixture(scope="module")
def runners() -> list[ShownMotion]:
    return motions(PAPER, *PLANNERS)


def data_of(html: str) -> Any:
    (packed,) = re.findall(r'class="race-data">([^<]+)<', html)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


def test_the_page_says_its_result_without_a_script(runners):
    html = race.fragment(PAPER, runners)
    text = re.sub(r"<(script|style).*?</\1>", "", html, flags=re.S)
    text = " ".join(re.sub(r"<[^>]+>", " ", text).split())
    assert "No motion takes less than 1.4837 s: that is proved." in text
    assert "exact 1.48 s A joint is at a limit 100 % of the time." in text
    assert "ruckig-stop 2.39 s +60.8 % A joint is at a limit 100 % of the time." in text
    assert "It stops at 2 of 2 waypoints on the way." in text
    for own in runners:
        assert " ".join(f"{t:.2f}" for t in own.trajectory.waypoint_times) in text


def test_it_is_small_and_needs_no_network(runners, tmp_path):
    file = race.write(PAPER, runners, tmp_path / "race.html")
    html = file.read_text(encoding="utf-8")
    assert len(html) < 60_000
    assert not re.search(r"(?:src|href)=\"(?!data:)", html)
    assert set(re.findall(r"https?://[^\"']+", html)) == {"http://www.w3.org/2000/svg"}


def test_positions_and_uses_come_back_from_the_page(runners):
    found = data_of(race.fragment(PAPER, runners))
    assert [kind["name"] for kind in found["kinds"]] == ["velocity", "acceleration"]
    for own, shown in zip(runners, found["motions"], strict=True):
        t = np.cumsum(shown["t"]) * found["tick"]
        q = np.cumsum(shown["q"], axis=1) * found["step"]
        inner = np.linspace(0, own.trajectory.duration, 500)
        seen = np.stack([np.interp(inner, t, row) for row in q], axis=1)
        np.testing.assert_allclose(seen, own.trajectory(inner), atol=2e-3)
        assert shown["passed"] == own.trajectory.waypoint_times.tolist()
        use = np.cumsum(shown["u"], axis=1).reshape(2, 6, -1)
        for own_use, limit in zip(use, PAPER.limits.kinds.values(), strict=True):
            assert own_use.max() == pytest.approx(100 * limit.worst(own.trajectory).value, abs=1)


def test_every_kind_of_limit_has_its_bars():
    arm = catalogue.load("robots-franka-fr3-w4")
    found = data_of(race.fragment(arm, motions(arm, "ruckig-stop")))
    names = {kind["name"]: kind for kind in found["kinds"]}
    assert list(names) == ["velocity", "acceleration", "position", "falling velocity"]
    assert not names["position"]["ratio"]
    (shown,) = found["motions"]
    use = np.cumsum(shown["u"], axis=1)
    assert len(use) == 4 * 7
    assert (use[14:21] >= 0).all()
    assert (use[14:21] <= 100).all()


def test_a_motion_of_thousands_of_pieces_is_as_small():
    breaks = np.linspace(0, 5, 4001)
    smooth = Trajectory.from_samples(breaks, np.sin(breaks)[:, None], np.cos(breaks)[:, None])
    problem = Problem([[0.0], [np.sin(5)]], Limits([1.1], [1.1]))
    assert len(race.fragment(problem, [ShownMotion("mine", "mine", smooth)])) < 30_000


def test_names_are_text(runners):
    html = race.fragment(replace(PAPER, name=NASTY), [runners[0]._replace(name=NASTY)])
    assert "<img" not in re.sub(r"<script.*?</script>", "", html, flags=re.S)


def test_a_name_that_looks_like_a_place_of_the_template_stays(runners):
    named = [own._replace(name="{{ script }}") for own in runners]
    text = race.fragment(PAPER, named)
    assert text.count("{{ script }}</b>") == len(named)


def test_a_motion_that_was_slowed_down_says_so():
    """1 rad at 1 rad/s² takes 2 s; claimed in 1 s it is slowed down 2 times."""
    line = Problem([[0.0], [1.0]], Limits([10.0], [1.0]))
    (optimum,) = motions(line, "exact")
    slowed = optimum._replace(name="mine", slowed=2.0)
    text = race.fragment(line, [optimum, slowed])
    assert text.count("Slowed down 2 times: as planned it breaks a limit.") == 1


def test_the_folder_of_the_page_is_made(runners, tmp_path):
    assert race.write(PAPER, runners, tmp_path / "new" / "folder" / "race.html").stat().st_size


def test_what_durations_are_compared_with(runners):
    assert course.goal(PAPER, runners).name == "the optimum"
    other = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "mine")
    found = course.goal(other, motions(other, "ruckig-stop", "exact"))
    assert (found.name, found.duration) == ("the shortest here", pytest.approx(2.0))
    assert found.said == "The shortest of these within the limits takes 2.0000 s."
    with pytest.raises(InvalidInput, match="motions: expected at least one"):
        race.fragment(PAPER, [])


def test_an_arm_is_inside_its_picture_and_stands_on_the_left(runners):
    for name in ("six-axis", "robots-kinova-gen3-w4", "robots-abb-irb-120-w8"):
        problem = catalogue.load(name)
        links = data_of(race.fragment(problem, motions(problem, "ruckig-stop")))["chain"]
        chain = catalogue.chain(problem)
        seen = course.points(chain, problem.waypoints) @ np.array(links["view"]).T
        low, high = np.array(links["box"]).reshape(2, 2)
        assert (seen > low).all()
        assert (seen < high).all()
        assert seen[..., 0].mean() > 0


def test_what_a_page_cannot_check_it_names():
    """A jerk limit on one side only has no bar; one near the ends of ranges is no interval."""
    sided = Problem([[0.0], [1.0]], Limits([1.0], [1.0], jerk=[[-np.inf, 50.0]]), least_duration=3)
    plain = motions(sided.without("jerk", "least_duration"), "exact")
    found = data_of(race.fragment(sided, plain))
    assert found["left_out"] == ["jerk limits", "least duration"]
    arm = catalogue.load("robots-franka-fr3-w4")
    found = data_of(race.fragment(arm, motions(arm, "ruckig-stop")))
    assert found["left_out"] == ["falling velocity limits"]


# --- in a browser ---

LOOK = """
const slider = document.querySelector(".race-time");
const at = (t) => { slider.value = t; slider.dispatchEvent(new Event("input")); };
const lanes = [...document.querySelectorAll(".race-lane")];
const pair = (text) => text.split(",").map(Number);
const points = (line) => line.getAttribute("points").split(" ").map(pair);
"""
READY = """while (!document.querySelector('.race').dataset.ready)
    await new Promise((go) => setTimeout(go, 20));"""
FIRST_PASSED = (
    LOOK
    + """
const first = lanes.map((lane) => [...lane.querySelectorAll("li")].map(() => [null, null]));
for (let k = 0; k <= Math.round(100 * slider.max); k += 1) {
    at(k / 100);
    lanes.forEach((lane, i) => [".passed", "circle.passed"].forEach((name, kind) => {
        const passed = lane.querySelectorAll((kind ? "" : "li") + name).length;
        for (let n = 0; n < passed; n += 1) first[i][n][kind] ??= k / 100;
    }));
}
return first;"""
)
STATE = (
    LOOK
    + """
at(args[0]);
return lanes.map((lane) => ({
    said: lane.querySelector(".race-status").textContent,
    bars: [...lane.querySelectorAll(".race-bar i")].map((bar) => parseFloat(bar.style.width)),
    full: [...lane.querySelectorAll(".race-bar")].map((bar) => bar.classList.contains("full")),
    tip: points(lane.querySelector(".link")).at(-1),
}));"""
)


@pytest.fixture
def page(browser: Any, runners: list[ShownMotion], tmp_path_factory: Any) -> Path:
    file = race.write(PAPER, runners, tmp_path_factory.mktemp("race") / "race.html")
    browser.set_script_timeout(30)
    chromium.resize(browser, 390, 800)
    browser.get_log("browser")
    browser.get(file.as_uri())
    chromium.run(browser, READY)
    return file


def test_a_reader_sees_each_waypoint_passed_when_it_is(browser: Any, page: Path, runners) -> None:
    """To the 10 ms of the slider, in the list and in the picture; offline; on a phone."""
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    # readers who asked for less motion get a still picture
    assert (
        browser.execute_script("return document.querySelector('.race-play').textContent") == "Play"
    )
    found = chromium.run(browser, FIRST_PASSED)
    for own, first in zip(runners, found, strict=True):
        expected = np.ceil(100 * own.trajectory.waypoint_times - 1e-6) / 100
        np.testing.assert_allclose(first, np.stack([expected, expected], axis=1), atol=1e-9)


def test_the_arm_and_its_bars_are_the_motion_s(browser: Any, page: Path, runners) -> None:
    links = data_of(page.read_text(encoding="utf-8"))["chain"]
    low, high = np.array(links["box"]).reshape(2, 2)
    scale = 300 / (high - low).max()
    chain = catalogue.chain(PAPER)
    for t in (0.0, 0.37, 0.72, 1.2):
        state = chromium.run(browser, STATE, t)
        for own, shown in zip(runners, state, strict=True):
            motion = own.trajectory
            tip = chain.forward(motion(t))[:3, 3]
            np.testing.assert_allclose(
                shown["tip"], (np.array(links["view"]) @ tip - low) * scale, atol=0.4
            )
            along = [own.along(motion, np.array([t])) for own in PAPER.limits.kinds.values()]
            use = np.array([own[joint][0] for joint in range(6) for own in along])
            widths = np.array(shown["bars"])
            assert shown["full"] == (widths >= 99.5).tolist()
            np.testing.assert_allclose(widths, np.minimum(100, 100 * use), atol=2.5)
            passed = int((motion.waypoint_times <= t).sum())
            assert shown["said"].endswith(f"waypoint {passed} of 4")
    end = chromium.run(browser, STATE, 100)
    assert end[0]["said"] == "Arrived"
    assert end[2]["said"] == "Arrived, 60.8\N{NO-BREAK SPACE}% above the optimum"


def test_play_pauses_and_says_who_arrived(browser: Any, page: Path) -> None:
    said = chromium.run(
        browser,
        """
        const play = document.querySelector(".race-play");
        const slider = document.querySelector(".race-time");
        const wait = (ms) => new Promise((go) => setTimeout(go, ms));
        slider.value = slider.max - .2; slider.dispatchEvent(new Event("input"));
        play.click();
        const names = [play.textContent];
        while (play.textContent === "Pause") await wait(20);
        names.push(play.textContent, document.querySelector("[role=status]").textContent);
        play.click();
        while (["0", slider.max].includes(slider.value)) await wait(5);
        play.click();
        return [...names, play.textContent, Number(slider.value)];""",
    )
    assert said[:2] == ["Pause", "Again"]
    assert said[2].startswith("All have arrived: exact 1.48 s, toppra 1.61 s")
    assert said[3] == "Play"
    assert said[4] > 0


def test_an_unknown_arm_has_a_dial_per_joint(browser: Any, tmp_path: Path) -> None:
    problem = Problem([[0.0, 0.5], [1.0, -1.0]], Limits([1.0, 2.0], [1.0, 2.0]), "mine")
    runner = motions(problem, "ruckig-stop")
    browser.get(race.write(problem, runner, tmp_path / "r.html").as_uri())
    chromium.run(browser, READY)
    hands = chromium.run(
        browser,
        LOOK + "at(0.5); return [...document.querySelectorAll('.link')].map(points)",
    )
    motion = runner[0].trajectory
    for joint, (centre, end) in enumerate(hands):
        angle = np.arctan2(end[0] - centre[0], centre[1] - end[1])
        assert angle == pytest.approx(motion(0.5)[joint], abs=2e-3)


# --- a motion of the reader's own ---

NAMES = [f"joint {joint + 1}" for joint in range(6)]


def csv_of(motion: Trajectory, orders: int, factor: float = 1.0) -> str:
    """Samples at the breaks and in each piece's middle; pieces of degree 2 orders − 1 join them."""
    t = np.sort(np.concatenate([motion.breaks, motion.breaks[:-1] + motion.lengths / 2]))
    heads = ["time [s]", *(f"{n} [rad{r}]" for r in ("", "/s", "/s^2")[:orders] for n in NAMES)]
    tables = [motion(t, order) * factor**order for order in range(orders)]
    rows = np.column_stack([t / factor, *tables])
    return "\n".join([",".join(heads), *(",".join(map(repr, map(float, row))) for row in rows)])


def dropped(browser: Any, folder: Path, text: str) -> str:
    file = folder / "mine.csv"
    file.write_text(text, encoding="utf-8")
    browser.find_element("css selector", ".race-yours input").send_keys(str(file))
    said: str = chromium.run(
        browser,
        """const said = document.querySelector("[role=status]");
        for (let k = 0; k < 200 && !said.textContent; k += 1)
            await new Promise((go) => setTimeout(go, 20));
        const text = said.textContent; said.textContent = ""; return text;""",
    )
    return " ".join(said.split())


def test_a_motion_of_one_s_own_is_checked_by_its_exact_peaks(browser, page, runners, tmp_path):
    """Ruckig's motion: cubic pieces through its breaks are itself."""
    ruckig = runners[2].trajectory
    said = dropped(browser, tmp_path, csv_of(ruckig, 2))
    assert said.startswith("mine.csv: 2.3865 s, 60.83 % above the optimum. Its cubic pieces")
    assert "keep every limit that this page knows: exact peak 100.00 %, acceleration of" in said
    assert said.endswith("trajopt judge mine.csv six-axis certifies it.")
    state = chromium.run(browser, STATE, 1.2)
    assert len(state) == len(runners) + 1
    assert state[-1]["tip"] == pytest.approx(state[2]["tip"], abs=0.2)
    assert state[-1]["bars"] == pytest.approx(state[2]["bars"], abs=3)
    assert state[-1]["said"].endswith("waypoint 2 of 4")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            lambda motion: csv_of(motion, 2, factor=1.1),
            "It uses 121.00 % of the acceleration limit of joint",
        ),
        (lambda motion: csv_of(motion, 2, factor=2), "19.59 % below the optimum. It uses 400.00 %"),
        (lambda motion: csv_of(motion, 1), "joins its samples with straight lines"),
        (lambda motion: csv_of(motion, 2).rsplit("\n", 3)[0], "misses waypoint 4 by 0."),
        (lambda motion: csv_of(motion, 2).replace("[rad]", "[cm]"), "is not read here"),
        (lambda motion: "time [s]\n0\n1", "it has not a column per joint (6)"),
        (lambda motion: "", "its header is not"),
        (lambda motion: csv_of(motion, 2).replace("\n0.0,", "\n9.0,"), "do not increase"),
    ],
)
def test_what_the_page_cannot_certify_it_says(browser, page, runners, tmp_path, change, expected):
    said = dropped(browser, tmp_path, change(runners[2].trajectory))
    assert expected in said
    assert said.endswith("Not certified here: run trajopt judge mine.csv six-axis")
    if "121" in expected:  # (1.1)² of the accelerations
        assert "Slowed down 1.1000 times, to 2.3865 s, its peaks are within these limits." in said


@pytest.mark.parametrize("seed", range(4))
def test_peaks_between_samples_are_those_of_the_verifier(browser, tmp_path, seed):
    """Quintic pieces between few samples peak far from them; limits of every order and sign."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(np.r_[0, rng.uniform(0.2, 1, 5)])
    tables = rng.normal(size=(3, 6, 2))
    tables[1:, [0, -1]] = 0
    motion = Trajectory.from_samples(t, *tables, waypoint_times=t[[0, 2, 5]])
    pairs = rng.uniform(0.5, 2, (3, 2, 2)) * [-1, 1] * np.array([20, 300, 9000])[:, None, None]
    limits = Limits(*pairs, position=np.tile([-9.0, 12.0], (2, 1)))
    problem = Problem(tables[0, [0, 2, 5]], limits, "made")
    page = race.write(problem, [ShownMotion("a", "a", motion)], tmp_path / "r.html")
    browser.get(page.as_uri())
    chromium.run(browser, READY)
    heads = [f"{n} [rad{r}]" for r in ("", "/s", "/s^2") for n in problem.joint_labels]
    rows = np.column_stack([t, *tables])
    lines = [",".join(["time [s]", *heads]), *(",".join(map(repr, map(float, r))) for r in rows)]
    said = dropped(browser, tmp_path, "\n".join(lines))
    uses = {key: limit.worst(motion) for key, limit in limits.kinds.items() if limit.is_ratio}
    key, use = max(uses.items(), key=lambda item: item[1].value)
    share = f"{100 * use.value:.2f} %"
    where = f"joint {use.joint + 1}"
    if use.value > 1:
        slower = max(own.value ** (1 / limits.kinds[k].degree) for k, own in uses.items())
        assert f"It uses {share} of the {key} limit of {where}, at {use.time:.3f} s." in said
        assert f"Slowed down {slower:.4f} times" in said
    else:
        assert f"exact peak {share}, {key} of {where} at {use.time:.3f} s" in said
