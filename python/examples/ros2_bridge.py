"""A unit's rates and accelerations as ROS 2 messages in an MCAP file that Foxglove opens; no ROS is needed.

    python ros2_bridge.py /dev/ttyUSB0 flight.mcap        (or a file of the link's bytes, for a test)

The unit sends in MAVLink's framing (`hrg unit output --port PORT --increments 5 --framing mavlink`, firmware with the feature mavlink):
HIGHRES_IMU becomes sensor_msgs/Imu. Covariances: --rate-std in deg/h, which is the uncertainty that the unit states for its
biases (`hrg monitor`), and --force-std in m/s^2. The attitude is not known: its covariance begins with -1, as sensor_msgs wants it.
Needs pymavlink, mcap-ros2-support, and pyserial for a port.
"""

import argparse
import math
import pathlib

from mcap_ros2.writer import Writer
from pymavlink.dialects.v20 import common as mavlink

IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

ACCELERATIONS = 0b111


def pieces(source):
    """Bytes of a port, as they come, or of a file."""
    if pathlib.Path(source).is_file():
        yield pathlib.Path(source).read_bytes()
        return
    import serial

    with serial.Serial(source, 921_600, timeout=0.1) as port:
        while True:
            yield port.read(4096)


def covariance(std):
    variance = std * std
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]


def message(imu, frame, rate_cov, force_cov):
    there = imu.fields_updated & ACCELERATIONS == ACCELERATIONS
    stamp = {"sec": imu.time_usec // 1_000_000, "nanosec": imu.time_usec % 1_000_000 * 1000}
    return {
        "header": {"stamp": stamp, "frame_id": frame},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "angular_velocity": {"x": imu.xgyro, "y": imu.ygyro, "z": imu.zgyro},
        "angular_velocity_covariance": rate_cov,
        "linear_acceleration": {"x": imu.xacc, "y": imu.yacc, "z": imu.zacc},
        "linear_acceleration_covariance": force_cov if there else [-1.0] + [0.0] * 8,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", help="serial port, or file of bytes")
    parser.add_argument("out", help="MCAP file")
    parser.add_argument("--topic", default="/imu")
    parser.add_argument("--frame", default="imu")
    parser.add_argument("--rate-std", type=float, default=0.1, help="deg/h")
    parser.add_argument("--force-std", type=float, default=0.01, help="m/s^2")
    a = parser.parse_args()
    rate_cov, force_cov = covariance(math.radians(a.rate_std / 3600)), covariance(a.force_std)
    parse = mavlink.MAVLink(None)
    parse.robust_parsing = True
    count = 0
    with open(a.out, "wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        try:
            for piece in pieces(a.source):
                for imu in parse.parse_buffer(piece) or []:
                    if imu.get_type() == "HIGHRES_IMU":
                        at = imu.time_usec * 1000
                        text = message(imu, a.frame, rate_cov, force_cov)
                        writer.write_message(a.topic, schema, text, log_time=at, publish_time=at)
                        count += 1
        except KeyboardInterrupt:
            pass
        writer.finish()
    print(f"{count} messages in {a.out}")


if __name__ == "__main__":
    main()
