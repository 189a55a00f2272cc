"""Recordings as arrays."""

import subprocess

import numpy as np
import pytest

import palpate
from test_simulation import cube, press


def test_a_recording_gives_back_what_was_felt(tmp_path):
    sim = cube()
    poses = press(0.006, 500)
    path = tmp_path / "press.mcap"
    felt = sim.record(path, poses)
    recording = palpate.read_recording(path)
    assert recording.tools == ["ball"] and recording.cut is None and "name = \"cube\"" in recording.scene
    assert np.array_equal(recording.ticks, felt.tick)
    read = recording.wrenches()
    assert np.array_equal(read.tick, felt.tick) and np.allclose(read.force, felt.force, atol=1e-6)
    ticks, came = recording.poses()
    assert np.array_equal(ticks, felt.tick) and np.array_equal(came[:, :3], poses)
    assert np.array_equal(came[:, 3:], np.tile([0.0, 0.0, 0.0, 1.0], (500, 1)))
    ticks, surfaces = recording.vertices()
    assert np.all(ticks % 32 == 0) and len(ticks) == len(surfaces) == len(recording.hashes()[0])
    assert recording.vertices(every=4)[0].tolist() == ticks[::4].tolist()
    # The last surface is that of the simulation then, on the grid of frames.
    again = cube()
    again.run(poses[: int(ticks[-1]) - 1])
    assert np.abs(surfaces[-1] - again.vertices()).max() < 1e-4
    assert recording.hashes()[1][-1] == again.hash
    assert np.array_equal(recording.triangles, sim.triangles)


def test_the_program_replays_it_bit_for_bit(program, tmp_path):
    path = tmp_path / "press.mcap"
    cube().record(path, press(0.006, 300))
    done = subprocess.run([program, "replay", str(path)], stdout=subprocess.PIPE, universal_newlines=True)
    assert done.returncode == 0 and "identical: 300 ticks" in done.stdout, done.stdout


def test_what_is_no_recording_is_refused_with_its_name(tmp_path):
    path = tmp_path / "notes.mcap"
    path.write_bytes(b"not a recording")
    with pytest.raises(OSError, match="notes.mcap"):
        palpate.read_recording(path)
    with pytest.raises(OSError, match="missing.mcap"):
        palpate.read_recording(tmp_path / "missing.mcap")
