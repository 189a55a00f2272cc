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


def free_endpoint(protocol="tcp"):
    with socket.socket(type=socket.SOCK_DGRAM if protocol == "quic" else socket.SOCK_STREAM) as free:
        free.bind(("127.0.0.1", 0))
        return "%s/127.0.0.1:%d" % (protocol, free.getsockname()[1])


class Server:
    """A server of the cube, until it is stopped; in a `folder`, one that asks for certificates, with one for an operator."""

    def __init__(self, program, folder=None):
        self.identity, trust = None, []
        if folder:
            roles, made = folder / "roles.toml", folder / "certificates"
            roles.write_text("anna = { role = \"operator\", tools = [\"ball\"] }")
            subprocess.run([program, "certificates", "--roles", roles, "--out", made], check=True)
            self.identity, trust = made / "clients" / "anna", ["--roles", roles, "--identity", made / "server"]
        protocol = "quic" if folder else "tcp"
        self.force, self.surface = free_endpoint(protocol), free_endpoint(protocol)
        command = [program, "serve", "--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--until-input-ends"]
        command += ["--force-endpoint", self.force, "--surface-endpoint", self.surface, *trust]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)

    def connect(self):
        begun = time.monotonic()
        while True:
            try:
                connection = palpate.connect(self.force, self.surface, identity=self.identity)
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


@pytest.fixture
def secured(program, tmp_path):
    """A server that asks for certificates."""
    running = Server(program, tmp_path)
    yield running
    running.stop()
