"""Stubs, notebook and bodies from files."""

import ast
import inspect
import json
import pathlib

import numpy as np
import pytest

import palpate
from palpate import _native

FOLDER = pathlib.Path(__file__).parent.parent
STUB = ast.parse((pathlib.Path(palpate.__file__).parent / "_native.pyi").read_text(encoding="utf-8"))


def words(text):
    return " ".join((text or "").split())


def test_the_stubs_are_those_of_the_module_with_the_same_words():
    stubs = {n.name: n for n in STUB.body if isinstance(n, (ast.ClassDef, ast.FunctionDef)) and n.name != "ToolState"}
    assert set(stubs) == {name for name in vars(_native) if not name.startswith("_")}
    for name, stub in stubs.items():
        real = getattr(_native, name)
        assert words(ast.get_docstring(stub)) == words(real.__doc__), name
        if isinstance(stub, ast.FunctionDef):
            continue
        methods = {}
        for method in (n for n in stub.body if isinstance(n, ast.FunctionDef)):
            methods.setdefault(method.name, []).append(method)
        public = {m for m in vars(real) if not m.startswith("_")}
        assert public == {m for m in methods if not m.startswith("_")}, name
        for method in public:
            documented = "\n\n".join(filter(None, map(ast.get_docstring, methods[method])))
            assert words(documented) == words(inspect.getdoc(getattr(real, method))), (name, method)
            if callable(getattr(real, method)) and len(methods[method]) == 1:
                of = methods[method][0].args
                names = [a.arg for a in of.posonlyargs + of.args + of.kwonlyargs]
                assert names == list(inspect.signature(getattr(real, method)).parameters), (name, method)


def test_everything_public_is_exported():
    assert {name for name in vars(_native) if not name.startswith("_")} <= set(palpate.__all__)
    assert palpate.Phase.ENGAGED == 2 and palpate.WrenchFlag(3) == palpate.WrenchFlag.CLAMPED | palpate.WrenchFlag.SLEW_LIMITED


def test_the_notebook_runs():
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    notebook = json.loads((FOLDER / "press_liver.ipynb").read_text(encoding="utf-8"))
    names = {}
    for cell in (cell for cell in notebook["cells"] if cell["cell_type"] == "code"):
        exec(compile("".join(cell["source"]), "press_liver.ipynb", "exec"), names)
    # The liver of the notebook was pressed, gave way and pushed back.
    assert 0.1 < names["felt"].force[:, 2].max() < 3.4
    assert np.linalg.norm(names["moved"], axis=1).max() > 0.003


def test_the_example_of_the_readme_runs_and_feels_something():
    example = (FOLDER / "README.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert 0.1 < names["felt"].force[:, 2].max() < 3.4


BOX = """v 0 0 0
v 80 0 0
v 80 80 0
v 0 80 0
v 0 0 80
v 80 0 80
v 80 80 80
v 0 80 80
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def test_a_surface_becomes_a_body_that_can_be_touched(tmp_path):
    mesh, body = tmp_path / "box.obj", tmp_path / "box.palpate"
    mesh.write_text(BOX)
    with pytest.raises(ValueError, match="furlong"):
        palpate.prepare(mesh, body, unit="furlong")
    report = palpate.prepare(mesh, body, unit="mm", levels=[0.03, 0.02], material={"youngs_modulus": 8000.0})
    assert body.exists() and report
    sim = palpate.Simulation(body)
    assert sim.name == "box" and np.allclose(sim.bounds, [[0.0] * 3, [0.08] * 3], atol=0.002)
    assert "youngs_modulus = 8000.0" in sim.scene
    with pytest.raises(ValueError, match="this is the file that is read"):
        palpate.prepare(body, body, unit="mm")
    with pytest.raises(OSError, match="make the folder"):
        palpate.prepare(mesh, tmp_path / "nowhere" / "box.palpate", unit="mm")
    link = tmp_path / "link.palpate"
    link.hardlink_to(mesh)
    before = mesh.read_bytes()
    with pytest.raises(ValueError, match="this is the file that is read"):
        palpate.prepare(mesh, link, unit="mm")
    assert mesh.read_bytes() == before
