"""The contract, followed by a stranger: proto/contract.md, its descriptor set and its vectors, and nothing of Palpate's code."""

import json
import pathlib

import numpy as np
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PROTO = pathlib.Path(__file__).parents[3] / "proto"
POOL = descriptor_pool.DescriptorPool()
for file in descriptor_pb2.FileDescriptorSet.FromString((PROTO / "palpate.desc").read_bytes()).file:
    POOL.Add(file)


def message(name, text):
    kind = message_factory.GetMessageClass(POOL.FindMessageTypeByName("palpate.v1." + name))
    return kind.FromString(bytes.fromhex(text))


def vectors(name):
    return json.loads((PROTO / "vectors" / name).read_text(encoding="utf-8"))


# ---- the force at the device's rate ----


def cap(v, length):
    size = np.linalg.norm(v)
    return v * (length / size) if size > length else v


def faded(age):
    """Of an age [ns]: in whole numbers, as the vectors have wrenches of exactly 20 ms."""
    return min(1.0, max(0.0, (70_000_000 - age) / 50_000_000))


class Renderer:
    """As the contract says, in its letters."""

    def __init__(self, device, mode):
        self.device, self.mode = device, mode
        self.model = dict(F0=np.zeros(3), x0=np.zeros(3), K=np.zeros((3, 3)), n=np.zeros(3), range=0.0, came=-(10**9))
        self.newer, self.sequence, self.torque = None, 0, np.zeros(3)
        self.e, self.E, self.last = np.zeros(3), 0.0, None
        self.s, self.P, self.against, self.m, self.f = 0.0, 0.0, False, np.zeros(3), np.zeros(3)

    def receive(self, wrench, now):
        numbers = [list(getattr(wrench, f)) for f in ("force", "torque", "model_position", "model_force", "model_normal", "model_stiffness")]
        if wrench.sequence <= self.sequence or not np.all(np.isfinite(sum(numbers, []))):
            return False
        model = dict(F0=np.array(wrench.force), x0=np.zeros(3), K=np.zeros((3, 3)), n=np.zeros(3), range=0.0, came=now)
        if "local" in self.mode and wrench.model_range > 0.0:
            xx, yy, zz, yz, zx, xy = wrench.model_stiffness
            K = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
            K *= min(1.0, self.device["max_stiffness"] / max(np.linalg.eigvalsh(K).max(), 1e-9))
            model.update(F0=np.array(wrench.model_force), x0=np.array(wrench.model_position), K=K)
            model.update(n=np.array(wrench.model_normal), range=wrench.model_range)
        self.newer, self.sequence, self.torque = model, wrench.sequence, cap(np.array(wrench.torque), self.device["max_torque"])
        return True

    def F(self, model, x):
        F = model["F0"] - model["K"] @ cap(x - model["x0"], model["range"])
        return np.zeros(3) if model["n"] @ F < 0.0 else F

    def rendered(self, x, now):
        F_max, n = self.device["max_force"], self.model["n"]
        G = cap(self.F(self.model, x), F_max) + self.e
        G = G - n * min(0.0, n @ G)
        return faded(now - self.model["came"]) * cap(G, F_max)

    def pay(self, w, step, x, dt):
        left = max(0.0, self.P - w)
        if w > 0.0:
            self.s *= left / self.P if left > 0.0 else 0.0
        self.P = left
        if not np.any(self.f) or (w > 0.0 and left == 0.0):
            self.against, self.m = False, x
        elif np.linalg.norm(x - self.m) > 2.0 * self.device["resolution"]:
            self.against, self.m = self.f @ (x - self.m) < 0.0, x
        if self.against:
            way = max(0.0, -self.f @ step / np.linalg.norm(self.f)) * 2.0 * self.device["max_stiffness"] / self.device["max_force"]
            self.s = 1.0 - (1.0 - self.s) * np.exp(-min(dt / 0.008, way))
        else:
            self.s *= np.exp(-dt / 0.008)

    def force(self, x, v, now):
        F_max, dt = self.device["max_force"], 0.0
        if self.last:
            F, x_last, then = self.last
            dt = (now - then) * 1e-9
            self.E += F @ (x - x_last)
            self.pay(F @ (x - x_last), x - x_last, x, dt)
            self.e = self.e * np.exp(-dt / 0.008)
        else:
            self.m = x
        if self.newer:
            B, newer = self.rendered(x, now), self.newer
            held = self.model["range"] == newer["range"] == 0.0
            late = faded(now - self.model["came"]) < 1.0
            if late or not held:
                self.e = B - cap(self.F(newer, x), F_max)
            self.model, self.newer = newer, None
        F = self.rendered(x, now)
        if not np.any(F):
            self.E, self.P = max(self.E, 0.0), 0.0
        self.f = F
        b = F_max**2 / (4.0 * self.device["max_stiffness"])
        beta = self.E - b
        if "passive" in self.mode and beta > 0.0 and dt > 0.0:
            F = F * max(0.0, 1.0 - beta / b, self.s * min(1.0, 2.0 * b / self.E)) - v * min(beta / max(v @ v * dt, 1e-30), self.device["max_damping"])
        F = cap(F, F_max)
        self.last = (F, x, now)
        return F, self.torque * faded(now - self.model["came"])


def test_the_renderer_of_the_contract_gives_the_forces_of_the_vectors():
    given = vectors("wrench.json")
    compared = 0
    for sequence in given["sequences"]:
        modes = next(step["force"] for step in sequence["steps"] if "force" in step)
        for mode in modes:
            renderer = Renderer(given["device"], mode)
            for step in sequence["steps"]:
                now = step["at_ns"]
                if "wrench" in step:
                    assert renderer.receive(message("ToolWrench", step["wrench"]), now) == step["taken"], step
                else:
                    force, torque = renderer.force(np.array(step["position"]), np.array(step["velocity"]), now)
                    assert np.allclose(force, step["force"][mode], atol=1e-6), (mode, step, force)
                    assert np.allclose(torque, step["torque"], atol=1e-6), (mode, step, torque)
                    compared += 1
    assert compared > 150


# ---- the surface ----


def decode(data, reference, neighbours):
    n = len(reference)
    planes = np.frombuffer(zstandard.ZstdDecompressor().decompress(data, max_output_size=12 * n), np.uint8)
    planes = planes.reshape(4, 3, n).astype(np.int64)
    u = sum(planes[byte] << (8 * byte) for byte in range(4)).T
    r = (u >> 1) ^ -(u & 1)
    now = np.zeros_like(reference)
    for v in range(n):
        earlier = neighbours[v]
        s, count = (now[earlier] - reference[earlier]).sum(axis=0), max(len(earlier), 1)
        now[v] = reference[v] + (2 * s + count) // (2 * count) + r[v]
    return now


def test_the_frames_of_the_vectors_decode_as_the_contract_says():
    given = vectors("surface.json")
    parts = sorted((message("SurfaceTopology", part) for part in given["topology"]), key=lambda part: part.part)
    triangles = np.frombuffer(b"".join(part.triangles for part in parts), "<u4").reshape(-1, 3)
    rest = np.frombuffer(b"".join(part.rest_positions for part in parts), "<f4").reshape(-1, 3)
    assert np.array_equal(triangles, given["triangles"]) and np.array_equal(rest, np.float32(given["rest_positions"]))
    neighbours = [set() for _ in rest]
    for a, b, c in triangles.tolist():
        for v, w in ((a, b), (b, c), (c, a)):
            neighbours[max(v, w)].add(min(v, w))
    neighbours = [sorted(earlier) for earlier in neighbours]
    step = parts[0].step
    at_rest = np.floor(rest.astype(np.float64) / step + 0.5).astype(np.int64)
    keys = {}
    for given_frame in given["frames"]:
        frame = message("SurfaceFrame", given_frame["message"])
        assert (frame.sequence, frame.key) == (given_frame["sequence"], given_frame["key"])
        reference = at_rest if frame.key == frame.sequence else keys[frame.key]
        now = keys[frame.sequence] = decode(frame.displacements, reference, neighbours)
        assert np.array_equal(now, given_frame["grid"])
        assert np.array_equal(np.float32(now * step), np.float32(given_frame["positions"]))
        residuals = zstandard.ZstdDecompressor().decompress(frame.levels, max_output_size=len(rest))
        levels = []
        for v, residual in enumerate(residuals):
            levels.append((residual + (levels[neighbours[v][-1]] if neighbours[v] else 0)) % 256)
        assert levels == given["levels"]
