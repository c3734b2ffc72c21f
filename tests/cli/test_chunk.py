"""`trajopt chunk`: files of several chunks, bad ones among them, states, and what is written."""

import json

import numpy as np
import pytest

from trajopt.benchmark.suites.chunks import targets

LIMITS = """
joint_limits:
  a: {max_velocity: 2.0, max_acceleration: 10.0}
  b: {max_velocity: 2.0, max_acceleration: 10.0}
"""


def table(rows, chunk=0):
    return "".join(
        f"{chunk},{number / 30:.6f},{a:.6f},{b:.6f}\n" for number, (a, b) in enumerate(rows)
    )


HEADER = "chunk,time [s],a [rad],b [rad]\n"
SMOOTH = targets("smooth", 0, 12, 2)


def test_a_bad_chunk_gets_a_line_and_the_others_go_on(run):
    broken = SMOOTH.copy()
    broken[3, 1] = np.nan
    text = HEADER + table(SMOOTH) + table(broken, 1) + table(SMOOTH[:1], 2) + table(SMOOTH, 3)
    code, out, err = run("chunk c.csv --limits l.yaml --json", c__csv=text, l__yaml=LIMITS)
    assert code == 2, err
    told = json.loads(out)["chunks"]
    assert [own["chunk"] for own in told] == ["chunk-0", "chunk-1", "chunk-2", "chunk-3"]
    assert [bool(own.get("certified_duration")) for own in told] == [True, False, False, True]
    assert "column 4" in told[1]["error"]
    assert "two lines" in told[2]["error"]


def test_arrays_with_an_axis_for_chunks(run, tmp_path):
    both = np.array([SMOOTH, targets("noisy", 0, 12, 2)])
    np.savez(tmp_path / "c.npz", action=both, joint_names=["b", "a"])
    code, out, err = run("chunk c.npz --limits l.yaml --rate 30", l__yaml=LIMITS)
    assert code == 0, err
    assert out.count("certified") == 2
    code, out, err = run("chunk c.npz --limits l.yaml", l__yaml=LIMITS)
    assert code == 2
    assert "a rate" in " ".join((out + err).split())


def test_size_cuts_an_episode(run):
    text = HEADER + table(SMOOTH)
    code, out, err = run("chunk c.csv --limits l.yaml --size 5 --json", c__csv=text, l__yaml=LIMITS)
    assert code == 0, err
    counts = [len(own["waypoint_times"]) for own in json.loads(out)["chunks"]]
    assert counts == [5, 5, 2]


def test_a_chunk_takes_over_from_a_motion(run):
    text = HEADER + table(SMOOTH)
    code, _, err = run("chunk c.csv --limits l.yaml --out m.json", c__csv=text, l__yaml=LIMITS)
    assert code == 0, err
    code, _, err = run(
        "chunk c.csv --limits l.yaml --from m.json --at 0.1 --out n.json --json",
        c__csv=text,
        l__yaml=LIMITS,
    )
    assert code == 0, err
    from trajopt.formats.motion import motion

    before, after = motion("m.json").trajectory, motion("n.json").trajectory
    for order in (0, 1):
        assert after(0.0, order) == pytest.approx(before(0.1, order), abs=1e-7)


@pytest.mark.parametrize(
    ("flags", "said"),
    [("--start-velocity 1", "2 numbers"), ("--on-to-next --end-velocity 0,0", "not both")],
)
def test_states_that_do_not_fit(run, flags, said):
    text = HEADER + table(SMOOTH)
    code, out, err = run(f"chunk c.csv --limits l.yaml {flags}", c__csv=text, l__yaml=LIMITS)
    assert code == 2
    assert said in " ".join((out + err).split())


def test_verify_shows_a_line_for_each_episode(run, tmp_path):
    import h5py

    rows = targets("anchored", 0, 40, 14)
    with h5py.File(tmp_path / "episode_0.hdf5", "w") as file:
        file["action"] = rows
        file["observations/qpos"] = rows
    code, out, err = run("verify episode_0.hdf5 --robot aloha --rate 50 --json")
    assert code == 1, err
    (told,) = json.loads(out)["episodes"]
    assert told["episode"] == "episode_0"
    size, _, at = told["steps"][0]
    jumps = np.abs(np.diff(rows, axis=0))
    arms = [joint for joint in range(14) if joint % 7 != 6]  # without the grippers
    assert size == pytest.approx(jumps[:, arms].max())
    assert at == pytest.approx((jumps[:, arms].max(axis=1).argmax() + 1) / 50)
    # a target that is held is a step from rest to rest: 2 √(h/a) with ALOHA's 5 rad/s²
    share, _, when = told["held"][0]
    assert share == pytest.approx(2 * np.sqrt(size / 5) * 50, rel=1e-12)
    assert when == at
    code, out, err = run("verify episode_0.hdf5 --robot aloha --rate 50")
    assert "broken" in out
    assert code == 1
    (tmp_path / "damaged.hdf5").write_bytes(b"no file")
    code, out, _ = run("verify damaged.hdf5 episode_0.hdf5 --robot aloha --rate 50 --json")
    first, second = json.loads(out)["episodes"]
    assert code == 2
    assert "damaged.hdf5: episodes cannot be read" in first["error"]
    assert second["steps"] == told["steps"]


def test_a_file_for_a_controller_passes_the_targets_within_the_tolerance(run):
    """Sixteen targets within 5 mrad, points at whole cycles: read again it passes all of them."""
    from trajopt import verify
    from trajopt.chunks import from_samples
    from trajopt.core.limits import Limits
    from trajopt.formats.motion import motion
    from trajopt.judgement import passing

    rows = targets("noisy", 0, 16, 2)
    text = HEADER + table(rows)
    code, out, err = run(
        "chunk c.csv --limits l.yaml --out m.csv --json", c__csv=text, l__yaml=LIMITS
    )
    assert code == 0, err
    (told,) = json.loads(out)["chunks"]
    assert told["out"]["duration"] <= told["certified_duration"] * 1.02
    limits = Limits(velocity=[2.0] * 2, acceleration=[10.0] * 2)
    problem = from_samples(np.round(rows, 6), limits, rate=30).problem
    executed = passing(problem, motion("m.csv").trajectory)
    assert verify(problem, executed).feasible
