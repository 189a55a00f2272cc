"""The bridge to ROS 2 as a node of ROS meets it: a peer of our own, with keys, CDR and type hashes of `rosbags`."""

import os
import pathlib
import signal
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

zenoh = pytest.importorskip("zenoh")
typesys = pytest.importorskip("rosbags.typesys")

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "ros2"))
import palpate_ros2
from conftest import free_endpoint
from test_network import comes
from test_simulation import TOP, press

STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseStamped"
FLOAT = "std_msgs/msg/Float64"


def pose_stamped(position):
    kind = STORE.types
    stamp = kind["builtin_interfaces/msg/Time"](*divmod(time.time_ns(), 1_000_000_000))
    pose = kind["geometry_msgs/msg/Pose"](
        kind["geometry_msgs/msg/Point"](*map(float, position)), kind["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    return bytes(STORE.serialize_cdr(kind[POSE](kind["std_msgs/msg/Header"](stamp, "palpate"), pose), POSE))


def test_the_hashes_are_those_of_the_messages():
    for name, known in palpate_ros2.TYPES.items():
        assert STORE.hash_rihs01(name.replace("/", "/msg/")) == known


def test_poses_that_stop_let_the_force_fade():
    assert [palpate_ros2.fading(age, 0.001) for age in (0.0, 0.02, 0.07, 9.0)] == [1.0, 1.0, 0.0, 0.0]
    assert abs(palpate_ros2.fading(0.045, 0.01) - 0.625) < 1e-9


def test_jaws_are_opened_by_numbers_from_0_to_1_and_nothing_else():
    poses = palpate_ros2.Poses()
    for opening, expected in ((0.4, 0.4), (1.0, 1.0), (1.5, 1.0), (float("nan"), 1.0), (0.0, 0.0)):
        poses.open(bytes(STORE.serialize_cdr(STORE.types[FLOAT](opening), FLOAT)))
        assert poses.opening == expected
    poses.open(b"none")
    assert poses.opening == 0.0 and poses.refused == 3
    assert STORE.deserialize_cdr(palpate_ros2.float64(-0.25), FLOAT).data == -0.25


class Peer:
    """ROS: its router, one that sends poses, and one that keeps what comes, as bytes: reading all of it would take the time of
    the bridge, which runs in the same interpreter."""

    def __init__(self):
        self.endpoint = free_endpoint()
        config = zenoh.Config()
        for key, value in (
            ("mode", '"router"'),
            ("listen/endpoints", f'["{self.endpoint}"]'),
            ("scouting/multicast/enabled", "false"),
        ):
            config.insert_json5(key, value)
        self.session = zenoh.open(config)
        self.kept = []
        self.came = {"wrench": [], "marker": [], "grip_torque": []}
        kinds = ("geometry_msgs/WrenchStamped", "visualization_msgs/Marker", "std_msgs/Float64")
        for topic, kind in zip(self.came, kinds):
            self.kept.append(self.session.declare_subscriber(self.key(topic, kind), self.keep(topic, kind)))
        self.openings = self.session.declare_publisher(self.key("opening", "std_msgs/Float64"))
        self.poses = self.session.declare_publisher(self.key("pose", "geometry_msgs/PoseStamped"))

    def key(self, topic, kind):
        package, message = kind.split("/")
        of_type = STORE.hash_rihs01(f"{package}/msg/{message}")
        return f"7/palpate/{topic}/{package}::msg::dds_::{message}_/{of_type}"

    def keep(self, topic, kind):
        def receive(sample):
            sequence, _, length = struct.unpack_from("<qqB", sample.attachment.to_bytes())
            assert length == 16 and len(sample.attachment.to_bytes()) == 33
            self.came[topic].append((sequence, sample.payload.to_bytes()))

        return receive

    def read(self, topic, nth=-1):
        kinds = {"wrench": "geometry_msgs/msg/WrenchStamped", "marker": "visualization_msgs/msg/Marker"}
        return STORE.deserialize_cdr(self.came[topic][nth][1], kinds.get(topic, FLOAT))

    def open(self, opening):
        self.openings.put(bytes(STORE.serialize_cdr(STORE.types[FLOAT](opening), FLOAT)))

    def send(self, position):
        self.poses.put(pose_stamped(position))


def test_a_node_of_ros_presses_feels_and_sees(server):
    connection = server.connect()
    peer, stop = Peer(), threading.Event()
    options = palpate_ros2.arguments(["--domain", "7", "--pose-rate", "10"])
    ros = palpate_ros2.Ros(peer.endpoint, options.domain, options.namespace)
    running = threading.Thread(target=palpate_ros2.bridge, args=(connection, ros, options, stop))
    running.start()
    try:
        # It is found as nodes are.
        def tokens():
            return {str(reply.ok.key_expr) for reply in peer.session.liveliness().get("@ros2_lv/7/**")}

        assert comes(lambda: len(tokens()) == 6, 60), tokens()
        kinds = sorted(token.split("/")[5] for token in tokens())
        assert kinds == ["MP", "MP", "MP", "MS", "MS", "NN"]
        assert any(token.endswith("/NN/%/%palpate/palpate") for token in tokens())

        peer.poses.put(b"no pose")
        peer.send([np.nan, 0.0, 0.0])
        for opening in (np.nan, 7.0):
            peer.open(opening)

        def pressed_until(done):
            """True once `done`; a busy machine may lose the hand for a moment, so it comes from outside again and again."""
            for _ in range(20):
                for nth, position in enumerate([*press(0.008, 100), *[press(0.008)[-1]] * 200]):
                    peer.send(position)
                    time.sleep(0.01)
                    if nth % 10 == 9 and done():
                        return True
            return False

        def felt():
            return peer.read("wrench").wrench.force.z if peer.came["wrench"] else 0.0

        assert pressed_until(lambda: felt() > 0.3), "the body pushes back"
        assert peer.read("wrench").header.frame_id == "palpate"
        assert peer.read("grip_torque").data == 0.0, "a ball has no jaws"
        peer.open(0.5)

        # It sees the dent.
        def dent():
            points = peer.read("marker").points
            return min(p.z for p in points if abs(p.x - TOP[0]) + abs(p.y - TOP[1]) < 0.02 and p.z > 0.05)

        assert pressed_until(lambda: dent() < TOP[2] - 0.002), dent()
        marker = peer.read("marker")
        assert (marker.type, marker.action, marker.ns) == (marker.TRIANGLE_LIST, marker.ADD, "surface")
        assert len(marker.points) == 3 * len(connection.watch().triangles)

        # Poses stop: the last forces fade, the tool is given back, and nothing comes of it any more.
        def silent():
            count = len(peer.came["wrench"])
            time.sleep(0.3)
            return len(peer.came["wrench"]) == count and not connection.session()["tools"][0]["taken"]

        assert comes(silent, 60)
        forces = [peer.read("wrench", nth).wrench.force.z for nth in range(len(peer.came["wrench"]))]
        assert max(forces) < 3.4, "no harder than the device can"
    finally:
        stop.set()
        running.join(60)
        ros.close()
        peer.session.close()


def test_the_program_shows_its_certificate_and_runs_until_it_is_told_to_end(secured):
    secured.connect()
    peer = Peer()
    command = [sys.executable, palpate_ros2.__file__, "--router", peer.endpoint, "--domain", "7"]
    command += ["--force-endpoint", secured.force, "--surface-endpoint", secured.surface, "--identity", secured.identity]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    try:
        assert comes(lambda: peer.came["marker"], 60), "the surface comes without a tool"
        assert not peer.came["wrench"], "and no wrench"

        def felt():
            peer.send(TOP + [0.0, 0.0, 0.05])
            return peer.came["wrench"]

        assert comes(felt, 60), "with a pose the tool is its own"
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    finally:
        process.kill()
        peer.session.close()
