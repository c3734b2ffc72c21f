"""Every table of numbers that a page prints is a stored output, which says of which code it is."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
STORED = ROOT / "experiments" / "stored"
# Of docs/literature.md another test asks the same (`test_stored_numbers`).
DOCS = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs").glob("*.md"))]
PAGES = [
    *("README.md", "experiments/README.md", "tests/soaks/README.md"),
    *(page for page in DOCS if "literature" not in page),
]
# A table, and the line below it that says where its numbers are stored and of which code they are.
TABLE = re.compile(
    r"^((?:\|.*\n)+)(?:\n\[Stored\]\((?P<file>[\w/.-]+\.csv)\), of code (?P<code>.*)\.\n)?", re.M
)
# What a command printed, word for word, and the same line.
PRINTED = re.compile(
    r"^```\n(.*?)^```\n(?:\n\[Stored\]\((?P<file>[\w/.-]+\.txt)\), of code (?P<code>[^\n]*)\.\n)?",
    re.M | re.S,
)
NUMBER = re.compile(r"\**[+−<≤]? ?\d")
COMMIT = re.compile(r"[0-9a-f]{7,40}")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().removeprefix("|").removesuffix("|").split("|")]


def rows(table: str) -> list[list[str]]:
    """The heading and the rows, without the line between them."""
    heading, _, *body = table.splitlines()
    return [cells(line) for line in (heading, *body)]


def holds_numbers(table: str) -> bool:
    """Whether half of what some column says begins with a number; the first one has names."""
    _, *body = rows(table)
    columns = [[cell for cell in column if cell] for column in zip(*body, strict=True)]
    return any(
        2 * sum(bool(NUMBER.match(cell)) for cell in column) >= len(column)
        for column in columns[1:]
        if column
    )


def tables(page: str) -> list[re.Match[str]]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return [found for found in TABLE.finditer(text) if "---" in found[1]]


def stored(file: Path) -> tuple[dict[str, str], list[list[str]]]:
    """What the first lines say of the command and the day, and the table itself."""
    lines = file.read_text(encoding="utf-8").splitlines()
    said = dict(line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# "))
    return said, list(csv.reader(line for line in lines if not line.startswith("# ")))


@pytest.mark.parametrize("page", PAGES)
def test_a_table_of_numbers_is_the_stored_one_and_names_its_code(page):
    for found in tables(page):
        shown = rows(found[1])
        if not holds_numbers(found[1]):
            continue
        assert found["file"], f"{page}: nothing is stored of the table of {shown[0]}"
        _, kept = stored((ROOT / page).parent / found["file"])
        assert [row[:-1] for row in kept] == shown
        commits = [row[-1] for row in kept[1:]]
        assert all(map(COMMIT.fullmatch, commits))
        assert found["code"].split(", ") == list(dict.fromkeys(commits))


def column(name: str, heading: str) -> dict[str, str]:
    """A column of a stored table, by the first cell of each row."""
    _, kept = stored(STORED / f"{name}.csv")
    place = kept[0].index(heading)
    return {row[0]: row[place] for row in kept[1:]}


def prose(*pages: str) -> str:
    """Return the text of these pages with one space between words."""
    texts = [(ROOT / page).read_text(encoding="utf-8") for page in pages]
    return " ".join(" ".join(texts).split())


def test_the_numbers_of_sentences_are_those_of_the_tables():
    text = prose("README.md", "docs/six-axis.md", "docs/limitations.md")
    family = column("families", "six-axis")
    times = {name: f"{1 + float(percent) / 100:.2f}" for name, percent in family.items()}
    assert (
        f"the best 4-3-4 takes {times['4-3-4']} times the optimum, cubics {times['cubic']}, "
        f"quintics {times['quintic, 5-5-5']}, septics {times['septic, 7-7-7']}"
    ) in text
    untuned = column("paper-readings-pso", "takes, s")["shared times"]
    assert f"PSO comes last ({untuned} s)" in text
    suites = column("certificates", "problems")["all"]
    closed = column("certificates", "closed")["all"]
    widest = column("certificates", "largest gap, %")["random"]
    assert f"{closed} of the {suites} suite problems are proved within 0.1 %" in text
    assert f"with jerk limits) to {widest} %" in text
    assert f"for each of {suites} problems" in text
    assert f"{closed} are closed" in text
    scaling = stored(STORED / "scaling.csv")[1]
    heading = scaling[0]
    jerk = next(row for row in scaling if row[0] == "`exact-jerk`")
    of_50 = jerk[heading.index("50")]
    of_300 = jerk[heading.index("300")]
    assert f"takes {of_50} s for 50 waypoints × 7 joints and {of_300} s for 300" in text
    documented = next(
        row for row in stored(STORED / "rivals.csv")[1] if row[:2] == ["`toppra`", "documented"]
    )
    assert f"its authors' own gives +{documented[2]} %" in text
    study = {row[0]: row[2] for row in stored(STORED / "paper-study.csv")[1]}
    claimed, certified = re.match(r"([\d.]+).*; ([\d.]+)", study["ISSA"]).groups()
    assert f"claim {float(claimed):.2f} s" in text
    assert f"certify at {float(certified):.2f} s" in text


def test_the_arena_says_what_its_tables_show():
    text = prose("docs/arena.md")
    _, (heading, *body) = stored(STORED / "arena.csv")
    columns = {name: [row[i] for row in body] for i, name in enumerate(heading)}
    names = [name.strip("*") for name in columns["optimiser"]]
    own = [name for name in names if " " not in name]
    assert sorted(own) == ["cmaes", "de", "issa", "pso", "ssa"]
    assert f"{len(names) - len(own)} metaheuristics against the optimum" in text
    always = columns["within 1 %"].count("100 %")
    assert f"{always} of the {len(names)} optimisers are within 1 % of the optimum in every" in text
    shares = [int(share.split()[0]) for share in columns["within 1e-6"]]
    some = sum(share > 0 for share in shares)
    assert f"{some} come within 1e-6 in some run, none in more than {max(shares)} % of" in text
    gaps = medians(columns["median gap"])
    counts = [sum(gap <= percent for gap in gaps) for percent in (0.1, 1)]
    assert "In the median run {} are within 0.1 % and {} within 1 %".format(*counts) in text
    assert f"half of them end {sorted(gaps)[len(gaps) // 2]:.2f} % above" in text
    for name in own:
        assert columns["median gap"][names.index(name)] in text
    random = gaps[names.index("pymoo RandomSearch")]
    worse = sum(gap > random for gap in gaps)
    assert f"ends {random:.4f} % above the optimum: {worse} of the others end farther" in text
    groups = columns["group"]
    assert f"{max(map(int, groups))} groups differ" in text
    for name in own:
        assert f"{groups[names.index(name)]}th" in text

    _, (heading, *body) = stored(STORED / "arena-others.csv")
    columns = {name: [row[i] for row in body] for i, name in enumerate(heading)}
    others = [name.strip("*") for name in columns["optimiser"]]
    assert sorted(others) == sorted(names)
    every = [others[i] for i, share in enumerate(columns["within 1 %"]) if share == "100 %"]
    only = "`{}` and `{}` are the only ones within 1 % in every one of 50 runs".format(
        *(name.split()[-1] for name in every)
    )
    assert only in text
    assert f"the first of {columns['group'][-1]} groups" in text
    for name in own:
        assert f"`{name}` in the {columns['group'][others.index(name)]}th" in text.replace(
            " is", ""
        )
    on_robots = [medians(columns[name]) for name in ("UR5e", "Panda", "KR6", "Puma", "IRB 120")]
    halves = sorted(sorted(own)[len(own) // 2] for own in on_robots)
    easiest = f"on the easiest one half of the optimisers end {halves[0]:.2f} % above"
    assert easiest in text
    assert f"on the hardest one {halves[-1]:.2f} %" in text
    random = others.index("pymoo RandomSearch")
    worse = [sum(gap > own[random] for gap in own) for own in on_robots]
    assert f"on each at least {min(worse)} end farther from it than random search" in text

    _, (_, *body) = stored(STORED / "arena-nevergrad.csv")
    gaps = medians([gap for _, gap, _ in body])
    within = "{} came within 0.1 %, {} within 1 %".format(
        *(sum(gap <= percent for gap in gaps) for percent in (0.1, 1))
    )
    half = sorted(gaps)[len(gaps) // 2]
    ran = f"{len(body)} ran once with 1,000 evaluations: {within}, and half end {half:.2f} % above"
    assert ran in text
    assert f"{sum(np.isinf(gaps))} need packages" in text
    _, (heading, *body) = stored(STORED / "arena-nevergrad-best.csv")
    groups = {row[0].strip("*"): row[heading.index("group")] for row in body}
    first = " and ".join(f"`{name.split()[-1]}`" for name, group in groups.items() if group == "1")
    assert f"{first} come within 0.1 % in every one, and form the first of" in text
    assert f"of {max(groups.values())} groups, `cmaes` is in the {groups['cmaes']}th" in text
    assert f"The {len(body) - len(own)} have ten runs each" in text

    _, (heading, *body) = stored(STORED / "arena-10000.csv")
    columns = {name: [row[i] for row in body] for i, name in enumerate(heading)}
    every = columns["within 1e-6"].count("100 %")
    assert f"{every} of {len(body)} come within 1e-6 in every run" in text
    gaps = medians(columns["median gap"])
    counts = [sum(gap <= percent for gap in gaps) for percent in (0.1, 1)]
    assert "{} are within 0.1 % in the median run, and {} within 1 %".format(*counts) in text
    assert f"{sorted(gaps)[len(gaps) // 2]:.2f} % above the optimum or more" in text
    groups = {row[0].strip("*"): row[heading.index("group")] for row in body}
    assert f"the first of {body[-1][heading.index('group')]} groups" in text
    assert (
        "`de` is in the {de}nd, `pso` in the {pso}th, `issa` in the {issa}th".format(**groups)
        in text
    )
    random = gaps[list(groups).index("pymoo RandomSearch")]
    worse = sum(gap > random for gap in gaps)
    assert f"{worse} farther from it than random search, which ends {random:.4f} %" in text

    _, (heading, *body) = stored(STORED / "arena-others-10000.csv")
    columns = {name: [row[i] for row in body] for i, name in enumerate(heading)}
    always = [columns[f"within {share}"].count("100 %") for share in ("1e-6", "0.1 %")]
    shares = "{} of {} come within 1e-6 in every one of 50 runs, and {} within 0.1 %"
    assert shares.format(always[0], len(body), always[1]) in text
    groups = {row[0].strip("*"): row[heading.index("group")] for row in body}
    assert f"Thirteen form the first of {columns['group'][-1]} groups" in text
    assert columns["group"].count("1") == 13
    assert groups["cmaes"] == groups["de"] == "1"
    assert "`pso` is in the {pso}th, `ssa` and `issa` are in the {ssa}th".format(**groups) in text
    assert groups["ssa"] == groups["issa"]


def medians(cells: list[str]) -> list[float]:
    """Return the gaps of a column in percent; infinite where there is none."""
    return [float(cell.split()[0].replace("–", "inf")) for cell in cells]


def test_the_readme_counts_published_times_as_their_page_does():
    page = prose("docs/literature.md")
    times, sources = re.search(r"(\d+) published numbers \(of (\d+) sources\)", page).groups()
    assert f"{times} published running times of {sources} sources" in prose("README.md")


def test_the_smoothness_is_what_explain_prints():
    text = prose("docs/six-axis.md")
    printed = (STORED / "six-axis-explained.txt").read_text(encoding="utf-8")
    optimum = float(re.search(r"best known optimum, ([\d.]+) s", printed)[1])
    smoothness = float(re.search(r"its smoothness ([\d.]+) %", printed)[1])
    assert f"the same jerk would need {optimum * (1 + smoothness / 100):.2f} s" in text


@pytest.mark.parametrize("page", ["README.md", "docs/six-axis.md", "docs/commands.md"])
def test_what_a_page_prints_of_a_command_is_stored(page):
    blocks = re.split(r"^```(?=\w)", (ROOT / page).read_text(encoding="utf-8"), flags=re.M)
    rest = "".join([blocks[0], *(block.split("\n```\n", 1)[1] for block in blocks[1:])])
    for found in PRINTED.finditer(rest):
        assert found["file"], f"nothing is stored of {found[1]}"
        file = (ROOT / page).parent / found["file"]
        head, _, text = file.read_text(encoding="utf-8").partition("\n\n")
        said = dict(line.removeprefix("# ").split(": ", 1) for line in head.splitlines())
        assert said.keys() == {"command", "date", "commit"}
        assert text == found[1]
        assert COMMIT.fullmatch(said["commit"])
        assert said["commit"] == found["code"]


@pytest.mark.parametrize("file", sorted(STORED.glob("*.csv")), ids=lambda file: file.stem)
def test_a_stored_table_names_its_command_and_its_day_and_is_printed(file):
    said, kept = stored(file)
    assert said.keys() == {"command", "date"}
    assert re.fullmatch(r"20\d\d-\d\d-\d\d", said["date"])
    assert kept[0][-1] == "commit"
    module = re.match(r"python -m (experiments[.\w]+)", said["command"])
    soak = re.match(r"python tests/soak.py (\w+)", said["command"])
    if module:
        path = module[1].replace(".", "/")
        assert (ROOT / f"{path}.py").is_file()
    elif soak:
        assert (ROOT / "tests" / "soaks" / f"{soak[1]}.py").is_file()
    else:
        assert said["command"].startswith("trajopt ")
    assert any(
        found["file"] and found["file"].endswith(f"stored/{file.name}")
        for page in PAGES
        for found in tables(page)
    )


def test_a_table_of_numbers_is_told_from_one_of_words():
    """A table of numbers that names no stored output cannot pass for one of words."""
    numbers = "| planner | gap |\n|---|---|\n| a | +0.1 % |\n| b | none |\n"
    words = "| planner | what it is |\n|---|---|\n| a | 1000 intervals |\n| b | a |\n| c | b |\n"
    assert holds_numbers(numbers)
    assert not holds_numbers(words)
