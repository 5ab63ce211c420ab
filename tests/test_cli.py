"""The command line: exit codes, clean JSON, messages without traceback, nothing written unless asked."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.cli import main

EXAMPLES = Path(__file__).parent.parent / "examples"
PENDULUM = """
import mbdae as mb

t_end = 0.5
measure = "hinge.angle"
print("the file itself prints")

def scene():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    return s
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Writes a FILE and returns its name; the test runs in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def write(text=PENDULUM, name="swing.py"):
        (tmp_path / name).write_text(text)
        return name

    return write


def said(capsys):
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out, err


def test_check_says_what_the_scene_is(file, capsys):
    assert main(["check", file()]) == 0
    assert "degrees of freedom: 1" in said(capsys)[0]


@pytest.mark.parametrize("command", ["check", "run", "compare"])
def test_json_stands_alone_on_standard_output(command, file, capsys):
    options = ["--accuracies", "1e-3"] if command == "compare" else []
    assert main([command, file(), "--json", *options]) == 0
    out, err = said(capsys)
    assert json.loads(out)["scene"] == "pendulum"
    assert "the file itself prints" in err


def test_nothing_is_written_unless_asked(file, tmp_path, capsys):
    name = file()
    assert main(["run", name]) == 0
    assert main(["compare", name, "--accuracies", "1e-3"]) == 0
    assert {path.name for path in tmp_path.iterdir()} <= {name, "__pycache__"}


def test_run_writes_result_and_picture_on_request(file, tmp_path, capsys):
    assert main(["run", file(), "--out", "out", "--solver", "radau3", "--form", "index3", "--accuracy", "1e-5"]) == 0
    assert "RadauIIA(3) Index3" in said(capsys)[0]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"swing.npz", "swing.png"}


def test_cvode_runs_what_is_free_and_refuses_multipliers(file, capsys):
    free = PENDULUM.replace('    s.revolute("hinge", s.ground, rod, at=(0, 0))\n', "").replace("hinge.angle", "rod.position")
    assert main(["run", file(free), "--solver", "cvode", "--json"]) == 0
    data = json.loads(said(capsys)[0])
    assert data["solver"] == "CVODE (Adams)"
    assert data["final"][1] == pytest.approx(-9.81 * 0.5**2 / 2, abs=1e-6)
    assert main(["run", file(), "--solver", "cvode", "--form", "ggl"]) == 2
    assert "this system (GGL) has multipliers of constraints" in said(capsys)[1]


@pytest.mark.parametrize(("solver", "form"), [("cvode", "index1"), ("ida", "index1"), ("hht", "ggl"), ("genalpha", "index3")])
def test_solvers_and_forms_of_the_command_line_agree(solver, form, file, capsys):
    command = ["run", file(), "--t-end", "0.2", "--accuracy", "1e-4", "--json"]
    main(command)
    expected = json.loads(said(capsys)[0])["final"]
    assert main([*command, "--solver", solver, "--form", form]) == 0
    data = json.loads(said(capsys)[0])
    assert data["form"].lower() == form
    assert data["accuracy"]["estimated"] <= 1e-4
    assert data["final"] == pytest.approx(expected, abs=2e-4)


def test_compare_writes_pictures_page_and_the_json_it_prints(file, tmp_path, capsys):
    assert main(["compare", file(), "--out", "out", "--json", "--accuracies", "1e-3,1e-4", "--t-end", "0.2"]) == 0
    data = json.loads(said(capsys)[0])
    assert data["t_end"] == 0.2
    assert data["accuracies"] == [1e-3, 1e-4]
    assert json.loads((tmp_path / "out/swing_work_precision.json").read_text(encoding="utf-8")) == data
    assert (tmp_path / "out/swing_work_precision.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "out/swing_work_precision.svg").read_text(encoding="utf-8")
    assert "<title>Solvers compared: pendulum</title>" in (tmp_path / "out/swing_work_precision.html").read_text(encoding="utf-8")
    assert len(list((tmp_path / "out").iterdir())) == 4


def test_compare_takes_the_runs_of_the_file_and_fails_where_one_does(file, capsys):
    runs = "\nruns = [mb.Run(mb.RadauIIA(3)), mb.Run(mb.IDA(), mb.Index3(), label='refused')]\n"
    assert main(["compare", file(PENDULUM + runs), "--accuracies", "1e-3"]) == 1
    assert "failed: refused" in said(capsys)[0]


def test_compare_stopped_by_ctrl_c_goes_on_from_its_file(file, tmp_path, capsys):
    slow = "\nruns = [mb.Run(mb.RadauIIA(3)), mb.Run(mb.RadauIIA(2, step=1e-5), label='slow')]\n"
    command = ["compare", file(PENDULUM + slow, "slow.py"), "--accuracies", "1e-3", "--resume", "kept.json"]
    process = subprocess.Popen([sys.executable, "-m", "mbdae", *command], stderr=subprocess.PIPE, text=True)
    kept = tmp_path / "kept.json"
    for _ in range(300):
        if kept.exists() and len(json.loads(kept.read_text(encoding="utf-8"))["rows"]) == 1:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    err = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "interrupted: 1 of 2 runs are done and kept in kept.json" in err
    assert "Traceback" not in err
    assert len(json.loads(kept.read_text(encoding="utf-8"))["rows"]) == 1
    assert main([*command, "--t-end", "0.1"]) == 2
    assert "t_end is 0.5 as stored and 0.1 in this call" in said(capsys)[1]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(("number", "code", "as_json"), [(signal.SIGINT, 130, False), (signal.SIGTERM, 143, True)])
def test_a_run_that_is_stopped_keeps_what_it_computed(number, code, as_json, file, tmp_path):
    begun = 'print("begun", file=sys.stderr, flush=True)\n    return s'
    name = file("import sys\n" + PENDULUM.replace("t_end = 0.5", "t_end = 1e5").replace("return s", begun))
    command = [sys.executable, "-m", "mbdae", "run", name, "--out", "out", *(["--json"] if as_json else [])]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while "begun" not in process.stderr.readline():
        assert process.poll() is None
    time.sleep(0.7)  # some of it is integration
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert process.returncode == code
    last = err.strip().splitlines()[-1]
    said = "mbdae: SIGTERM: interrupted" if number == signal.SIGTERM else "mbdae: interrupted"
    assert last.startswith(f"{said} at t = ")
    assert last.endswith("s is in out/swing.npz")
    assert "Traceback" not in err
    r = mb.load(tmp_path / "out" / "swing.npz")
    assert not r.complete
    assert 0 < r.solution.t[-1] < 1e5
    if as_json:
        assert json.loads(out) == {"error": last.removeprefix("mbdae: "), "exit_code": 143, "written": ["out/swing.npz"]}


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize(("redirected", "codes"), [
    ("check FILE | true", {0, 141}), ("check FILE >&- 2>&- <&-", {0}), ("check FILE >/dev/full", {1}),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in [
        ("run FILE --json | head -1", {0, 141}), ("run FILE --json 2>&-", {0}), ("check absent.py --json | true", {2, 141})]),
])
def test_output_that_nobody_reads_causes_no_traceback(redirected, codes, file):
    if "/dev/full" in redirected and not Path("/dev/full").exists():
        pytest.skip("no full device")
    words = f"{sys.executable} -m mbdae {redirected.replace('FILE', file())}; echo code ${{PIPESTATUS[0]}} >&3"
    with open("code", "w") as told:
        done = subprocess.run(["bash", "-c", f"exec 3>&{told.fileno()}; {words}"], capture_output=True, text=True, timeout=30,
                              pass_fds=[told.fileno()], check=False)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert int(Path("code").read_text().split()[1]) in codes, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
@pytest.mark.parametrize("variables", [
    pytest.param({"TERM": "dumb"}, marks=pytest.mark.slow),
    {"TERM": "", "NO_COLOR": "1", "COLUMNS": "40", "PYTHONIOENCODING": "ascii"},
])
def test_any_terminal_will_do(variables, file):
    import os
    import pty

    name = file(PENDULUM.replace("t_end = 0.5", "t_end = 50"))
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, "-m", "mbdae", "run", name], stdout=theirs, stderr=theirs, stdin=theirs,
                               env=os.environ | variables)
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # the other end is closed
        while part := os.read(ours, 65536):
            shown += part
    assert process.wait(20) == 0, shown
    assert b"Traceback" not in shown
    assert b"hinge.angle at t = 50 s" in shown


def test_what_other_programs_print_is_kept_out_of_the_json(file):
    noisy = 'import os, subprocess, sys\nos.write(1, b"written\\n")\nsubprocess.run([sys.executable, "-c", "print(3)"])\n'
    command = [sys.executable, "-m", "mbdae", "check", file(noisy + PENDULUM), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert json.loads(done.stdout)["scene"] == "pendulum"
    assert "written" in done.stderr


def test_compare_reads_what_is_kept(file, capsys):
    command = ["compare", file(), "--json", "--accuracies", "1e-3", "--resume", "kept.json"]
    assert main(command) == 0
    first = json.loads(said(capsys)[0])
    assert main(command) == 0
    assert json.loads(said(capsys)[0]) == first


def test_a_scene_with_a_mistake_ends_with_1_and_names_it(file, capsys):
    assert main(["check", file(PENDULUM.replace("mass=1.0", "mass=-1.0"))]) == 1
    assert "mass = -1 kg is negative" in said(capsys)[1]


@pytest.mark.parametrize(("arguments", "words"), [
    (["run", "absent.py"], "there is no file 'absent.py'"),
    (["run", "empty.py"], "no function scene(); add one"),
    (["run", "broken.py"], "line 1 of broken.py"),
    (["check", "raising.py"], "scene() of 'raising.py' fails: ValueError: no (line 1 of raising.py)"),
    (["check", "other.py"], "returns int, not a mb.Scene"),
    (["run", "timeless.py"], "give --t-end T"),
    (["run", "swing.py", "--accuracy", "7"], "accuracy = 7"),
    (["run", "swing.py", "--form", "ode"], "form ODE needs a scene without constraints"),
    (["run", "swing.py", "--solver", "ida", "--form", "index3"], "has index 3"),
])
def test_wrong_usage_ends_with_2_and_the_next_step(arguments, words, file, capsys):
    file()
    file("", "empty.py")
    file("x = 1 / 0\n", "broken.py")
    file("def scene(): raise ValueError('no')\n", "raising.py")
    file("def scene(): return 3\n", "other.py")
    file(PENDULUM.replace("t_end = 0.5", ""), "timeless.py")
    assert main(arguments) == 2
    assert words in said(capsys)[1]


WRONG_WORDS = [["compute"], ["compare", "a.py", "--accuracies", "fine"], []]


@pytest.mark.parametrize("arguments", WRONG_WORDS)
def test_unknown_words_end_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2


def test_an_unknown_option_is_named_by_the_command_that_was_given_it(capsys):
    with pytest.raises(SystemExit) as end:
        main(["run", "a.py", "--acuracy", "1e-3"])
    assert end.value.code == 2
    assert "unknown option '--acuracy': did you mean '--accuracy'? mbdae run --help lists" in said(capsys)[1]


def test_python_m_mbdae_is_the_same_command(file):
    done = subprocess.run([sys.executable, "-m", "mbdae", "check", file()], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "scene 'pendulum'" in done.stdout


@pytest.mark.slow  # `.ci/run` runs this job with the README's first line
def test_the_main_job_stays_affordable(capsys, tmp_path):
    assert main(["compare", str(EXAMPLES / "ground_resonance.py"), "--json", "--out", str(tmp_path)]) == 0
    data = json.loads(said(capsys)[0])
    assert data["cpu_s"] < 60
    assert {entry["solver"] for entry in data["runs"]} == {"IDA", "RadauIIA(2)", "RadauIIA(3)", "CVODE (Adams)"}
    assert {entry["model"] for entry in data["runs"]} == {None, "Classical", "Recursive"}
    assert not any(entry["failure"] for entry in data["runs"])
