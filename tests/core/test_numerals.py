"""Numbers as text: what looks like one is that one, everything else is refused."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.core.numerals import decimal, rounded_down, whole

reproducible = settings(deadline=None, derandomize=True, max_examples=100)


@reproducible
@given(st.integers(-(10**40), 10**40))
def test_whole_numbers_are_themselves(number):
    assert whole(str(number)) == number
    assert whole(f"{number:+d}") == number


@reproducible
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_decimals_are_themselves(number):
    assert decimal(repr(number)) == number


@pytest.mark.parametrize(
    ("text", "value"),
    [("7", 7.0), ("+.5", 0.5), ("2.", 2.0), ("1e3", 1000.0), ("-1E-3", -0.001), ("007", 7.0)],
)
def test_the_usual_ways_to_write_a_decimal(text, value):
    assert decimal(text) == value


OTHER = ["", " ", "1_000", "0x10", "0b1", "1,5", "1 000", "٣", "²", "--1", "+-1", "1e", "e3", "."]


@pytest.mark.parametrize("text", [*OTHER, "nan", "inf", "-inf", "Infinity", "1e999", "True", "1j"])
def test_other_text_is_no_decimal(text):
    with pytest.raises(ValueError, match="is not a finite number"):
        decimal(text)


@pytest.mark.parametrize("text", [*OTHER, "1.5", "1.0", "1e3", "nan", "True", "9" * 401])
def test_other_text_is_no_whole_number(text):
    with pytest.raises(ValueError, match="is not a whole number"):
        whole(text)


@reproducible
@given(
    st.floats(1e-9, 1e9),
    st.sampled_from([".4f", ".6f", ".9f", ".5g", ".6g", ".9g", "#.4g"]),
)
def test_a_printed_bound_is_no_larger_than_the_bound(bound, spec):
    printed = float(rounded_down(bound, spec))
    assert printed <= bound
    assert printed == pytest.approx(bound, rel=1e-3, abs=1e-4)


def test_a_bound_whose_nearest_decimal_is_larger_is_rounded_down():
    assert rounded_down(1.4837786, ".6f") == "1.483778"
    assert rounded_down(2.0, ".6g") == "2"
    assert rounded_down(float("nan"), ".6g") == "nan"
    assert rounded_down(float("inf"), ".6g") == "inf"
