"""The figure of a log: its rows against a lawful curve, or its samples about the motion found."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.benchmark.logs import LogOptions
from trajopt.core.limits import Limits
from trajopt.formats.digits import half_digits
from trajopt.formats.motion import motion
from trajopt.formats.samples import Samples
from trajopt.judgement import as_executed
from trajopt.views.figures import log, plots


def executed(limits, order=3):
    """A quintic of 1 rad in 1 s: 1.875 rad/s, 5.77 rad/s² and 60 rad/s³."""
    t = np.arange(201) / 200
    q = 10 * t**3 - 15 * t**4 + 6 * t**5
    texts = [f"{own:.5f}" for own in q]
    values = np.array(list(map(float, texts)))
    half, decimals = half_digits(texts, values)
    samples = Samples(("j",), t, values[:, None], half_digits=half[:, None], decimals=(decimals,))
    return as_executed(motion(samples), limits, log=LogOptions())


@pytest.mark.parametrize(
    "limits", [Limits([1.5], [9], [90]), Limits([3], [4], [90]), Limits([3], [9], [35])]
)
def test_the_lawful_curve_meets_all_rows_but_the_last(limits):
    found = executed(limits)
    proof, own = found.evidence.conviction, found.evidence.joints[0]
    assert len(proof.values) > 1
    curve = log._lawful(proof, own)
    off = np.abs(proof.values - curve(proof.times))
    assert off[:-1] == pytest.approx(proof.half[:-1], rel=1e-6)
    assert off[-1] > proof.half[-1]
    order = len(proof.times) - 1
    low, high = own.limits[order - 1]
    dense = curve(np.linspace(proof.start, proof.end, 9))
    rate = np.diff(dense, order) / ((proof.end - proof.start) / 8) ** order
    assert np.isclose(rate, high, rtol=1e-4).all() or np.isclose(rate, low, rtol=1e-4).all()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits([1.5], [9]), {"rows that convict: 1.2", "a curve at the velocity limit"}),
        (Limits([3], [9]), {"known to this", "samples"}),
    ],
)
def test_the_figure_says_what_it_shows(limits, words, tmp_path):
    found = executed(limits)
    figure = log.premise(found)
    (legend,) = figure.legends
    texts = {own.get_text() for own in legend.get_texts()}
    assert all(any(text.startswith(word) for text in texts) for word in words)
    assert found.evidence.verdict in figure.get_suptitle()
    assert plots.write(figure, tmp_path / "log.svg").read_bytes().startswith(b"<?xml")


def test_a_motion_that_is_no_log_has_no_such_figure():
    found = as_executed(motion(executed(Limits([3], [9])).executed), Limits([3], [9]))
    with pytest.raises(ValueError, match="no log"):
        log.premise(found)
