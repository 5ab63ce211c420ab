"""Finite-element models from files: matrices as CalculiX, Nastran and Matrix Market write them, and meshes of solids, read by
meshio and assembled by scikit-fem (`pip install 'mbdae[fe]'`)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.errors import NamesAttributes, OptionError, naming_arguments
from mbdae.inputs.matrices import Solid, assembled, package
from mbdae.inputs.reduced import ReducedBody
from mbdae.values import Array, array, flag, number, option, shown, text, whole

#: ending of a file of matrices -> the options that it needs, and its kind
OPTIONS: dict[str, tuple[tuple[str, ...], str]] = {
    ".sti": ((), "matrices of CalculiX"), ".mas": ((), "matrices of CalculiX"), ".pch": (("nodes",), "matrices of Nastran"),
    ".mtx": (("mass", "nodes"), "matrices")}
MATRICES = " (matrices are in kg, N/m and m)"
NASTRAN = {"K": ("KAAX", "KGG", "KAA", "K"), "M": ("MAAX", "MGG", "MAA", "M")}  #: names under which DMIG writes the matrices


@dataclass(frozen=True, eq=False, repr=False)
class FiniteElementModel(NamesAttributes):
    """M, K and nodes of a finite-element model that was read by `read_fe`, with its sets of nodes."""

    M: Any  #: (f k, f k) kg, SciPy sparse; freedoms node by node, ux uy uz and with f = 6 rx ry rz
    K: Any  #: (f k, f k) N/m
    nodes: Array  #: (k, 3) m
    sets: dict[str, Array] = field(default_factory=dict)  #: name -> numbers of its nodes, from 0
    solid: Solid | None = field(default=None)  #: what was assembled here, by which stresses and stiffening are known

    def select(self, where: Any) -> Any:
        """Numbers of nodes: those of a set by its name, as they are, or where a function of all nodes (k, 3), m, is True."""
        if isinstance(where, str):
            if where not in self.sets:
                raise OptionError(f"{where!r} is no set of nodes of the model: it has {', '.join(map(repr, self.sets)) or 'none'}"
                                  f"; give numbers of nodes, or a function of the nodes (k, 3) that is True where they belong")
            return self.sets[where]
        if not callable(where):
            return np.asarray(where)
        found = np.asarray(where(self.nodes))
        if found.shape != (len(self.nodes),) or found.dtype != bool:
            raise OptionError(f"the function that selects nodes returns {shown(found)}: return {len(self.nodes)} of True and "
                              f"False, one for each node")
        return np.flatnonzero(found)

    def reduced(self, interfaces: Mapping[str, Any], modes: int | None = None, accelerations: bool = False,
                stiffening: Any = False, accuracy: float = 1e-3, up_to: float | None = None, free: bool = False) -> ReducedBody:
        """`ReducedBody.craig_bampton` of this model, or with free=True its `free_interface`; interfaces: {name: set of nodes, see
        `select`}. With a mesh that was assembled here stresses are known, and stiffening=True needs no function."""
        if not isinstance(interfaces, Mapping):
            raise OptionError(f"interfaces = {shown(interfaces)}: give a dict {{'root': 'name of a set'}}")
        at = {name: self.select(where) for name, where in interfaces.items()}
        if self.solid is not None and stiffening is True:
            stiffening = self.solid.second_force
        stress, edges = (None, None) if self.solid is None else (self.solid.stress, self.solid.edges)
        free = option("free", free, flag, "give True or False")
        accelerations = False if free else accelerations  # deformations by accelerations are among those of free modes
        return ReducedBody._reduced(free, (self.M, self.K, self.nodes, at), modes, accelerations, stiffening, stress, accuracy,
                                    up_to, edges)


@naming_arguments
def read_fe(path: Any, mass: Any = None, nodes: Any = None, E: float | None = None, nu: float | None = None,
            density: float | None = None, unit: float | None = None, order: int | None = None) -> FiniteElementModel:
    """A finite-element model from files.

    CalculiX, "job.sti": the matrices of *FREQUENCY, SOLVER=MATRIXSTORAGE, beside it job.mas, job.dof and the input job.inp.
    Nastran, "job.pch": DMIG matrices KAAX and MAAX (or KGG, MGG); nodes: the file of its GRID points, which are matched by their
    numbers, or (k, 3), m, by rising number. Matrix Market, "K.mtx"; mass: the file of M; nodes: (k, 3), m, or a file of a mesh
    with them. Any mesh of tetrahedra or hexahedra that meshio reads, assembled by scikit-fem as a solid with Young's modulus E
    (Pa), Poisson's ratio nu (None: 0.3) and density (kg/m^3). unit: length of the unit of the mesh, m (None: 1; 1e-3: a mesh in
    mm); order: of the elements, 1 or 2 (None: 2): with 1 bending is far too stiff in tetrahedra. With order 2 nodes on edges are
    new ones, which belong to a set where both ends do. Options that a file of this kind has no use for are refused.

    Matrices are in kg and N/m. OptionError names what is missing or does not fit."""
    where = Path(option("path", str(path) if isinstance(path, Path) else path, text, "give the path of a file"))
    if not where.is_file():
        raise OptionError(f"path = {shown(str(where))}: there is no such file")
    kind = where.suffix.lower()
    given = {"mass": mass, "nodes": nodes, "E": E, "nu": nu, "density": density, "unit": unit, "order": order}
    used, what = OPTIONS.get(kind, (("E", "nu", "density", "unit", "order"), "a mesh that is assembled"))
    if unused := [name for name, value in given.items() if value is not None and name not in used]:
        raise OptionError(f"{unused[0]} = {shown(given[unused[0]])}: of {what}, as {where.name}, nothing depends on it: "
                          f"{', '.join(used) or 'no option'} is read; leave it out{MATRICES if kind in OPTIONS else ''}")
    if kind in (".sti", ".mas"):
        return _calculix(where)
    if kind == ".pch":
        K, grid = _dmig(where, "K")
        M, others = _dmig(where, "M")
        if others != grid:
            apart = sorted({*others} ^ {*grid})
            raise OptionError(f"{where.name}: its matrices K and M have other grid points, such as {apart[0]} of one alone")
        return FiniteElementModel(M, K, _places(nodes, where, grid))
    if kind == ".mtx":
        from scipy.io import mmread

        if mass is None:
            raise OptionError(f"mass = None: give the file of the mass matrix beside the stiffness {where.name}")
        M, K = (_read(p, lambda p: sp.csc_matrix(mmread(p))) for p in (Path(mass), where))
        return FiniteElementModel(M, K, _places(nodes, where, None))
    if kind not in package("meshio").extension_to_filetypes:
        raise OptionError(f"path = {shown(str(where))}: '{kind}' is no kind of file that is read: give CalculiX's .sti, "
                          f"Nastran's .pch, Matrix Market's .mtx, or a mesh that meshio reads, such as .msh, .inp, .vtk, .bdf")
    young = option("E", E, number, "give Young's modulus, Pa: a mesh alone has no stiffness", above=0)
    rho = option("density", density, number, "give the density, kg/m^3: a mesh alone has no mass", above=0)
    poisson = option("nu", 0.3 if nu is None else nu, number, "give Poisson's ratio, up to 0.499", above=-1, most=0.499)
    length = option("unit", 1.0 if unit is None else unit, number, "give the length of the unit of the mesh, m", above=0)
    degree = option("order", 2 if order is None else order, whole, "give 1 or 2", least=1, most=2)
    M, K, places, sets, solid = assembled(_mesh(where), young, poisson, rho, length, degree, where.name)
    return FiniteElementModel(M, K, places, sets, solid)


def _mesh(path: Path) -> Any:
    """What meshio reads from a file."""
    meshio = package("meshio")
    try:
        return meshio.read(path)
    except (Exception, SystemExit) as error:  # its readers raise anything at damaged files, and end the process at unknown names
        raise OptionError(f"{path.name}: meshio cannot read it ({type(error).__name__}: {error})") from None


def _read(path: Path, read: Callable[[Path], Any]) -> Any:
    try:
        return read(path)
    except OSError:
        raise OptionError(f"{path.name}: there is no such file in {path.parent}, or it cannot be read") from None
    except (ValueError, TypeError, IndexError) as error:
        raise OptionError(f"{path.name}: it is damaged, or of another kind ({error})") from None


def _places(given: Any, beside: Path, numbers: list[int] | None) -> Array:
    """Nodes (k, 3), m, as given or from the file of a mesh; numbers: of the grid points of Nastran's matrices."""
    if given is None:
        raise OptionError(f"nodes = None: {beside.name} has none; give (k, 3), m, or the file of a mesh with them")
    if numbers is not None and isinstance(given, str | Path) and (at := _grid_points(Path(given))):
        if missing := [n for n in numbers if n not in at]:
            raise OptionError(f"{Path(given).name} has no GRID {missing[0]}, which is in the matrices of {beside.name}")
        return np.array([at[n] for n in numbers])
    count = None if numbers is None else len(numbers)
    found = np.asarray(_mesh(Path(given)).points, dtype=float) if isinstance(given, str | Path) else option(
        "nodes", given, array, "give (k, 3), m, or the file of a mesh")
    if count is not None and len(found) != count:
        raise OptionError(f"nodes: {len(found)} of them, and matrices for {count}: give those alone that the matrices have")
    return found


def _grid_points(path: Path) -> dict[int, Array]:
    """Places (3,), m, of the GRID points of Nastran by their numbers: fields of 8, of 16 (after *) or between commas."""
    found: dict[int, Array] = {}
    written = _read(path, lambda p: p.read_text(errors="replace"))
    lines = [line.split("$")[0].upper().expandtabs(8) for line in written.splitlines()]
    for line, more in zip(lines, [*lines[1:], ""], strict=True):
        if not line.startswith(("GRID", "GRDSET")):
            continue
        if "," in line:
            parts = [x.strip() for x in line.split(",")]
        else:
            width, fields = (16, line[8:72].ljust(64) + more[8:72]) if line[:8].strip().endswith("*") else (8, line[8:72])
            parts = ["", *(fields[i : i + width].strip() for i in range(0, len(fields), width))]
        parts += [""] * (7 - len(parts))
        if any(system not in ("", "0", "-1") for system in (parts[2], parts[6])):
            raise OptionError(f"{path.name}: the line {shown(line.rstrip())} states places or freedoms in the coordinate system "
                              f"{parts[2] or parts[6]}: give them in the basic one, 0")
        try:
            if line.startswith("GRID"):
                found[int(parts[1])] = np.array([_real(x) if x else 0.0 for x in parts[3:6]])
        except ValueError:
            raise OptionError(f"{path.name}: the line {shown(line.rstrip())} is no GRID point") from None
    return found


def _real(x: str) -> float:
    """A number as Nastran writes it: 1.5, 1.5E-3, 1.5D-3 or 1.5-3."""
    return float(re.sub(r"(?<=[\d.])D?(?=[+-])", "E", x.upper()))


def _calculix(path: Path) -> FiniteElementModel:
    """Matrices of CalculiX: half of a symmetric matrix, "row column value" per line; rows in `job.dof`, "node.freedom"."""
    dof = _read(path.with_suffix(".dof"), lambda p: [line.split(".") for line in p.read_text().split()])
    n = len(dof)
    K, M = (_read(path.with_suffix(end), lambda p: _half(np.array(p.read_text().split(), dtype=float).reshape(-1, 3), n))
            for end in (".sti", ".mas"))
    numbers, freedoms = (np.array([int(entry[i]) for entry in dof]) for i in (0, 1))
    order = np.lexsort((freedoms, numbers))
    mesh = _mesh(path.with_suffix(".inp"))
    known = np.unique(numbers)
    if len(known) * 3 != n or not np.array_equal(freedoms[order], np.tile([1, 2, 3], len(known))):
        raise OptionError(f"{path.stem}.dof has not the freedoms 1, 2, 3 of every node: give the job without supports, ties and "
                          f"rotations of nodes")
    if known[-1] > len(mesh.points) and len(known) != len(mesh.points):
        raise OptionError(f"{path.stem}.inp has {len(mesh.points)} nodes, the matrices have {len(known)}, up to number "
                          f"{known[-1]}: number the nodes from 1 without gaps")
    at = known - 1 if known[-1] <= len(mesh.points) else np.arange(len(known))
    place = {int(node): i for i, node in enumerate(at)}
    sets = {name: np.array([place[int(i)] for i in members if int(i) in place], dtype=int)
            for name, members in mesh.point_sets.items()}
    return FiniteElementModel(M[order][:, order], K[order][:, order], np.asarray(mesh.points, dtype=float)[at], sets)


def _half(entries: Array, n: int) -> Any:
    """The whole of a symmetric matrix (n, n) of which (rows from 1, columns, values) are a half."""
    i, j = entries[:, 0].astype(int) - 1, entries[:, 1].astype(int) - 1
    half = sp.csr_matrix((entries[:, 2], (i, j)), shape=(n, n))
    return half + half.T - sp.diags(half.diagonal())


def _dmig(path: Path, of: str) -> tuple[Any, list[int]]:
    """The matrix K or M that a Nastran file holds as DMIG, fields of 8 or, after *, of 16 characters, and its grid points."""
    heads: dict[str, list[tuple[int, int, int, int, float]]] = {}
    name, column = "", (0, 0)
    for line in _read(path, lambda p: p.read_text()).splitlines():
        if not line.startswith(("DMIG", "*")):
            continue
        wide = line[:8].strip().endswith("*") or line.startswith("*")
        size = 16 if wide else 8
        parts = [line[:8], *(line[at : at + size].strip() for at in range(8, 72, size))]
        try:
            if line.startswith("DMIG"):
                name = parts[1]
                if parts[2] == "0":
                    heads.setdefault(name, [])
                    continue
                column, rest = (int(parts[2]), int(parts[3])), parts[5:]
            else:
                rest = parts[1:]
            for k in range(0, len(rest) - 2, 4):
                if rest[k]:
                    value = _real(rest[k + 2])
                    heads[name].append((int(rest[k]), int(rest[k + 1]), *column, value))
        except (ValueError, IndexError, KeyError):
            raise OptionError(f"{path.name}: the line {shown(line.rstrip())} is not one of a DMIG matrix") from None
    found = next((name for name in NASTRAN[of] if heads.get(name)), None)
    if found is None:
        raise OptionError(f"{path.name}: it has no DMIG matrix {' or '.join(NASTRAN[of])}, but {', '.join(heads) or 'none'}")
    grid = sorted({node for i, _, j, _, _ in heads[found] for node in (i, j)})
    freedoms = max(c for _, c, _, _, _ in heads[found])
    f, place = 6 if freedoms > 3 else 3, {node: i for i, node in enumerate(grid)}
    entries = np.array([(place[i] * f + c, place[j] * f + d, value) for i, c, j, d, value in heads[found]])
    return _half(entries, f * len(grid)), grid


