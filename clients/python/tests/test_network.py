"""Tools and views of a server."""

import time

import numpy as np
import pytest

import palpate
from test_simulation import RADIUS, TOP, press


def comes(ready, seconds):
    begun = time.monotonic()
    while not ready():
        if time.monotonic() - begun > seconds:
            return False
        time.sleep(0.005)
    return True


def wait_for(ready, seconds=60):
    assert comes(ready, seconds), "waited in vain"


def pressed(tool, watch):
    """A ball pressed in and held there, until it is felt and seen: what came of the trajectory.

    A machine that is busy elsewhere for a tenth of a second silences the hand, and the tool then waits outside until it
    comes back into the body, as each trajectory does.
    """
    for _ in range(10):
        felt = tool.follow(press(0.008, 1500))
        if comes(lambda: watch.latest() and watch.latest()["tools"], 60):
            under = np.linalg.norm(watch.rest_vertices - TOP, axis=1).argmin()
            seen = comes(lambda: watch.latest()["vertices"][under, 2] < 0.1 - 0.001, 3)
            if seen and tool.state["phase"] == "engaged" and tool.force[2] > 0.3:
                return felt
        # Back as slowly: a hand that is snatched out is given more than it has taken.
        tool.follow(press(0.008, 1500)[::-1])
    raise AssertionError("pressed ten times, and never felt and seen")


def test_a_tool_is_felt_and_seen_and_given_back(server):
    connection = server.connect()
    about = connection.session()
    assert about["body"] == "cube" and about["tools"][0]["name"] == "ball"
    connection.set_parameters({"friction.ball": 0.1})
    assert connection.session()["parameters"]["friction.ball"] == {"values": [0.1], "least": 0.0, "most": 2.0}
    with pytest.raises(ConnectionError, match="friction.ball is 3: 0 to 2"):
        connection.set_parameters({"friction": 3.0})
    connection.set_parameters({"friction.ball": 0.0})
    watch = connection.watch(levels=True)
    with connection.attach("ball", device="omega", client="pytest") as tool:
        felt = pressed(tool, watch)
        assert felt.force.shape == (1500, 3)
        assert felt.force[:, 2].max() > 0.3, "the body is pressed"
        assert np.linalg.norm(felt.force, axis=1).max() <= 12.0, "the greatest force of the device"
        assert tool.state["hold"] == "held" and tool.wrench.contact_points > 0
        frame = watch.latest()
        assert frame["vertices"].shape == watch.rest_vertices.shape and len(frame["levels"]) == len(frame["vertices"])
        with pytest.raises(ConnectionError, match="held by pytest"):
            connection.attach("ball")
        # Outside the workspace nothing is taken, and the client is told.
        tool.move(TOP + [0.0, 0.0, 5.0])
        wait_for(lambda: tool.state["hold"] == "refused")
    wait_for(lambda: not connection.session()["tools"][0]["taken"])
    with pytest.raises(ConnectionError, match="given back"):
        tool.move(TOP)


def test_a_tool_whose_server_is_gone_says_so(server):
    connection = server.connect()
    tool = connection.attach()
    tool.move(TOP + [0.0, 0.0, 2 * RADIUS])
    wait_for(lambda: tool.state["hold"] == "held" and tool.wrench is not None)
    server.stop()
    wait_for(lambda: tool.state["hold"] == "gone", 10)
    for call in (lambda: tool.force, lambda: tool.move(TOP), lambda: tool.follow(press(0.001, 10))):
        with pytest.raises(ConnectionError, match="the tool is gone"):
            call()


def test_nobody_there_is_an_error_that_says_where():
    with pytest.raises(ConnectionError, match="cannot connect to nowhere"):
        palpate.connect(force="nowhere")
    with pytest.raises(ConnectionError, match="cannot be a session name"):
        palpate.connect(session="a/b")


def test_a_server_that_asks_for_a_certificate_is_told_from_one_that_is_not_there(tmp_path):
    with pytest.raises(ConnectionError, match="quic/127.0.0.1:7447 asks for a certificate"):
        palpate.connect(force="quic/127.0.0.1:7447")
    with pytest.raises(ConnectionError, match="ca.pem"):
        palpate.connect(force="quic/127.0.0.1:7447", identity=tmp_path)


def test_who_shows_a_certificate_touches_and_sees(secured):
    connection = secured.connect()
    watch = connection.watch()
    with connection.attach("ball") as tool:
        pressed(tool, watch)
    with pytest.raises(ConnectionError, match="anna is operator on this server, and may not set"):
        connection.set_parameters({"friction": 0.1})
