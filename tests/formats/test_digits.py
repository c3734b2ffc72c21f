"""Digits are read from the text: trailing zeros count, whatever the notation."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.formats import joint_trajectory, samples_csv
from trajopt.formats.digits import half_digits

SMOOTH = np.sin(np.linspace(0, 1.5, 301))


def column(values, form):
    texts = [form(value) for value in values]
    return texts, np.array(list(map(float, texts)))


@pytest.mark.parametrize(
    ("form", "half"),
    [
        ("%.4f".__mod__, lambda q: 5e-5),
        (lambda q: repr(round(float(q), 4)), lambda q: 5e-5),  # trailing zeros removed
        ("%.3e".__mod__, lambda q: 5e-4 * 10 ** np.floor(np.log10(q))),
        ("%.5g".__mod__, lambda q: 5e-5 * 10 ** np.floor(np.log10(q))),
    ],
)
def test_no_number_is_farther_from_what_was_written_than_half_a_digit(form, half):
    texts, values = column(SMOOTH, form)
    found, _ = half_digits(texts, values)
    assert (np.abs(values - SMOOTH) <= found * (1 + 1e-9)).all()
    expected = half(np.maximum(SMOOTH, 1e-9)) * np.ones(len(found))
    assert np.median(found / expected) == pytest.approx(1)


def read(tmp_path, lines, header="time [s],q [deg]"):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *lines]) + "\n")
    return samples_csv.read(path)


def test_digits_of_a_log_in_the_unit_of_its_column(tmp_path):
    samples = read(tmp_path, [f"{0.002 * i:.3f},{np.degrees(q):.3f}" for i, q in enumerate(SMOOTH)])
    assert samples.decimals == (3,)
    assert np.allclose(samples.half_digits, np.radians(0.5e-3))
    assert samples.time_half_digit == 0  # every second one of the last digit's units: exact


@pytest.mark.parametrize(
    ("times", "half"),
    [
        ([f"{i / 60:.3f}" for i in range(50)], 5e-4),
        ([f"{i / 60:.6f}" for i in range(50)], 5e-7),
        ([f"{0.004 * i:.4f}" for i in range(50)], 0),
        ([repr(0.001 * i) for i in range(50)], 0),
        ([repr(i / 30) for i in range(50)], 0),
        ([f"{1700000000 + i / 60:.4f}" for i in range(50)], 5e-5),
        (["0", "0.002", "0.006", "0.010"], 0),  # a sample is missing
    ],
)
def test_rounded_times_and_times_on_a_grid(tmp_path, times, half):
    lines = [f"{time},{i}" for i, time in enumerate(times)]
    with pytest.warns(UserWarning, match="times count") if float(times[0]) else nothing():
        samples = read(tmp_path, lines)
    assert samples.time_half_digit == pytest.approx(half, abs=0)


def nothing():
    from contextlib import nullcontext

    return nullcontext()


def test_digits_of_a_message():
    points = [
        {"positions": [0.1234, i / 2], "time_from_start": {"sec": i, "nanosec": 0}}
        for i in range(5)
    ]
    samples = joint_trajectory.from_message({"joint_names": ["a", "b"], "points": points})
    assert samples.decimals == (4, 1)
    assert samples.half_digits[0].tolist() == pytest.approx([5e-5, 5e-2])
