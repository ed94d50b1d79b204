"""Write a store as a recording for other tools, and as a trajectory for an evaluation."""

import tempfile
from pathlib import Path

import tfdb
from tfdb.recordings import write_recording

buf = tfdb.Buffer(history=None)
start = tfdb.stamp("100.0")
buf.set_static_transform("base", "camera", (0.2, 0.0, 1.1), authority="calibration")
for i in range(500):
    turn = (0.0, 0.0, 0.6, 0.8)
    buf.set_transform(
        "map", "base", start + i * 20_000_000, (0.01 * i, 0, 0), turn, authority="ekf"
    )

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)

    # The file extension sets the format: .bag (ROS 1), .mcap or .db3 (ROS 2).
    for suffix in (".bag", ".mcap"):
        messages = write_recording(folder / f"drive{suffix}", buf)
        again = tfdb.load(folder / f"drive{suffix}")
        print(suffix, messages, "messages,", again.frame_info("base").samples, "samples")
        at = start + 1_234_567_890
        before = buf.lookup_transform("map", "camera", at).pose
        assert (again.lookup_transform("map", "camera", at).pose == before).all()

    # A trajectory (TUM, KITTI, EuRoC, CSV, NPZ) has the stamps and poses of one frame in another.
    path = buf.trajectory("map", "camera", rate=10.0)
    path.save(folder / "camera.tum")
    print((folder / "camera.tum").read_text().splitlines()[1])
    assert (tfdb.Trajectory.read(folder / "camera.tum").stamps == path.stamps).all()
