"""Read me first: a best known answer is a motion and a proved bound, in a file that is checked."""

from __future__ import annotations

from trials import forged

from trajopt.benchmark.best_known import records
from trajopt.benchmark.store.proofs import proved
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites.catalogue import load
from trajopt.judging.verification import verify

PROBLEM = load("one-joint")


def test_a_record_has_a_motion_and_a_bound_below_it():
    record = records.find(PROBLEM)
    assert record.lower_bound <= record.duration <= 1.001 * record.lower_bound
    assert verify(PROBLEM, record.trajectory).certified_duration <= record.duration * (1 + 1e-9)


def test_its_bound_is_proved_again_without_a_solver():
    record = records.find(PROBLEM)
    assert proved(record.trial) >= record.lower_bound * (1 - 1e-12)


def test_a_record_is_a_trials_text_and_a_forged_one_does_not_hold(tmp_path):
    honest = records.file_of(PROBLEM)
    assert verification(honest).holds

    def claim_half(table):
        table["certificate"]["duration"] /= 2

    file = tmp_path / honest.name
    file.write_bytes(forged(honest.read_bytes(), claim_half))
    assert not verification(file).holds
