"""The bridge to ROS 2: MAVLink in, MCAP out, read back without ROS."""

import os
import pathlib
import subprocess
import sys
import time

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


@pytest.fixture
def unit_that_speaks_mavlink(root, hrg_board, hrg_command, tmp_path):
    """The port of a virtual board that runs the firmware with that feature, set to that framing."""
    elf = root / "target" / "mavlink" / "thumbv7em-none-eabihf" / "firmware" / "firmware"
    if not elf.exists():
        pytest.skip(f"{elf} is not built; cargo xtask size --mavlink makes it")
    with subprocess.Popen(
        [hrg_board, "serve", "--elf", elf, "--folder", tmp_path], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as board:
        port = tmp_path / "link"
        try:
            for _ in range(600):
                if port.exists() or board.poll() is not None:
                    break
                time.sleep(0.1)
            assert port.exists(), board.stderr.read()
            settings = ["--increments", "5", "--framing", "mavlink"]
            subprocess.run([hrg_command, "unit", "output", "--port", port, *settings], check=True, timeout=120)
            yield port
        finally:
            board.terminate()


def test_pymavlink_reads_a_unit(unit_that_speaks_mavlink):
    link = mavlink.MAVLink(None)
    link.robust_parsing = True
    port = os.open(unit_that_speaks_mavlink, os.O_RDONLY | os.O_NOCTTY)
    read = []
    try:
        end = time.monotonic() + 120
        while len(read) < 1000 and time.monotonic() < end:
            read += link.parse_buffer(os.read(port, 4096)) or []
    finally:
        os.close(port)
    # (What stands before the first whole packet is another's.)
    first = next(k for k, m in enumerate(read) if m.get_type() == "HIGHRES_IMU")
    packets = read[first:]
    assert {m.get_type() for m in packets} == {"HIGHRES_IMU", "HEARTBEAT"}
    imu = [m for m in packets if m.get_type() == "HIGHRES_IMU"]
    steps = [b.time_usec - a.time_usec for a, b in zip(imu, imu[1:])]
    assert len(imu) > 500 and min(steps) >= 4998 and max(steps) <= 5002
    # Rates of a unit at rest; two accelerometers and the third, at the zero of its codes.
    assert all(abs(rate) < 0.01 for m in imu for rate in (m.xgyro, m.ygyro, m.zgyro))
    assert any(m.xgyro != 0.0 for m in imu) and imu[-1].fields_updated & 0x3F in (0x38, 0x3F)
