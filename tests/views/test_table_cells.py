"""The cells of tables: no number that says something else than what was found."""

from math import inf, nan

import pytest

from trajopt.views import table_cells
from trajopt.views.report.lines import _share


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (0.0, "alone"),
        (inf, "none"),
        (nan, "–"),
        (1e-6, "1.0e-06"),
        (6e-5, "0.0001"),
        (2.0, "2.0000"),
    ],
)
def test_a_ratio_is_never_printed_as_zero(ratio, said):
    assert table_cells.ratio(ratio) == said


def test_a_single_run_has_no_interval():
    assert _share(1, 1) == {"text": "100 %", "interval": "", "value": 1.0}
    assert _share(2, 2)["interval"] == "34–100"  # Wilson: 2 / (2 + 1.96²)
