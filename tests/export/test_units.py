"""FMI units: their files, and runs of the compiled library by its C interface; by FMPy where it is installed."""

from __future__ import annotations

import ctypes
import re
import xml.etree.ElementTree as ET
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from exports.units import Unit, has_fmpy, off

import mbdae as mb
from mbdae.export.fmi import base_units

END, PUSH = 0.5, 0.4
Vector = ctypes.POINTER(ctypes.c_double)


def four_bar(push=0.0, mass=0.5):
    """A four-bar whose crank a torque turns: the signal `push`."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    points = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(f"link {i}", points[i], points[i + 1], mass=mass if i == 1 else 0.5) for i in range(3)]
    bodies = [s.ground, *links, s.ground]
    for i, name in enumerate("ABCD"):
        extra = {"torque": s.signal("push", push)} if name == "A" else {"damper": 0.02} if name == "B" else {}
        s.revolute(name, bodies[i], bodies[i + 1], at=points[i], **extra)
    return s


class Library:
    """The compiled library of a unit, its variables by their names; `made` is an instance."""

    def __init__(self, file, folder):
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
            (binary,) = [name for name in archive.namelist() if name.startswith("binaries/")]
        self.root = ET.parse(folder / "modelDescription.xml").getroot()
        self.variables = {v.get("name"): v.attrib for v in self.root.find("ModelVariables")}
        self.c = ctypes.CDLL(str(folder / binary))
        self.c.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p
        token = self.root.get("instantiationToken").encode()
        self.said = []
        log = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
        self.log = log(lambda environment, status, category, message: self.said.append(message.decode()))
        self.made = ctypes.c_void_p(self.c.fmi3InstantiateCoSimulation(
            b"one", token, None, False, False, False, False, None, ctypes.c_size_t(0), None, self.log, None))
        assert self.made
        assert not self.c.fmi3InstantiateCoSimulation(b"one", b"{another}", None, False, False, False, False, None,
                                                      ctypes.c_size_t(0), None, None, None)

    def references(self, names):
        found = np.array([int(self.variables[n]["valueReference"]) for n in names], dtype=np.uint32)
        return found, found.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(names))

    def set(self, **values):
        _keep, at, count = self.references([name.replace("_of_", ".") for name in values])
        numbers = np.array(list(values.values()), dtype=float)
        assert self.c.fmi3SetFloat64(self.made, at, count, numbers.ctypes.data_as(Vector), count) == 0

    def get(self, names):
        _keep, at, count = self.references(names)
        found = np.full(len(names), np.nan)
        assert self.c.fmi3GetFloat64(self.made, at, count, found.ctypes.data_as(Vector), count) == 0
        return found

    def begin(self, **values):
        assert self.c.fmi3Reset(self.made) == 0
        self.set(**values)
        assert self.c.fmi3EnterInitializationMode(self.made, True, ctypes.c_double(1e-7), ctypes.c_double(0), False,
                                                  ctypes.c_double(0)) == 0
        assert self.c.fmi3ExitInitializationMode(self.made) == 0

    def step(self, t, length):
        flags, reached = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
        status = self.c.fmi3DoStep(self.made, ctypes.c_double(t), ctypes.c_double(length), True, *map(ctypes.byref, flags),
                                   ctypes.byref(reached))
        if status:
            raise RuntimeError(self.said[-1])
        assert reached.value == t + length

    def slopes(self, unknowns, knowns, seed):
        (_u, at_u, n), (_k, at_k, k) = self.references(unknowns), self.references(knowns)
        out, seed = np.full(len(unknowns), np.nan), np.array(seed, dtype=float)
        assert self.c.fmi3GetDirectionalDerivative(self.made, at_u, n, at_k, k, seed.ctypes.data_as(Vector), k,
                                                   out.ctypes.data_as(Vector), n) == 0
        return out

    def named(self, **attributes):
        return [n for n, v in self.variables.items() if all(v.get(key) == value for key, value in attributes.items())]


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unit")
    export = mb.export(four_bar(), "fmi")
    file = export.save(folder / "four_bar.fmu")
    return SimpleNamespace(export=export, library=Library(file, folder / "unzipped"), file=file)


def test_the_description_names_units_states_inputs_and_outputs(unit):
    of = unit.library
    push = of.variables["push"]
    assert (push["causality"], push["variability"], push["start"], push["unit"]) == ("input", "continuous", "0.0", "N m")
    state = of.variables["link 0.theta"]
    assert (state["unit"], state["initial"]) == ("rad", "exact")
    assert of.variables["der(link 0.theta)"]["derivative"] == state["valueReference"]
    assert {"A.angle", "A.rate", "link 1.position[0]", "D.force[1]"} <= set(of.named(causality="output"))
    assert float(of.variables["link 1.mass"]["start"]) == 0.5
    units = {u.get("name"): u.find("BaseUnit").attrib for u in of.root.find("UnitDefinitions")}
    assert units["N m"] == {"kg": "1", "m": "2", "s": "-2"}
    assert units["rad/s"] == {"rad": "1", "s": "-1"}
    assert unit.export.inputs["signals"][0].name == "push"
    assert unit.export["rates"] == "four_bar_rates"


def test_units_in_base_units():
    assert base_units("N s/m") == {"kg": 1, "m": 0, "s": -1}
    assert base_units("(rad/s)/s") == {"rad": 1, "s": -2}
    assert base_units("kg m^2") == {"kg": 1, "m": 2}
    assert base_units("bar") is None


def test_co_simulation_is_the_run_of_mbdae_for_any_input_and_parameter(unit):
    """The torque and the mass are set in the unit; joints stay closed, forces are those of the sensors."""
    of, names = unit.library, ["A.angle", "D.rate", "C.force[0]", "C.force[1]", "link 1.position[1]"]
    times, inertia = np.linspace(0, END, 6), {e.name: e.value for e in mb.export(four_bar(0.0, 0.8)).inputs["p"]}["link 1.Jzz"]
    of.begin(push=PUSH, **{"link 1_of_mass": 0.8, "link 1_of_Jzz": inertia})
    rows = [of.get(names)]
    for t in times[:-1]:
        of.step(float(t), float(times[1]))
        rows.append(of.get(names))
    r = four_bar(PUSH, 0.8).simulate(END, accuracy=1e-8, outputs=times)
    for i, name in enumerate(names):
        wanted = np.asarray(r.read(name))
        assert np.max(np.abs(np.array(rows)[:, i] - wanted)) < 1e-6 * np.max(np.abs(wanted)), name
    x, y, theta, x1, y1, theta1 = of.get([f"link {k}.{c}" for k in (0, 1) for c in ("x", "y", "theta")])
    half = np.array([0.15 * np.sin(theta), -0.15 * np.cos(theta)])  # from the joint B to the middle of link 0, as drawn upright
    to_b = np.array([[np.cos(theta1), -np.sin(theta1)], [np.sin(theta1), np.cos(theta1)]]) @ [-0.25, -0.15]
    assert np.max(np.abs(np.array([x, y]) - half - [x1, y1] - to_b)) < 1e-12


def test_a_start_that_is_disturbed_is_closed(unit):
    of, states = unit.library, [n for n in unit.library.named(causality="local") if not n.startswith("der(")]
    of.begin()
    before = of.get(states)
    of.begin(**{"link 1_of_x": before[states.index("link 1.x")] + 1e-3})
    moved = of.get(states)
    assert 1e-5 < np.max(np.abs(moved - before)) < 1e-2
    x, y, theta, x1, y1, theta1 = of.get([f"link {k}.{c}" for k in (0, 1) for c in ("x", "y", "theta")])
    half = np.array([0.15 * np.sin(theta), -0.15 * np.cos(theta)])
    to_b = np.array([[np.cos(theta1), -np.sin(theta1)], [np.sin(theta1), np.cos(theta1)]]) @ [-0.25, -0.15]
    assert np.max(np.abs(np.array([x, y]) - half - [x1, y1] - to_b)) < 1e-12


def test_directional_derivatives_are_slopes(unit):
    """Of derivatives and outputs, by a state, the input and a parameter at once; central differences of step 1e-6."""
    of, known = unit.library, ["link 0.theta", "push", "link 1.mass", "link 2.vx"]
    of.begin(push=PUSH)
    unknown, seed, h, found = of.named(initial="calculated"), [0.7, 1.0, 0.2, -0.5], 1e-6, []
    at = of.get(known)
    for side in (h, -h):
        of.set(**{name.replace(".", "_of_"): value for name, value in zip(known, at + side * np.array(seed), strict=True)})
        found.append(of.get(unknown))
    of.set(**{name.replace(".", "_of_"): value for name, value in zip(known, at, strict=True)})
    wanted = (found[0] - found[1]) / (2 * h)
    assert np.max(np.abs(of.slopes(unknown, known, seed) - wanted)) < 1e-7 * np.max(np.abs(wanted))


def test_a_state_is_kept_and_put_back(unit):
    of, state = unit.library, ctypes.c_void_p()
    of.begin(push=PUSH)
    of.step(0.0, 0.1)
    assert of.c.fmi3GetFMUState(of.made, ctypes.byref(state)) == 0
    of.step(0.1, 0.1)
    once = of.get(["A.angle", "time"])
    assert of.c.fmi3SetFMUState(of.made, state) == 0
    assert of.get(["time"])[0] == 0.1
    of.step(0.1, 0.1)
    assert np.array_equal(of.get(["A.angle", "time"]), once)
    assert of.c.fmi3FreeFMUState(of.made, ctypes.byref(state)) == 0
    assert not state


def test_a_negative_mass_is_refused(unit):
    """As the scene refuses it, and gains of Baumgarte; products of inertia and other parameters may have either sign."""
    library = unit.library
    (mass,) = [n for n in library.variables if n.endswith("link 1.mass")]
    stiff = next(n for n in library.variables if n.endswith("damping"))
    assert float(library.variables[mass]["min"]) == 0
    assert "min" not in library.variables[stiff]
    gain = "baumgarte_velocity"
    assert float(library.variables[gain]["min"]) == 0
    for name, value, status in ((gain, -5.0, 3), (gain, 20.0, 0), (mass, -0.1, 3), (mass, np.nan, 3), (mass, 0.7, 0),
                                (stiff, -0.02, 0)):
        _keep, at, count = library.references([name])
        number = np.array([value])
        assert library.c.fmi3SetFloat64(library.made, at, count, number.ctypes.data_as(Vector), count) == status
    library.begin()


def test_the_same_scene_gives_the_same_file(unit, tmp_path):
    again = mb.export(four_bar(), "fmi")
    assert again.text == unit.export.text
    with zipfile.ZipFile(unit.file) as archive:
        assert {name.partition("/")[0] for name in archive.namelist()} == {"modelDescription.xml", "sources", "binaries"}
        assert re.search(r"Status fmi3DoStep\(", archive.read("sources/four_bar.c").decode())


def cranks():
    """Three parallel cranks that carry a bar: falling, they come into one line with it."""
    s = mb.Scene("cranks", gravity=(3, -9.81, 0))
    bar = s.link("bar", (0, 1), (2, 1), mass=1.0)
    for i in range(3):
        crank = s.link(f"crank {i}", (i, 0), (i, 1), mass=0.5)
        s.revolute(f"A{i}", s.ground, crank, at=(i, 0))
        s.revolute(f"B{i}", crank, bar, at=(i, 1))
    return s


def test_where_a_unit_ends_dependent_rows_are_named(tmp_path, unit):
    """In a singular position by the rows; an error elsewhere names none."""
    of = Library(mb.export(cranks(), "fmi").save(tmp_path / "cranks.fmu"), tmp_path / "unzipped")
    of.begin()
    with pytest.raises(RuntimeError, match=r"at t = 0\.7\d+ s these constraint rows depend on each other, .*: A\d\.x.* B2\.x$"):
        of.step(0.0, 2.0)
    unit.library.begin()
    with pytest.raises(RuntimeError, match=r"the step must be positive$"):
        unit.library.step(0.0, 0.0)


def bouncing():
    s = mb.Scene("stop", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), limits=(-1.0, 1.0),
               stop=mb.Stop(1e4, 10.0))
    return s


@pytest.mark.parametrize(("make", "form", "words"), [
    (bouncing, None, "contacts of 'hinge' are impacts"), (four_bar, mb.GGL(), "a unit of FMI has y' = f"),
    (lambda: mb.Revolute, None, "only a scene moves"),
])
def test_refusals_say_why(make, form, words):
    with pytest.raises(mb.OptionError, match=words):
        mb.export(make(), "fmi", form)


def test_without_a_compiler_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(mb.OptionError, match="Install a C compiler"):
        mb.export(four_bar(), "fmi").save(tmp_path / "a.fmu")


@pytest.mark.skipif(not has_fmpy(), reason="FMPy is not installed")
@pytest.mark.filterwarnings("ignore")
def test_fmpy_validates_and_runs_a_unit(unit):
    scene, times = four_bar(), np.linspace(0, END, 6)
    with Unit(unit.file) as found:
        assert found.problems == []
        assert off(scene, found, times, found.co_simulated(times, 1e-6), 1e-8)[0] < 1e-6
        assert off(scene, found, times, found.exchanged(times, 1e-9), 1e-8)[0] < 1e-6
        assert off(scene, found, times, found.by_fmpy(times, 1e-8), 1e-8)[0] < 1e-4  # BDF: a hundred times its tolerance and more
