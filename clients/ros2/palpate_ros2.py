#!/usr/bin/env python3
"""A tool of a Palpate server as a node of ROS 2, without a ROS installation: it speaks the keys and CDR of rmw_zenoh.

========================  ===============================  =======================================================
topic                     type
========================  ===============================  =======================================================
``/palpate/pose``         ``geometry_msgs/PoseStamped``    in: where the tool is to be, 10 to 1000 times a second
``/palpate/opening``      ``std_msgs/Float64``             in: how far its jaws are to be open: 0, closed, to 1
``/palpate/wrench``       ``geometry_msgs/WrenchStamped``  out: force [N] and torque [N m] on the tool, as rendered
``/palpate/grip_torque``  ``std_msgs/Float64``             out: what opens its jaws, for the angle between them [N m]
``/palpate/marker``       ``visualization_msgs/Marker``    out: the surface, 8 times a second
========================  ===============================  =======================================================

All are in the axes of the scene, frame ``palpate``: right-handed, metres, +z up. A static transform places it.

When poses stop, the force fades as behind any client (20 to 70 ms, or 3 to 7 pose periods), and then the tool is given back;
the next pose takes it again, and it has to leave the body before it can touch. While there is no tool there is no wrench.
"""

import argparse
import json
import os
import signal
import struct
import sys
import threading
import time

import numpy as np
import zenoh

import palpate

# Type hashes of Iron and later, as `ros2 topic info --verbose` shows them.
TYPES = {
    "geometry_msgs/PoseStamped": "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "geometry_msgs/WrenchStamped": "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    "std_msgs/Float64": "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    "visualization_msgs/Marker": "RIHS01_45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0",
}
NODE = "palpate"
FRAME = "palpate"
QOS = "::,10:,:,:,,"  # rmw_zenoh's word for reliable, volatile, keep last 10
MARKER_EVERY = 4  # of 31.25 frames a second


class Cdr:
    """Writes little-endian CDR."""

    def __init__(self):
        self.bytes = bytearray(b"\0\1\0\0")

    def align(self, size):
        self.bytes += bytes(-(len(self.bytes) - 4) % size)

    def put(self, code, *values):
        size = struct.calcsize(code)
        for value in values:
            self.align(size)
            self.bytes += struct.pack("<" + code, value)

    def text(self, text):
        coded = text.encode() + b"\0"
        self.put("I", len(coded))
        self.bytes += coded

    def array(self, rows):
        """A sequence of structs of doubles."""
        self.put("I", len(rows))
        if len(rows):
            self.align(8)
        self.bytes += np.ascontiguousarray(rows, "<f8").tobytes()

    def header(self, time_ns):
        self.put("i", time_ns // 1_000_000_000)
        self.put("I", time_ns % 1_000_000_000)
        self.text(FRAME)


def wrench_stamped(time_ns, force, torque):
    cdr = Cdr()
    cdr.header(time_ns)
    cdr.put("d", *force, *torque)
    return bytes(cdr.bytes)


def float64(value):
    cdr = Cdr()
    cdr.put("d", value)
    return bytes(cdr.bytes)


def marker(time_ns, corners):
    """A list of triangles, (3 n, 3) [m]."""
    cdr = Cdr()
    cdr.header(time_ns)
    cdr.text("surface")
    cdr.put("i", 0, 11, 0)  # id; TRIANGLE_LIST; ADD
    cdr.put("d", 0, 0, 0, 0, 0, 0, 1)  # pose
    cdr.put("d", 1, 1, 1)  # scale
    cdr.put("f", 0.78, 0.42, 0.38, 1.0)  # colour
    cdr.put("i", 0)  # lifetime: for ever
    cdr.put("I", 0)
    cdr.put("B", 0)  # not locked to its frame
    cdr.array(corners)
    cdr.put("I", 0)  # colours of corners
    cdr.text("")  # texture: none, in a compressed image with a header
    cdr.put("i", 0)
    cdr.put("I", 0)
    cdr.text("")
    cdr.text("")
    cdr.put("I", 0, 0)  # its bytes; coordinates on it
    cdr.text("")  # words
    cdr.text("")  # mesh: none, in a file with a name and bytes
    cdr.text("")
    cdr.put("I", 0)
    cdr.put("B", 0)
    return bytes(cdr.bytes)


def read_pose_stamped(data):
    """Time [s] and pose (7): position [m] and quaternion x, y, z, w. Raises ``struct.error`` where it is none."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(order + "iII", data, 4)
    at = 12 + length
    at += -at % 8
    return seconds + 1e-9 * nanoseconds, np.array(struct.unpack_from(order + "7d", data, 4 + at))


def read_float64(data):
    """Raises ``struct.error`` where it is none."""
    return struct.unpack_from(("<" if data[1] & 1 else ">") + "d", data, 4)[0]


def dds_type(name):
    package, message = name.split("/")
    return f"{package}::msg::dds_::{message}_"


class Ros:
    """A node among those of rmw_zenoh: keys, attachments, and the tokens by which others find it."""

    def __init__(self, router, domain, namespace):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([router]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)
        self.domain, self.namespace = domain, namespace.strip("/")
        self.entities = 0
        self.kept = [self._token("NN")]  # what ends with its last reference

    def _token(self, kind, *more):
        # A `/` in a name becomes `%`; the second number is the node's, the third that of what it declares.
        names = ["%", "%" + self.namespace.replace("/", "%") if self.namespace else "%", NODE]
        words = [self.domain, self.session.info.zid(), 0, self.entities, kind, *names, *more]
        self.entities += 1
        return self.session.liveliness().declare_token("@ros2_lv/" + "/".join(map(str, words)))

    def _declare(self, kind, topic, message):
        name = "/".join(filter(None, [self.namespace, topic]))
        kinds = (dds_type(message), TYPES[message])
        self.kept.append(self._token(kind, "%" + name.replace("/", "%"), *kinds, QOS))
        return "/".join([str(self.domain), name, *kinds])

    def close(self):
        """Ends the node. Without it the program does not end: zenoh calls back on threads of its own."""
        self.session.close()

    def publisher(self, topic, message):
        """A function that publishes CDR."""
        publisher = self.session.declare_publisher(
            self._declare("MP", topic, message), congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        gid, sent = os.urandom(16), 0

        def publish(time_ns, data):
            nonlocal sent
            sent += 1
            publisher.put(data, attachment=struct.pack("<qqB", sent, time_ns, len(gid)) + gid)

        return publish

    def subscribe(self, topic, message, callback):
        key = self._declare("MS", topic, message)
        self.kept.append(self.session.declare_subscriber(key, lambda sample: callback(sample.payload.to_bytes())))


class Poses:
    """The newest pose from ROS, and how fast it moves, and how far jaws are to be open."""

    def __init__(self):
        self.lock = threading.Lock()
        self.arrival = self.stamp = self.pose = None
        self.velocity = np.zeros(3)
        self.opening = 0.0
        self.refused = 0

    def open(self, data):
        try:
            opening = read_float64(data)
        except (struct.error, IndexError):
            opening = np.nan
        if 0.0 <= opening <= 1.0:
            self.opening = opening
        else:
            self.refused += 1

    def receive(self, data):
        try:
            stamp, pose = read_pose_stamped(data)
        except (struct.error, IndexError):
            pose = np.full(7, np.nan)
        norm = np.linalg.norm(pose[3:])
        if not (np.isfinite(pose).all() and norm > 1e-6):
            self.refused += 1
            return
        pose[3:] /= norm
        with self.lock:
            between = stamp - self.stamp if self.stamp is not None else 0.0
            moved = 0.0 < between < 0.2
            self.velocity = (pose[:3] - self.pose[:3]) / between if moved else np.zeros(3)
            self.arrival, self.stamp, self.pose = time.monotonic(), stamp, pose

    def latest(self):
        """Age [s], pose and velocity; ``None`` before the first."""
        with self.lock:
            return None if self.pose is None else (time.monotonic() - self.arrival, self.pose, self.velocity)


def fading(age, period):
    """What is left of the force when the newest pose has this age [s]; 0 from 70 ms on, or 7 pose periods."""
    unit = max(0.01, period)
    start = max(0.02, 3 * period)
    return min(max((7 * unit - age) / (7 * unit - start), 0.0), 1.0)


def bridge(connection, ros, options, stop):
    """Runs until ``stop`` is set. The tool is taken with the first pose."""
    poses = Poses()
    publish_wrench = ros.publisher("wrench", "geometry_msgs/WrenchStamped")
    publish_grip = ros.publisher("grip_torque", "std_msgs/Float64")
    publish_marker = ros.publisher("marker", "visualization_msgs/Marker")
    ros.subscribe("pose", "geometry_msgs/PoseStamped", poses.receive)
    ros.subscribe("opening", "std_msgs/Float64", poses.open)
    watch = connection.watch(every=MARKER_EVERY)
    tool, shown, again, period = None, None, 0.0, 1.0 / options.pose_rate
    due = time.monotonic()
    while not stop.is_set():
        latest = poses.latest()
        try:
            if latest is not None and (left := fading(latest[0], period)) > 0.0:
                if tool is None and time.monotonic() >= again:
                    tool = connection.attach(options.tool, device=options.device, client="ROS 2")
                if tool is not None:
                    tool.move([*latest[1], poses.opening], latest[2])
                    grip = tool.wrench.grip_torque if tool.wrench is not None else 0.0
                    publish_grip(time.time_ns(), float64(left * grip))
                    publish_wrench(time.time_ns(), wrench_stamped(time.time_ns(), left * tool.force, left * tool.torque))
            elif tool is not None:
                tool.detach()
                tool = None
        except ConnectionError as error:
            # The server is away or somebody else has the tool: once a second is often enough to ask.
            print(f"no tool: {error}", file=sys.stderr)
            tool, again = None, time.monotonic() + 1.0
        frame = watch.latest()
        if frame is not None and frame["sequence"] != shown:
            shown = frame["sequence"]
            publish_marker(time.time_ns(), marker(time.time_ns(), frame["vertices"][watch.triangles].reshape(-1, 3)))
        due = max(due + 1.0 / options.rate, time.monotonic())
        stop.wait(due - time.monotonic())
    if tool is not None:
        tool.detach()


def arguments(given=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--router", default="tcp/localhost:7447", help="endpoint of rmw_zenohd")
    parser.add_argument("--domain", type=int, default=int(os.environ.get("ROS_DOMAIN_ID", 0)), help="ROS_DOMAIN_ID")
    parser.add_argument("--namespace", default="/palpate", help="before the names of topics and node")
    parser.add_argument("--force-endpoint", help="of the Palpate server; by default one on this machine")
    parser.add_argument("--surface-endpoint", help="of the Palpate server")
    parser.add_argument("--session", help="name of the Palpate server")
    parser.add_argument("--identity", help="folder of a certificate, where the Palpate server asks for one")
    parser.add_argument("--tool", default="", help="name of the tool to take; by default any free one")
    parser.add_argument("--device", default="PHANTOM Omni", help="whose limits the force keeps; a name or a TOML file")
    parser.add_argument("--rate", type=float, default=500.0, help="of wrenches [Hz]")
    parser.add_argument("--pose-rate", type=float, default=100.0, help="of poses, at least [Hz]: when they count as stopped")
    return parser.parse_args(given)


def main():
    options = arguments()
    server = options.force_endpoint, options.surface_endpoint, options.session
    connection = palpate.connect(*server, identity=options.identity)
    ros = Ros(options.router, options.domain, options.namespace)
    stop = threading.Event()
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, lambda *_: stop.set())
    try:
        bridge(connection, ros, options, stop)
    finally:
        ros.close()


if __name__ == "__main__":
    main()
