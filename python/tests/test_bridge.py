"""The bridge to ROS 2: MAVLink in, MCAP out, read back without ROS."""

import pathlib
import subprocess
import sys

import pytest

mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
reader = pytest.importorskip("mcap_ros2.reader")

EXAMPLE = pathlib.Path(__file__).resolve().parents[1] / "examples" / "ros2_bridge.py"


def test_rates_and_accelerations_become_messages_with_covariances(tmp_path):
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=200)
    sent = b"\x00garbage"
    for k in range(400):
        force = (0.0, 0.0, -9.8) if k < 200 else (0.0, 0.0, 0.0)
        fields = 0x103F if k < 200 else 0x1038
        imu = mavlink.MAVLink_highres_imu_message(
            1_700_000_000_000_000 + 5000 * k, *force, 1e-3, 2e-3, -3e-3, 0, 0, 0, 0, 0, 0, 21.5, fields, 0
        )
        sent += imu.pack(link)
    (tmp_path / "link.bin").write_bytes(sent)
    out = tmp_path / "flight.mcap"
    command = [sys.executable, EXAMPLE, tmp_path / "link.bin", out, "--rate-std", "0.36", "--force-std", "0.02"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("400 messages")
    read = [m.ros_msg for m in reader.read_ros2_messages(str(out))]
    assert len(read) == 400
    first, last = read[0], read[-1]
    assert (first.header.stamp.sec, first.header.frame_id) == (1_700_000_000, "imu")
    assert first.angular_velocity.y == pytest.approx(2e-3) and first.linear_acceleration.z == pytest.approx(-9.8)
    # 0.36 deg/h are 1.745e-6 rad/s.
    assert first.angular_velocity_covariance[4] == pytest.approx(1.7453e-6**2, rel=1e-3)
    assert first.linear_acceleration_covariance[8] == pytest.approx(4e-4)
    assert first.orientation_covariance[0] == -1.0 and last.linear_acceleration_covariance[0] == -1.0
