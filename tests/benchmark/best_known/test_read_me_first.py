"""Read me first: a best known answer is a motion and a proved bound, in a file that is checked."""

from __future__ import annotations

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.record_check import checked, proved
from trajopt.benchmark.suites.catalogue import load
from trajopt.judging.verification import verify

PROBLEM = load("one-joint")


def test_a_record_has_a_motion_and_a_bound_below_it():
    record = records.find(PROBLEM)
    assert record.lower_bound <= record.duration <= 1.001 * record.lower_bound
    assert verify(PROBLEM, record.trajectory).certified_duration <= record.duration * (1 + 1e-9)


def test_its_bound_is_proved_again_without_a_solver():
    record = records.find(PROBLEM)
    assert proved(record) >= record.lower_bound * (1 - 1e-12)


def test_a_file_that_claims_less_than_its_motion_takes_does_not_hold(tmp_path):
    honest = records.file_of(PROBLEM)
    assert not checked(honest).differences
    record = records.find(PROBLEM)
    forged = tmp_path / honest.name
    text = honest.read_text(encoding="utf-8")
    forged.write_text(text.replace(str(record.duration), str(record.duration / 2), 1))
    assert checked(forged).differences
