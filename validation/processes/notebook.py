"""A notebook that sends its own functions, scenes and law to other processes, executed by nbclient; prints what its cells say."""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import nbclient
import nbformat

BEGIN = '''
import concurrent.futures as futures, multiprocessing, sys, warnings
import mbdae as mb
warnings.simplefilter("ignore")
STIFF = 3.0
class Pull(mb.Force):
    params = mb.params(c=("N/m", "stiffness"))
    def energy(self, k, l):
        return STIFF * self.c * (l.r - k.r).norm() ** 2 / 2
def scene(m):
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    b = s.point_mass("b", m, at=(0, 1.0, 0))
    s.add(Pull("p", s.ground, b, at=(0, 0, 0), at_l=(0, 1.0, 0), c=1.0))
    return s
def end(m):
    return float(scene(m).simulate(0.5)["b"].position[-1, 1])
def run(s):
    return float(s.simulate(0.5)["b"].position[-1, 1])
def job(m):
    return {"y": end(m)}
def say(what, found):
    print("right:" if list(found) == here else "wrong:", what)
masses = [1.0, 1.5, 2.0]
here = [end(m) for m in masses]
'''
DASK = '''
from dask.distributed import Client, LocalCluster
for what, workers, threads in (("Dask, processes", 2, 1), ("Dask, threads", 1, 3)):
    kind = dict(n_workers=workers, threads_per_worker=threads, dashboard_address=None)
    with LocalCluster(**kind) as cluster, Client(cluster) as client:
        say(f"{what}, map", client.gather(client.map(end, masses)))
        say(f"{what}, scenes", client.gather(client.map(run, [scene(m) for m in masses])))
        say(f"{what}, sweep", mb.sweep(job, {"m": masses}, client.get_executor()).array("y"))
'''
JOBLIB = '''
try:
    import joblib
except ImportError:
    print("refused: joblib is not installed")
else:
    for backend in ("loky", "threading", "multiprocessing"):
        say(f"joblib, {backend}", joblib.Parallel(n_jobs=2, backend=backend)(joblib.delayed(end)(m) for m in masses))
'''
FORK = '''
with multiprocessing.get_context("fork").Pool(2) as pool:
    say("multiprocessing, fork", pool.map(end, masses))
with futures.ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork")) as pool:
    say("sweep in forked processes", mb.sweep(job, {"m": masses}, pool).array("y"))
'''
SPAWN = '''
import in_a_file
here = [in_a_file.end(m) for m in masses]
for how in ("spawn", "forkserver"):
    with multiprocessing.get_context(how).Pool(2) as pool:
        say(f"multiprocessing, {how}", pool.map(in_a_file.end, masses))
say("sweep in processes", mb.sweep(in_a_file.job, {"m": masses}, workers=2).array("y"))
'''
REFUSED = '''
for what, call in (("sweep", lambda: mb.sweep(job, {"m": masses})),
                   ("sweep of a scene", lambda: mb.sweep(scene(1.0), {"b.mass": masses}, t_end=0.5))):
    try:
        call()
        print("wrong:", what)
    except mb.OptionError as error:
        print("refused:" if "in a notebook" in str(error) else "wrong:", what)
'''
IN_A_FILE = '''
import mbdae as mb
def end(m):
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    b = s.point_mass("b", m, at=(0, 1.0, 0))
    s.spring("S", s.ground, b, (0, 0), (0, 1), stiffness=3.0)
    return float(s.simulate(0.5)["b"].position[-1, 1])
def job(m):
    return {"y": end(m)}
'''


def main() -> None:
    """Execute the notebook in a folder of its own."""
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell)
                                           for cell in (BEGIN, DASK, JOBLIB, FORK, REFUSED, SPAWN)])
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        Path(folder, "in_a_file.py").write_text(IN_A_FILE, encoding="utf-8")
        nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    for cell in book.cells:
        for output in cell.outputs:
            if output.get("name") == "stdout":
                sys.stdout.write(output.text)


if __name__ == "__main__":
    main()
