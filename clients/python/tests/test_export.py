"""What `palpate export` writes, read by others: csv, meshio, mcap with Foxglove's own classes."""

import csv
import subprocess
import xml.etree.ElementTree as xml

import numpy as np
import pytest

import palpate
from test_simulation import TOP, cube, press

meshio = pytest.importorskip("meshio")
reader = pytest.importorskip("mcap.reader")
scenes = pytest.importorskip("foxglove_schemas_protobuf.SceneUpdate_pb2")


@pytest.fixture(scope="module")
def exported(program, tmp_path_factory):
    """A folder with a recording and all that is made of it, and what was felt."""
    folder = tmp_path_factory.mktemp("export")
    sim = cube()
    felt = sim.record(folder / "press.mcap", press(0.008))
    outputs = ["--table", "press.csv", "--surface", "series", "--foxglove", "fox.mcap"]
    subprocess.run([program, "export", "press.mcap", *outputs], cwd=folder, check=True)
    return folder, felt, sim


def test_the_table_has_poses_and_wrenches(exported):
    folder, felt, _ = exported
    with open(folder / "press.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    column = lambda name: np.array([float(row[name]) for row in rows])
    assert len(rows) == len(felt) and {row["tool"] for row in rows} == {"ball"}
    assert np.allclose(column("time_s"), felt.time)
    for axis, name in enumerate("xyz"):
        assert np.allclose(column(f"force_{name}_N"), felt.force[:, axis], atol=1e-6)
        assert np.allclose(column(f"handle_{name}_m"), press(0.008)[:, axis])
        assert np.allclose(column(f"{name}_m"), felt.position[:, axis], atol=1e-6)
    assert [palpate.Phase[row["phase"].upper()] for row in rows] == list(felt.phase)


def test_paraview_gets_a_series_with_displacements(exported):
    folder, _, sim = exported
    sets = xml.parse(folder / "series" / "surface.pvd").getroot().findall("./Collection/DataSet")
    ticks, surfaces = palpate.read_recording(folder / "press.mcap").vertices()
    assert np.allclose([float(entry.get("timestep")) for entry in sets], ticks * 1e-3)
    for entry, vertices in zip(sets, surfaces):
        mesh = meshio.read(folder / "series" / entry.get("file"))
        assert np.allclose(mesh.points, vertices, atol=1e-7)
        assert np.allclose(mesh.points - mesh.point_data["displacement_m"], sim.rest_vertices, atol=1e-6)
        assert np.array_equal(mesh.cells_dict["triangle"], sim.triangles)
    assert len(mesh.point_data["level"]) == len(sim.rest_vertices)
    under = np.linalg.norm(sim.rest_vertices - TOP, axis=1).argmin()
    assert mesh.point_data["displacement_m"][under, 2] < -0.003


def test_foxglove_gets_scenes_and_wrenches(exported):
    folder, felt, sim = exported
    forces, arrows, surfaces = [], 0, 0
    with open(folder / "fox.mcap", "rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert channel.message_encoding == schema.encoding == "protobuf"
            if channel.topic == "/wrench/ball":
                assert schema.name == "palpate.v1.ToolWrench"
                forces.append(message.log_time)
                continue
            assert schema.name == "foxglove.SceneUpdate" and channel.topic in ("/surface", "/tools")
            update = scenes.SceneUpdate.FromString(message.data)
            for entity in update.entities:
                assert entity.frame_id == "world" and entity.timestamp.ToNanoseconds() == message.log_time
                for surface in entity.triangles:
                    surfaces += 1
                    assert len(surface.points) == len(sim.rest_vertices)
                    assert np.array_equal(np.reshape(surface.indices, (-1, 3)), sim.triangles)
                for arrow in entity.arrows:
                    arrows += 1
                    # +x of the arrow, turned, is up: that is where the body pushes.
                    turn = arrow.pose.orientation
                    assert 2 * (turn.x * turn.z - turn.w * turn.y) > 0.9
                    assert arrow.shaft_length > 0
    assert len(forces) == len(felt) and surfaces == len(palpate.read_recording(folder / "press.mcap").vertices()[0])
    assert 0 < arrows < surfaces
