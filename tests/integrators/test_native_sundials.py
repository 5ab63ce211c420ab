"""IDA and CVODE called by address against the Python interface of scikit-sundae, and what may go wrong."""

from __future__ import annotations

import ctypes
import gc
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import sksundae.cvode
import sksundae.ida
from dae_problems import Explicit, blow_up, circle_ode, decay, pendulum
from recursive_scenes import four_bar

import mbdae as mb
from mbdae.errors import OptionError, SolverError
from mbdae.formulations import system_for
from mbdae.integrators.constant import rate_jacobian
from mbdae.native import sundials, sundials_library
from mbdae.native.equations import CEquations, Equations, Pointer
from mbdae.process import Signals
from mbdae.system.dae import DAE
from mbdae.system.prepare import prepare

HERE = Path(__file__).parents[2] / "mbdae" / "native"  #: sources in C, which a wheel leaves out
posix = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="timers of POSIX")

HARMONIC = """
#include "core.h"
static int residual(void *self, double t, const double *y, const double *yp, double *out) {
  (void)self, (void)t; out[0] = yp[0] - y[1]; out[1] = yp[1] + y[0]; return DONE;
}
static int jacobian(void *self, double t, const double *y, const double *yp, double *fy, double *fyp) {
  (void)self, (void)t, (void)y, (void)yp; fy[0] = 1; fy[1] = -1; fyp[0] = fyp[1] = 1; return DONE;
}
static int rates(void *self, double t, const double *y, double *out) {
  (void)self, (void)t; out[0] = y[1]; out[1] = -y[0]; return DONE;
}
"""


class Harmonic(Explicit):
    """x' = v, v' = -x; with `compiled` evaluated by C alone, whose Jacobian gives 4 entries of a pattern."""

    def __init__(self):
        super().__init__(lambda t, y, yp, out: np.array([yp[0] - y[1], yp[1] + y[0]]), [1.0, 0.0], [0.0, -1.0],
                         lambda t, y, yp, cj, out: np.array([[cj, -1.0], [1.0, cj]]))

    def compiled(self, folder):
        source, built = folder / "harmonic.c", folder / "harmonic.so"
        jacobian = "fy[0] = 0; fy[1] = 1; fy[2] = -1; fy[3] = 0; fyp[0] = fyp[3] = 1; fyp[1] = fyp[2] = 0"
        text = HARMONIC.replace("fy[0] = 1; fy[1] = -1; fyp[0] = fyp[1] = 1", jacobian).replace("static int", "API int")
        source.write_text(text, encoding="utf-8")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", f"-I{HERE}", "-o", str(built), str(source)], check=True)
        library = ctypes.CDLL(str(built))
        addresses = [ctypes.cast(getattr(library, name), Pointer).value for name in ("residual", "jacobian", "rates")]
        self.native = Equations(CEquations(None, 2, 4, *addresses, None), library)
        return self


def by_scikit_sundae(system, solver, t_end):
    """Times (m,) and states (m, n) of the accepted steps as the Python interface of scikit-sundae makes them."""
    options = {"rtol": solver.rtol, "atol": solver.rtol * system.scale, "max_order": solver.max_order or 0}
    if isinstance(solver, mb.IDA):
        if system.sparse:
            options |= {"linsolver": "sparse", "sparsity": system.sparsity}
        method = sksundae.ida.IDA(lambda t, y, yp, out: system.residual(t, y, yp, out),
                                  jacfn=lambda t, y, yp, res, cj, out: system.jacobian(t, y, yp, cj, out), **options)
        method.init_step(system.t0, system.y0, system.yp0)
    else:
        def jacobian(t, y, yp, out):
            out[...] = rate_jacobian(system, t, y, yp)

        options["max_order"] = options["max_order"] or {"Adams": 12, "BDF": 5}[solver.method]
        method = sksundae.cvode.CVODE(lambda t, y, out: system.rhs(t, y, out), jacfn=jacobian, method=solver.method, **options)
        method.init_step(system.t0, system.y0)
    steps = [(system.t0, np.array(system.y0))]
    while steps[-1][0] < t_end:
        made = method.step(t_end, method="onestep", tstop=t_end)
        assert made.success
        steps.append((made.t, np.array(made.y)))
    return np.array([t for t, _ in steps]), np.array([y for _, y in steps])


def linkage(form, highest_index=1):
    return lambda: system_for(prepare(four_bar()), form, highest_index)


PATTERN = (np.abs(np.random.default_rng(1).normal(size=(6, 6))) > 0).astype(float)
CASES = {
    "pendulum": (lambda: pendulum("ggl_rates"), mb.IDA(rtol=1e-7), 1.0),
    "sparse": (lambda: pendulum("ggl_rates", sparsity=PATTERN), mb.IDA(rtol=1e-7), 1.0),
    "four-bar": (linkage(mb.GGL()), mb.IDA(rtol=1e-6), 0.3),
    "four-bar without multipliers": (linkage(mb.Index1(), 0), mb.CVODE(rtol=1e-7), 0.3),
    "ODE": (circle_ode, mb.CVODE(rtol=1e-8), 2.0),
    "stiff ODE": (circle_ode, mb.CVODE(rtol=1e-8, method="BDF"), 2.0),
}


@pytest.mark.filterwarnings("ignore::UserWarning")  # scikit-sundae warns that the given Jacobian replaces its own
@pytest.mark.parametrize("name", CASES)
def test_both_ways_take_the_same_steps(name):
    """IDA, whose iteration ends later here, takes fewer."""
    system, solver, t_end = CASES[name]
    a, (t, y) = solver.solve(system(), t_end), by_scikit_sundae(system(), solver, t_end)
    assert len(a.t) - len(t) <= 0.01 * len(t)
    assert isinstance(solver, mb.IDA) or len(a.t) >= 0.99 * len(t)
    same = len(a.t) == len(t) and np.allclose(a.t, t, rtol=1e-6)
    scale = np.maximum(1.0 if isinstance(solver, mb.IDA) else 1e-3, np.abs(y).max(axis=0))  # multipliers of GGL vanish
    assert np.max(np.abs(a.y[-1] - y[-1]) / scale) < (1e-8 if same else 1e3 * solver.rtol)
    assert np.diff(a.t).min() > 0


def test_equations_by_address(tmp_path, monkeypatch):
    """Equations in C give what call backs give; what they lack, the Jacobian of rates, is called back."""
    for solver in (mb.IDA(rtol=1e-8), mb.CVODE(rtol=1e-8)):
        a = solver.solve(Harmonic().compiled(tmp_path), 20.0, 100)
        b = solver.solve(Harmonic(), 20.0, 100)
        assert a.stats.steps == b.stats.steps
        assert np.abs(a.outputs.y - b.outputs.y).max() < 1e-10
        assert a.outputs.y[:, 0] == pytest.approx(np.cos(a.outputs.t), abs=1e-4)


def test_the_libraries_open_without_scikit_sundae():
    code = "import sys, mbdae.native.sundials as n; print(n.sundials().index.__name__, 'sksundae' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert out[0] in ("int32", "int64")
    assert out[1] == "False"


@pytest.fixture
def opened_anew():
    """SUNDIALS is opened again in the test and after it."""
    sundials.sundials.cache_clear()
    yield
    sundials.sundials.cache_clear()


@posix
def test_libraries_elsewhere_are_found_by_what_is_linked_to_them(monkeypatch, opened_anew):
    """As where conda, or a build from source, left them: there is no folder of a wheel."""
    monkeypatch.setattr(sundials_library, "BESIDE", "nowhere")
    monkeypatch.setattr(sundials_library, "WITHIN", "nowhere")
    assert all(path.stem.startswith("_cy_") for path in sundials_library.files().values())
    exact = np.exp(-1) * np.array([1, 2])
    for solver in (mb.IDA(rtol=1e-6), mb.CVODE(rtol=1e-6)):
        assert solver.solve(decay(), 1.0).y[-1] == pytest.approx(exact, abs=1e-4)
    sparse = DAE(lambda t, y, yp, out: yp + y, [1.0, 2.0], [-1.0, -2.0], sparsity=np.ones((2, 2)))
    assert mb.IDA(rtol=1e-6).solve(sparse, 1.0).y[-1] == pytest.approx(exact, abs=1e-4)


def test_what_cannot_be_opened_is_said(monkeypatch, opened_anew):
    monkeypatch.setattr(sundials_library, "MAJOR", 6)
    with pytest.raises(OptionError, match=r"IDA and CVODE cannot be used here: .* mbdae needs 6\.x: .*; mb\.RadauIIA"):
        mb.IDA(rtol=1e-6).solve(decay(), 1.0)
    monkeypatch.setattr(sundials_library, "BESIDE", "nowhere")
    monkeypatch.setattr(sundials_library, "WITHIN", "nowhere")
    monkeypatch.setattr(sundials_library, "LINKED", {})
    with pytest.raises(OptionError, match="lacks the library core of SUNDIALS"):
        mb.CVODE(rtol=1e-6).solve(decay(), 1.0)


# -- stopping


@posix
@pytest.mark.parametrize(("solver", "compiled"), [
    pytest.param(solver(rtol=1e-10), compiled, id=f"{solver.__name__}-{'compiled' if compiled else 'called back'}",
                 marks=[pytest.mark.slow] * (compiled != (solver is mb.IDA)))
    for solver in (mb.IDA, mb.CVODE) for compiled in (True, False)])
def test_ctrl_c_inside_c(solver, compiled, tmp_path, capfd):
    system = Harmonic().compiled(tmp_path) if compiled else Harmonic()
    before, most = signal.signal(signal.SIGALRM, signal.default_int_handler), 0
    try:
        for wait in np.linspace(0.05, 0.25, 4 if compiled else 12):
            begin = time.perf_counter()
            signal.setitimer(signal.ITIMER_REAL, wait)
            with pytest.raises(KeyboardInterrupt, match="was interrupted at t = ") as stop:
                solver.solve(system, 1e9)
            assert time.perf_counter() - begin < wait + 1.0
            found = stop.value.solution
            assert len(found.t) == len(found.y) == len(found.yp)
            most = max(most, len(found.t))
            assert np.abs(found.y[:, 0] - np.cos(found.t)).max() < 1e-2  # millions of them: pytest.approx takes seconds
            assert signal.getsignal(signal.SIGALRM) is signal.default_int_handler
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert most > 1  # on a busy machine the first waits may end before a step
    assert capfd.readouterr() == ("", "")


def test_limits_end_a_block_of_steps(tmp_path):
    with pytest.raises(SolverError, match=r"max_wall = 0\.2 s") as caught:
        mb.IDA(rtol=1e-8).solve(Harmonic().compiled(tmp_path), 1e9, max_wall=0.2)
    assert 0.2 < caught.value.solution.stats.wall_s < 0.6
    assert caught.value.solution.stats.steps > 1000
    with pytest.raises(SolverError, match="budget of 100 residual") as caught:
        mb.IDA(rtol=1e-8).solve(Harmonic(), 1e9, max_residuals=100)
    assert 100 < caught.value.solution.stats.residuals < 110
    seen = []
    mb.CVODE(rtol=1e-8).solve(Harmonic().compiled(tmp_path), 2e4, progress=lambda t, t_end, stats: seen.append(t))
    assert len(seen) > 1


@pytest.mark.parametrize("solver", [mb.IDA(rtol=1e-6), mb.CVODE(rtol=1e-6)], ids=["IDA", "CVODE"])
def test_steps_before_an_exception_are_kept(solver):
    """They were made in the same call of C that raised."""
    error = KeyboardInterrupt("asked for")

    class Raising(Explicit):
        def residual(self, t, y, yp, out):
            if t > 0.5:
                raise error
            super().residual(t, y, yp, out)

    with pytest.raises(KeyboardInterrupt, match=r"asked for|was interrupted") as caught:
        solver.solve(decay(Raising), 1.0)
    found = caught.value.solution
    assert 0.3 < found.t[-1] <= 0.5
    assert found(0.3) == pytest.approx(np.exp(-0.3) * np.array([1, 2]), abs=1e-4)


def test_what_fails_is_told_and_nothing_is_printed(capfd):
    for pattern in (None, np.ones((2, 2))):
        singular = DAE(lambda t, y, yp, out: np.array([yp[0] + y[0], y[0] - np.exp(-t)]), [1.0, 0.0], [-1.0, 0.0],
                       sparsity=pattern)
        with pytest.raises(SolverError, match="the iteration matrix is singular"):
            mb.IDA(rtol=1e-6).solve(singular, 1.0)
    for solver in (mb.IDA(rtol=1e-6), mb.CVODE(rtol=1e-6)):
        with pytest.raises(SolverError, match=r"the equations are not finite|failed too many times|round-off"):
            solver.solve(blow_up(), 2.0)
    late = Explicit(lambda t, y, yp, out: yp - np.cos(1e9 * (t - 1e10)) * 1e9, [1.0], [1e9],
                    lambda t, y, yp, cj, out: np.array([[cj]]), t0=1e10)
    for solver in (mb.IDA(rtol=1e-10), mb.CVODE(rtol=1e-10)):  # SUNDIALS warns of it
        with pytest.raises(SolverError, match="the step became smaller than the round-off of the time t"):
            solver.solve(late, 1e10 + 1, h0=1e-9)
    assert capfd.readouterr() == ("", "")


# -- memory


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident size as Linux tells it")
def test_runs_leave_no_memory_behind():
    """Neither finished runs nor those that end with an error."""

    def run(times):
        for _ in range(times):
            for solver in (mb.IDA(rtol=1e-5), mb.CVODE(rtol=1e-5)):
                solver.solve(decay(), 0.2)
                with pytest.raises(SolverError):
                    solver.solve(blow_up(), 2.0)
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1])

    run(30)
    before = run(30)
    assert run(100) - before < 150  # pages of 4 kB


def test_a_run_is_freed_without_the_collector():
    system = decay()
    gc.collect()
    gc.disable()
    try:
        before = {id(o) for o in gc.get_objects()}  # scenes of other tests among them
        mb.CVODE(rtol=1e-6).solve(system, 1.0)
        left = [o for o in gc.get_objects() if isinstance(o, sundials.Method | Equations) and id(o) not in before]
        assert not left
    finally:
        gc.enable()


# -- signals


def test_handlers_wait_inside_and_run_at_once_outside():
    seen = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        with Signals() as signals:
            signal.raise_signal(signal.SIGINT)
            assert seen == [signal.SIGINT]
            signals.inside = True
            signal.raise_signal(signal.SIGINT)
            assert len(seen) == 1
            signals.inside = False
            signals.deliver()
            assert len(seen) == 2
            own = signal.getsignal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is not own
    finally:
        signal.signal(signal.SIGINT, before)


def test_blocks_and_single_steps_give_the_same_solution():
    class Announced(Explicit):
        def accept(self, t, y):
            """Steps are made one by one."""

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for solver in (mb.IDA(rtol=1e-7), mb.CVODE(rtol=1e-7), mb.CVODE(rtol=1e-7, method="BDF")):
            a, b = solver.solve(decay(), 2.0, 30), solver.solve(decay(Announced), 2.0, 30)
            for name in ("t", "y", "yp"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
                np.testing.assert_array_equal(getattr(a.outputs, name), getattr(b.outputs, name))
            for name in ("steps", "residuals", "jacobians", "rejected", "h_min", "h_max"):
                assert getattr(a.stats, name) == getattr(b.stats, name)
