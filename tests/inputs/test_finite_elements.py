"""Finite-element models from files: matrices of CalculiX, Nastran, Matrix Market, meshes of solids; stresses and stiffening."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reduced_bodies.beam import beam_matrices
from scipy.io import mmwrite

import mbdae as mb

E, DENSITY = 2.1e11, 7800.0
STEEL = {"E": E, "nu": 0.0, "density": DENSITY}


def block(path: Path, size: tuple[float, ...], counts: tuple[int, ...], step: str = "") -> Path:
    """An input file of CalculiX with a block of hexahedra, and its ends as sets LEFT and RIGHT."""
    at = {place: n + 1 for n, place in enumerate(np.ndindex(*(c + 1 for c in counts)))}
    text = ["*NODE", *(f"{n}, " + ", ".join(f"{size[a] * p[a] / counts[a]:.9g}" for a in range(3)) for p, n in at.items()),
            "*ELEMENT, TYPE=C3D8, ELSET=ALL"]
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    for n, p in enumerate(np.ndindex(*counts)):
        text.append(", ".join(map(str, [n + 1, *(at[tuple(np.add(p, c))] for c in corners)])))
    for name, x in (("LEFT", 0), ("RIGHT", counts[0])):
        text += [f"*NSET, NSET={name}", *(f"{n}," for p, n in at.items() if p[0] == x)]
    path.write_text("\n".join([*text, step]))
    return path


def tetrahedra(path: Path) -> Path:
    """A rod of tetrahedra, 1 m by 0.1 m by 0.1 m, in mm, with its ends as physical groups of triangles."""
    meshio, fem = pytest.importorskip("meshio"), pytest.importorskip("skfem")
    mesh = fem.MeshTet.init_tensor(np.linspace(0, 1000, 9), np.linspace(0, 100, 2), np.linspace(0, 100, 2))
    faces = [mesh.facets_satisfying(lambda x, at=at: np.abs(x[0] - at) < 1e-9) for at in (0, 1000)]
    tags = np.repeat([1, 2], [len(f) for f in faces])
    cells = [("triangle", mesh.facets.T[np.concatenate(faces)]), ("tetra", mesh.t.T)]
    volume = np.full(mesh.t.shape[1], 3)
    meshio.Mesh(mesh.p.T, cells, cell_data={"gmsh:physical": [tags, volume], "gmsh:geometrical": [tags, volume]},
                field_data={"root": np.array([1, 2]), "tip": np.array([2, 2]), "all": np.array([3, 3])}).write(
                    path, file_format="gmsh22", binary=False)
    return path


def test_a_mesh_of_tetrahedra_is_a_body_end_to_end(tmp_path: Path) -> None:
    """Read, assembled, reduced, and in motion: deflection, frequency and stress as the theory of beams says."""
    model = mb.read_fe(tetrahedra(tmp_path / "rod.msh"), **STEEL, unit=1e-3)
    assert set(model.sets) == {"root", "tip", "all"}
    assert len(model.sets["root"]) == 9  # corners, and the nodes between them
    rod = model.reduced({"root": "root", "tip": "tip"}, modes=4, accelerations=True)
    assert rod.mass == pytest.approx(78.0, rel=1e-12)
    s = mb.Scene("rod")
    s.reduced_body("rod", rod)
    s.weld("wall", s.ground, "rod.root", at=(0, 0.05, 0.05))
    s.force("F", "rod.tip", (0, 1e3, 0))
    r = s.equilibrium()
    I, G = 0.1**4 / 12, E / 2
    assert r["rod.tip"].position[0, 1] - 0.05 == pytest.approx(1e3 / (3 * E * I) + 1e3 * 1.2 / (G * 0.01), rel=2e-2)
    middle = int(np.argmin(np.linalg.norm(rod.nodes - (0.5, 0.1, 0.05), axis=1)))
    place = rod.nodes[middle]
    stress = 1e3 * (1 - place[0]) * (place[1] - 0.05) / I
    assert rod.stress(r["rod.modes"])[0, middle, 0] == pytest.approx(-stress, rel=0.05)
    assert rod.von_mises(r["rod.modes"])[0, middle] == pytest.approx(stress, rel=0.05)
    moved = rod.displacement(r["rod.modes"])[0, middle]
    assert moved.shape == (3,)
    run = s.simulate(1e-3, accuracy=1e-3)
    assert rod.von_mises(run["rod.modes"]).shape == (len(run.t), len(rod.nodes))


def test_stresses_of_a_stretch_and_rotations_of_a_strained_solid_are_exact(tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    model = mb.read_fe(block(tmp_path / "block.inp", (0.6, 0.2, 0.1), (3, 2, 1)), E=E, nu=0.3, density=DENSITY)
    x = model.nodes
    stretched = 1e-3 * x * (1, -0.3, -0.3)
    np.testing.assert_allclose(model.solid.stress(stretched.ravel()), np.tile([E * 1e-3, 0, 0, 0, 0, 0], (len(x), 1)), atol=1.0)
    turn, v = np.array([0.3, -0.2, 0.5]), np.random.default_rng(1).normal(size=x.shape)
    turned = np.cross(turn, (model.K @ v.ravel()).reshape(-1, 3)).ravel() - model.K @ np.cross(turn, v).ravel()
    np.testing.assert_allclose(model.solid.second_force(np.cross(turn, x).ravel(), v.ravel()), turned,
                               atol=1e-10 * np.max(np.abs(turned)))


@pytest.mark.parametrize("share", [0.5, -0.5])
def test_a_solid_column_softens_under_a_load(tmp_path: Path, share: float) -> None:
    pytest.importorskip("skfem")
    model = mb.read_fe(block(tmp_path / "column.inp", (1, 0.02, 0.02), (10, 1, 1)), **STEEL)
    s, EI = mb.Scene("column"), E * 0.02**4 / 12
    s.reduced_body("column", model.reduced({"root": "LEFT", "tip": "RIGHT"}, modes=2, stiffening=True))
    s.weld("wall", s.ground, "column.root", at=(0, 0.01, 0.01))
    s.force("F", "column.tip", (-(P := share * np.pi**2 / 4 * EI), 1e-3 * EI, 0))
    k = np.sqrt(abs(P) / EI)
    deflection = 1e-3 * EI * ((np.tan if P > 0 else np.tanh)(k) - k) / (P * k)
    assert s.equilibrium()["column.tip"].position[0, 1] - 0.01 == pytest.approx(deflection, rel=5e-3)


def test_matrix_market_and_nastran_give_the_body_that_the_matrices_give(tmp_path: Path) -> None:
    M, K, nodes = beam_matrices(4)
    mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric")
    mmwrite(tmp_path / "M.mtx", M, symmetry="symmetric")
    text = []
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        text.append(f"DMIG    {name:8s}{0:8d}{6:8d}{2:8d}{0:8d}")
        for j in range(30):
            rows = [i for i in range(j, 30) if matrix[i, j]]
            text.append(f"DMIG*   {name:16s}{10 * (j // 6) + 1:16d}{j % 6 + 1:16d}")
            text += [f"*       {10 * (i // 6) + 1:16d}{i % 6 + 1:16d}{matrix[i, j]:16.9E}".replace("E", "D") for i in rows]
    (tmp_path / "job.pch").write_text("\n".join(text))
    want = mb.ReducedBody.craig_bampton(M, K, nodes, {"root": [0]}, 2)
    forms = {"small": "GRID    {:8d}        {:8.5f}{:8.5f}{:8.5f}", "free": "grid,{},,{:.9f},{},{}",
             "large": "GRID*   {:16d}                {:16.9f}{:16.9f}\n*       {:16.9f}"}
    for form, card in forms.items():  # in another order than the matrices, beside points that these do not have
        points = [(5, (9.0, 9.0, 9.0)), *((10 * i + 1, x) for i, x in reversed(list(enumerate(nodes))))]
        (tmp_path / f"{form}.bdf").write_text("$ model\n" + "\n".join(card.format(i, *x) for i, x in points) + "\nENDDATA\n")
    for model in (mb.read_fe(tmp_path / "K.mtx", mass=tmp_path / "M.mtx", nodes=nodes),
                  mb.read_fe(str(tmp_path / "job.pch"), nodes=nodes),
                  *(mb.read_fe(tmp_path / "job.pch", nodes=tmp_path / f"{form}.bdf") for form in forms)):
        np.testing.assert_allclose(model.nodes, nodes, atol=1e-5)
        found = model.reduced({"root": lambda x: x[:, 0] == 0}, 2)
        np.testing.assert_allclose(found.frequencies, want.frequencies, rtol=1e-7)


@pytest.mark.parametrize(("text", "words"), [
    ("GRID,11,,0,0,0\n", "has no GRID 21"), ("GRID,11,7,0,0,0\n", "in the coordinate system 7"),
    ("GRDSET,,,,,,3\nGRID,11,,0,0,0\n", "in the coordinate system 3"), ("GRID,11,,a,0,0\n", "is no GRID point"),
    ("GRID,11,,1.5-3,0,0\nGRID,21,,2.5D-1,0.,0.\n", "")])
def test_grid_points_that_the_matrices_do_not_fit_are_named(tmp_path: Path, text: str, words: str) -> None:
    lines = [f"DMIG    {name}{0:12d}{6:8d}{2:8d}{0:8d}\nDMIG*   {name:16s}{11:16d}{1:16d}\n*       {11:16d}{1:16d}{1.0:16.9E}\n"
             f"*       {21:16d}{1:16d}{-1.0:16.9E}\nDMIG*   {name:16s}{21:16d}{1:16d}\n*       {21:16d}{1:16d}{1.0:16.9E}"
             for name in ("KAAX", "MAAX")]
    (tmp_path / "job.pch").write_text("\n".join(lines))
    (tmp_path / "grid.bdf").write_text(text)
    if not words:
        np.testing.assert_allclose(mb.read_fe(tmp_path / "job.pch", nodes=tmp_path / "grid.bdf").nodes[:, 0], [1.5e-3, 0.25])
        return
    with pytest.raises(mb.OptionError, match=words):
        mb.read_fe(tmp_path / "job.pch", nodes=tmp_path / "grid.bdf")


@pytest.mark.parametrize(("name", "more", "words"), [
    ("K.mtx", {"mass": "K.mtx", "E": E}, "E = 2"), ("K.mtx", {"mass": "K.mtx", "unit": 1e-3}, "unit = 0.001: of matrices"),
    ("job.pch", {"mass": "K.mtx"}, "mass = "), ("job.sti", {"order": 1}, "order = 1"),
    ("a.inp", {"nodes": [[0, 0, 0]]}, "nodes = ")])
def test_options_that_a_file_has_no_use_for_are_refused(tmp_path: Path, name: str, more: Any, words: str) -> None:
    (tmp_path / name).write_text("")
    with pytest.raises(mb.OptionError, match=words):
        mb.read_fe(tmp_path / name, **more)


def test_a_tangled_element_is_named(tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    meshio = pytest.importorskip("meshio")
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float)
    meshio.Mesh(corners, [("hexahedron", np.array([[0, 2, 1, 3, 4, 6, 5, 7]]))]).write(tmp_path / "a.vtk")
    with pytest.raises(mb.OptionError, match=r"a\.vtk: .*corners of elements|folded"):
        mb.read_fe(tmp_path / "a.vtk", **STEEL)


def test_an_element_that_is_there_twice_is_named(tmp_path: Path) -> None:
    """With its corners in another order."""
    pytest.importorskip("skfem")
    meshio = pytest.importorskip("meshio")
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], dtype=float)
    meshio.Mesh(corners, [("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4], [1, 2, 0, 3]]))]).write(tmp_path / "a.vtk")
    with pytest.raises(mb.OptionError, match=r"a\.vtk: 1 of its elements are in it twice"):
        mb.read_fe(tmp_path / "a.vtk", **STEEL)


def test_files_of_calculix_are_in_the_order_of_its_list_of_freedoms(tmp_path: Path) -> None:
    """Written as CalculiX writes them, with rows in another order than the nodes."""
    fem = pytest.importorskip("skfem")
    assert fem
    job = block(tmp_path / "job.inp", (0.4, 0.1, 0.1), (2, 1, 1))
    model = mb.read_fe(job, E=E, density=DENSITY, order=1)
    order = np.random.default_rng(3).permutation(model.K.shape[0])
    (tmp_path / "job.dof").write_text("\n".join(f"{i // 3 + 1}.{i % 3 + 1}" for i in order))
    for end, matrix in (("sti", model.K), ("mas", model.M)):
        moved = matrix[order][:, order].tocoo()
        (tmp_path / f"job.{end}").write_text("\n".join(
            f"{i + 1} {j + 1} {v:.13e}" for i, j, v in zip(moved.row, moved.col, moved.data, strict=True) if i <= j))
    found = mb.read_fe(tmp_path / "job.sti")
    assert abs(found.K - model.K).max() < 1e-9 * abs(model.K).max()
    assert list(found.sets["RIGHT"]) == list(model.sets["RIGHT"])


@pytest.mark.slow
def test_matrices_of_calculix_itself_are_those_assembled_here(tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: calculix-ccx)")
    step = ("*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7800.\n*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n*STEP\n"
            "*FREQUENCY, SOLVER=MATRIXSTORAGE\n10\n*END STEP\n")
    job = block(tmp_path / "job.inp", (0.6, 0.1, 0.1), (6, 2, 2), step)
    subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    found, model = mb.read_fe(tmp_path / "job.sti"), mb.read_fe(job, E=E, density=DENSITY, order=1)
    for theirs, own in ((found.K, model.K), (found.M, model.M)):
        assert abs(theirs - own).max() < 1e-12 * abs(own).max()


@pytest.mark.parametrize(("name", "content", "more", "words"), [
    ("none.msh", None, {}, "there is no such file"), ("job.sti", "1 1 2.0", {}, "job.dof"), ("K.mtx", "x", {}, "mass = None"),
    ("K.mtx", "x", {"mass": "K.mtx"}, "is damaged, or of another kind"), ("job.pch", "", {}, "no DMIG matrix KAAX"),
    ("job.pch", "DMIG    KAAX           x       1", {}, "is not one of a DMIG matrix"), ("a.inp", "", {}, "E = None"),
    ("a.inp", "", {"E": E}, "density = None"), ("a.inp", "", {"E": E, "density": 1.0, "nu": 0.5}, "nu = 0.5"),
    ("a.inp", "", {"E": E, "density": 1.0, "order": 3}, "order = 3"),
])
def test_what_is_missing_or_damaged_is_named(tmp_path: Path, name: str, content: Any, more: Any, words: str) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(mb.OptionError) as refused:
        mb.read_fe(path, **{key: tmp_path / value if isinstance(value, str) else value for key, value in more.items()})
    assert words in str(refused.value)


@pytest.mark.parametrize(("content", "words"), [
    ("nonsense", "it has no solid cells"), ("*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE=C3D8, ELSET=A\n1, 1, 2, 3, 4, 5, 6, 7, 8\n",
                                            "meshio cannot read it"),
    ("*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT, TYPE=B31, ELSET=A\n1, 1, 2\n", "it has no solid cells (line)")])
def test_a_mesh_that_is_no_solid_is_refused(tmp_path: Path, content: str, words: str) -> None:
    pytest.importorskip("skfem")
    pytest.importorskip("meshio")
    (tmp_path / "a.inp").write_text(content)
    with pytest.raises(mb.OptionError) as refused:
        mb.read_fe(tmp_path / "a.inp", **STEEL)
    assert words in str(refused.value)


def test_sets_are_named_where_one_is_not_there(tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    model = mb.read_fe(block(tmp_path / "a.inp", (1, 0.2, 0.2), (2, 1, 1)), **STEEL)
    for where, words in (("bore", "'bore' is no set of nodes of the model: it has 'LEFT', 'RIGHT', 'ALL'"),
                         (lambda x: x, "return 45 of True and False")):
        with pytest.raises(mb.OptionError, match=words.replace("(", r"\(")):
            model.reduced({"root": where})


def test_a_file_of_no_known_kind_is_refused_before_its_material_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "beam.py").write_text("E = 2e11")
    with pytest.raises(mb.OptionError, match=r"'\.py' is no kind of file that is read"):
        mb.read_fe(tmp_path / "beam.py")
