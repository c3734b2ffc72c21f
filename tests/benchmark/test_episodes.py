"""Episodes and chunks of learned policies: the formats in which data sets are kept."""

import json

import h5py
import numpy as np
import pytest

from trajopt import InvalidInput
from trajopt.benchmark import episodes
from trajopt.benchmark.suites.chunks import targets

ROWS = targets("noisy", 0, 12, 6).astype(np.float32)
NAMES = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]


def lerobot(folder, count):
    """Write a LeRobot data set of some episodes, and return its file."""
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    file.parent.mkdir(parents=True)
    (folder / "meta").mkdir()
    info = {"fps": 30, "features": {"action": {"names": [f"{name}.pos" for name in NAMES]}}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    every = np.concatenate([ROWS + episode for episode in range(count)])
    numbers = np.arange(len(ROWS))

    def lists(rows):
        return pa.FixedSizeListArray.from_arrays(pa.array(rows.ravel()), rows.shape[1])

    table = {
        "action": lists(every),
        "observation.state": lists(every + np.float32(0.01)),
        "timestamp": pa.array(np.tile(numbers / 30, count).astype(np.float32)),
        "frame_index": pa.array(np.tile(numbers, count)),
        "episode_index": pa.array(np.repeat(np.arange(count), len(ROWS))),
        "task": pa.array(["pick"] * len(every)),
    }
    parquet.write_table(pa.table(table), file)
    return file


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_read_me_first_episodes_of_lerobot(tmp_path):
    found = episodes.read(lerobot(tmp_path, 2))
    assert [own.name for own in found] == ["episode-0", "episode-1"]
    for number, own in enumerate(found):
        assert own.samples.joint_names == tuple(NAMES)
        assert own.samples.positions == pytest.approx(ROWS + number, abs=1e-6)  # of `action`
        assert own.samples.times == pytest.approx(np.arange(12) / 30, abs=1e-6)
        assert own.samples.commanded


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_cells_that_hold_whole_chunks(tmp_path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    file = tmp_path / "chunks.parquet"
    parquet.write_table(pa.table({"action": pa.array([ROWS.tolist(), ROWS.tolist()])}), file)
    found = episodes.read(file, rate=30)
    assert [own.name for own in found] == ["chunks-1", "chunks-2"]
    assert found[1].samples.positions == pytest.approx(ROWS, abs=1e-6)


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_an_episode_of_aloha(tmp_path):
    rows = targets("smooth", 1, 12, 14)
    with h5py.File(tmp_path / "episode_0.hdf5", "w") as file:
        file["action"] = rows
        file["observations/qpos"] = rows + 0.01
    (found,) = episodes.read(tmp_path / "episode_0.hdf5", rate=50)
    assert found.samples.joint_names[:2] == ("left_waist", "left_shoulder")
    assert found.samples.joint_names[-1] == "right_gripper"
    assert found.samples.positions == pytest.approx(rows)
    assert found.samples.times[-1] == pytest.approx(11 / 50)


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_demonstrations_of_robomimic(tmp_path):
    with h5py.File(tmp_path / "demo.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 20}})
        for number in (0, 1):
            demo = data.create_group(f"demo_{number}")
            demo["actions"] = np.ones((12, 7))
            demo["obs/robot0_joint_pos"] = targets("smooth", number, 12, 7)
    found = episodes.read(tmp_path / "demo.hdf5")
    assert [own.name for own in found] == ["demo_0", "demo_1"]
    assert found[1].samples.positions == pytest.approx(targets("smooth", 1, 12, 7))
    assert found[0].samples.times[1] == pytest.approx(1 / 20)


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_joint_states_and_trajectories_of_a_bag(tmp_path):
    writer = pytest.importorskip("mcap_ros2.writer")
    stamp = "int32 sec\nuint32 nanosec"
    header = "builtin_interfaces/Time stamp\nstring frame_id"
    parts = f"\n{'=' * 80}\nMSG: std_msgs/Header\n{header}\n{'=' * 80}\n"
    text = f"std_msgs/Header header\nstring[] name\nfloat64[] position{parts}"
    text += f"MSG: builtin_interfaces/Time\n{stamp}"
    with (tmp_path / "bag.mcap").open("wb") as file:
        bag = writer.Writer(file)
        schema = bag.register_msgdef("sensor_msgs/msg/JointState", text)
        for number, row in enumerate(ROWS.astype(float)):
            time = {"sec": 0, "nanosec": number * 20_000_000}
            message = {"header": {"stamp": time, "frame_id": ""}, "name": NAMES, "position": row}
            bag.write_message("/joint_states", schema, {**message, "position": row.tolist()})
        bag.finish()
    (found,) = episodes.read(tmp_path / "bag.mcap")
    assert found.name == "joint_states"
    assert found.samples.positions == pytest.approx(ROWS.astype(float))
    assert found.samples.times[1] == pytest.approx(0.02)


@pytest.mark.parametrize(
    "info",
    [
        *([], {"features": []}, {"features": {"action": None}}, {"fps": {}}),
        *({"features": {"action": {"names": own}}} for own in (5, {"motors": 3}, {}, [])),
    ],
)
@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_what_a_data_set_does_not_say_is_not_needed(tmp_path, info):
    file = lerobot(tmp_path, 1)
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    (found,) = episodes.read(file)
    assert found.samples.positions == pytest.approx(ROWS, abs=1e-6)


@pytest.mark.parametrize(
    ("held", "key"),
    [
        ({}, "/action"),
        ({"action": ROWS[:, 0], "observations/qpos": ROWS}, "/action"),
        ({"action": 3.0, "observations/qpos": ROWS}, "/action"),
        ({"action": ["a"] * 12, "observations/qpos": ROWS}, "/action"),
        ({"action/left": ROWS}, "/action"),
        ({"action": ROWS}, "/observations/qpos"),
        ({"data": ROWS}, "/action"),
        ({"data/demo_0/actions": ROWS}, "/data/demo_0/obs/robot0_joint_pos"),
        ({"data/none": None}, "episodes"),
    ],
)
def test_what_an_hdf5_file_lacks_is_named(tmp_path, held, key):
    path = tmp_path / "e.hdf5"
    with h5py.File(path, "w") as file:
        for name, value in held.items():
            if value is None:
                file.create_group(name.partition("/")[0])
            else:
                file[name] = value
    with pytest.raises(InvalidInput, match=f"e.hdf5: {key}: expected"):
        episodes.read(path)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ({"action": [[1.0, 2.0], [1.0]]}, "column action: expected a list of numbers in each row"),
        ({"action": [None, [1.0, 2.0]]}, "column action: expected a list of numbers in each row"),
        (
            {"action": [[1.0], [2.0]], "episode_index": [0, None]},
            "episode_index, row 2: expected the number of an episode",
        ),
    ],
)
def test_what_is_missing_in_a_cell_is_named(tmp_path, cells, said):
    pa = pytest.importorskip("pyarrow")
    path = tmp_path / "e.parquet"
    pytest.importorskip("pyarrow.parquet").write_table(pa.table(cells), path)
    with pytest.raises(InvalidInput, match=said):
        episodes.read(path)


@pytest.mark.parametrize("name", ["e.parquet", "e.hdf5"])
def test_a_damaged_file_is_named(tmp_path, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    (tmp_path / name).write_bytes(b"no such file")
    with pytest.raises(InvalidInput, match=name):
        episodes.read(tmp_path / name)
