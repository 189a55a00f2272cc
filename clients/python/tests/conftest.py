"""What several tests need: the program of the same source, and a server."""

import os
import shutil
import socket
import subprocess
import time

import pytest

import palpate


@pytest.fixture(scope="session")
def program():
    """The `palpate` program: that of the environment variable PALPATE, or on the path."""
    found = os.environ.get("PALPATE") or shutil.which("palpate")
    if not found:
        pytest.skip("no program: PALPATE names none, and none is on the path")
    return found


def free_endpoint():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return "tcp/127.0.0.1:%d" % free.getsockname()[1]


class Server:
    """A server of the cube, until it is stopped."""

    def __init__(self, program):
        self.force, self.surface = free_endpoint(), free_endpoint()
        command = [program, "serve", "--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--until-input-ends"]
        command += ["--force-endpoint", self.force, "--surface-endpoint", self.surface]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)

    def connect(self):
        begun = time.monotonic()
        while True:
            try:
                connection = palpate.connect(self.force, self.surface)
                connection.session()
                return connection
            except ConnectionError:
                assert self.process.poll() is None, "the server has ended"
                assert time.monotonic() - begun < 120, "the server does not come up"

    def stop(self):
        self.process.stdin.close()
        self.process.wait(60)


@pytest.fixture
def server(program):
    running = Server(program)
    yield running
    if running.process.poll() is None:
        running.stop()
