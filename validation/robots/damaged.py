"""Files of robots that are damaged or hostile, and a process that reads them: every one ends in one clear error of the package.

Run as a script (folder, kind, number, ...) it reads them under watch, and prints a line of JSON for each."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0.1" rpy="0.3 0 0.1"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial>
    <visual><geometry><mesh filename="package://arm/meshes/upper.stl" scale="1 1 1"/></geometry></visual></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
    <visual><geometry><box size="0.4 0.1 0.1"/></geometry></visual></link>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5" rpy="0 0.2 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="1"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="1 2 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="1"/><mimic joint="elbow" multiplier="0.1" offset="0.02"/></joint>
</robot>
"""
MJCF = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="trunk" pos="0 0 1"><freejoint/><inertial pos="0.1 0 0" mass="3" diaginertia="0.1 0.2 0.25"/>
    <geom name="hull" type="box" size="0.1 0.2 0.3"/>
    <body name="leg" pos="0 0.2 0"><joint name="hip" axis="1 0 0" armature="0.02" damping="0.1" stiffness="2"/>
      <joint name="swing" axis="0 1 0" pos="0 0 0.1"/><site name="eye" pos="0.1 0.2 0.3"/>
      <inertial pos="0 0 -0.2" mass="1" diaginertia="0.02 0.02 0.01"/></body></body>
  </worldbody></mujoco>"""
BOMB = "<!DOCTYPE r [<!ENTITY a0 'ha'>" + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12)) + "]>"
HEAD = {"urdf": "<robot", "xml": "<mujoco"}
COPY = '<replicate count="3000" offset="1 0 0">'
NUMBER = re.compile(r'[-+]?\d+\.?\d*(?:e[-+]?\d+)?')
ALLOWED = 6_000_000_000  #: bytes of address space that a process may take, so that a failure does not take the machine
SECONDS = 20.0  #: CPU s for one file


class Draft:
    """A file to be damaged: its text, the folder it will be in, and what is drawn."""

    def __init__(self, folder: Path, kind: str, seed: int) -> None:
        self.folder, self.kind, self.rng = folder, kind, np.random.default_rng(seed)
        self.text = URDF if kind == "urdf" else MJCF
        self.path = folder / "arm" / "robots" / f"robot.{kind}"
        self.path.parent.mkdir(parents=True)

    def pick(self, of: Any) -> Any:
        return of[int(self.rng.integers(len(of)))]

    def swap(self, pattern: str, new: str | Callable[[str], str]) -> None:
        """Replace one match of a pattern, drawn, of which the first group goes."""
        found = self.pick(list(re.finditer(pattern, self.text)))
        put = new(found.group(1)) if callable(new) else new
        self.text = self.text[: found.start(1)] + put + self.text[found.end(1) :]

    def inside(self, more: str) -> None:
        """More in the outermost element, as its first child."""
        self.text = re.sub(rf"({HEAD[self.kind]}[^>]*>)", lambda m: m.group(1) + more, self.text, count=1)

    def prefix(self, more: str) -> None:
        self.text = self.text.replace(HEAD[self.kind], more + HEAD[self.kind], 1)

    def beside(self, name: str, data: str | bytes) -> Path:
        """A further file, beside the first one or below it."""
        path = self.path.parent / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return path


def truncated(d: Draft) -> None:
    d.text = d.text[: int(d.rng.integers(1, len(d.text.rstrip()) - 3))]


def garbage(d: Draft) -> None:
    at = int(d.rng.integers(len(d.text)))
    d.text = d.text[:at] + d.pick(["\x01\x02", "<", "<<>>", "&", "&#0;", "]]><", "<a b=1>", "\x00" * 9]) + d.text[at:]


def word_for_number(d: Draft) -> None:
    d.swap(r'(?:xyz|rpy|value|ixx|iyy|size|pos|mass|diaginertia|axis|armature|damping|stiffness|upper|multiplier)="([^"]*)"',
           d.pick(["nan", "inf", "-inf", "1e999", "one", "0x", "1,2,3", "1_0", "None", "nan nan nan", "1e400 0 0"]))


def not_finite(d: Draft) -> None:
    pattern = r'(?:pos|mass|diaginertia|axis|xyz|rpy|value|i[xyz][xyz]|armature|damping|stiffness)="([^"]*)"'
    d.swap(pattern, lambda old: NUMBER.sub(d.pick(["nan", "inf", "-inf", "1e999"]), old, count=1))


def no_body(d: Draft) -> None:
    """Masses and inertias that no body has."""
    if d.kind == "urdf":
        what = d.pick([(r'mass value="([^"]*)"', "-1"), (r'ixx="([^"]*)"', "-0.01"), (r'izz="([^"]*)"', "9"),
                       (r'ixy="([^"]*)"', "5"), (r'iyy="([^"]*)"', "1e9")])
    else:
        what = d.pick([(r'mass="([^"]*)"', "-1"), (r'diaginertia="([^"]*)"', "-1 1 1"), (r'diaginertia="([^"]*)"', "1 1 9"),
                       (r'mass="([^"]*)"', "0"), (r'diaginertia="([^"]*)"', "0 0 0")])
    d.swap(*what)


def entities(d: Draft) -> None:
    outside = [f'<!DOCTYPE r SYSTEM "{where}">' for where in ("http://127.0.0.1:9/a.dtd", "file:///etc/passwd", "/dev/zero")]
    inside = [f'<!DOCTYPE r [<!ENTITY a SYSTEM "{where}">]>' for where in ("http://127.0.0.1:9/a", "file:///etc/passwd",
                                                                           "/dev/zero", "expect://id")]
    more = ['<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1:9/p"> %p;]>', "<!doctype r [<!entity a 'b'>]>", BOMB]
    d.prefix(d.pick([*outside, *inside, *more]))
    d.inside("&a;" if d.rng.random() < 0.5 else "&a11;")


def encodings(d: Draft) -> None:
    hidden = "<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>"
    d.prefix(hidden)
    name = d.pick(["utf-16", "utf-16-be", "utf-32", "utf-7", "cp037"])
    d.text = d.text.removeprefix('<?xml version="1.0"?>')
    d.path.write_bytes((f'<?xml version="1.0" encoding="{name}"?>' + d.text).encode(name))


def includes(d: Draft) -> None:
    """Files that include themselves, each other, many others, and what is elsewhere."""
    way = d.pick(["self", "two", "many", "away", "absolute", "net", "file", "link", "nothing", "folder", "device", "bomb"])
    if d.kind == "urdf":  # URDF has no includes; xacro and XInclude are other languages
        d.inside(d.pick(['<xi:include href="/etc/passwd" xmlns:xi="http://www.w3.org/2001/XInclude" parse="text"/>',
                         '<xacro:include filename="/etc/passwd" xmlns:xacro="http://ros.org/xacro"/>',
                         '<include file="/etc/passwd"/>', '<xacro:macro name="a"/>', '<xi:include href="http://127.0.0.1:9/"/>']))
        return
    names = {"self": d.path.name, "two": "b.xml", "many": "i0.xml", "away": "../../../../../../../../etc/passwd",
             "absolute": "/etc/passwd", "net": "http://127.0.0.1:9/a.xml", "file": "file:///etc/passwd", "link": "link.xml",
             "nothing": "", "folder": "..", "device": "/dev/zero", "bomb": "bomb.xml"}
    d.inside(f'<include file="{names[way]}"/>')
    if way == "two":
        d.beside("b.xml", f'<mujoco><include file="{d.path.name}"/></mujoco>')
    elif way == "many":
        for i in range(300):
            d.beside(f"i{i}.xml", f'<mujoco><include file="i{i + 1}.xml"/></mujoco>')
    elif way == "link":
        (d.path.parent / "link.xml").symlink_to("/etc/passwd")
    elif way == "bomb":
        d.beside("bomb.xml", BOMB + "<mujoco><worldbody>&a11;</worldbody></mujoco>")


def absurd(d: Draft) -> None:
    """Sizes beyond reason."""
    common = {"deep": "<a>" * 100_000 + "</a>" * 100_000, "wide": "<a/>" * 400_000, "hollow": ""}
    mjcf = {
        "texture": '<asset><texture name="t" type="2d" builtin="flat" width="900000" height="900000"/></asset>',
        "field": '<asset><hfield name="h" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>',
        "copies": '<worldbody><replicate count="900000000" offset="1 0 0"><geom size="1"/></replicate></worldbody>',
        "nested": f"<worldbody>{COPY * 3}<geom size='1'/>{'</replicate>' * 3}</worldbody>",
        "grid": '<worldbody><flexcomp name="f" type="grid" count="9000 9000 9" spacing="1 1 1" mass="1"/></worldbody>',
        "stack": '<size njmax="2000000000" nconmax="2000000000"/>', "user": '<size nuser_body="2000000000"/>',
        "memory": '<size memory="900G"/>', "userdata": '<size nuserdata="2000000000"/>', "keys": '<size nkey="2000000000"/>',
        "numeric": '<custom><numeric name="n" size="2000000000" data="1"/></custom>'}
    choices = common | (mjcf if d.kind == "xml" else {})
    way = d.pick(list(choices))
    d.inside(choices[way])
    if way == "hollow":
        with d.path.open("wb") as file:
            file.truncate(40_000_000_000)


def structure(d: Draft) -> None:
    """Names that are missing, twice there, unknown, or in a circle."""
    if d.kind == "urdf":
        ways = [(r'child link="([^"]*)"', "nobody"), (r'parent link="(base|upper)"', "finger"), (r'link name="([^"]*)"', "x"),
                (r'( izz="[^"]*")', ""), (r'joint name="([^"]*)" type="(?:c|r)', "grip"), (r'mimic joint="([^"]*)"', "grip"),
                (r'type="([^"]*)"', "ball"), (r'(<parent link="\w+"/>)', ""), (r'(<mass value="\w+"/>)', ""),
                (r"</?(robot)", "model"), (r'axis xyz="([^"]*)"', "0 0 0"), (r'( name="shoulder")', "")]
    else:
        ways = [(r'body name="(leg)"', "trunk"), (r'joint name="(hip)"', "swing"), (r"(<freejoint/>)", "<freejoint/>" * 2),
                (r'axis="([^"]*)"', "0 0 0"), (r"</?(mujoco)", "model"), (r'(pos)="', "position"),
                (r'angle="([^"]*)"', "turns"), (r'type="(box)"', "cube"), (r'(<site name="eye")', '<site name="eye"/>' * 2),
                (r"(<freejoint/>)", '<freejoint/><joint type="hinge"/>'), (r"(<worldbody>)", "<worldbody><freejoint/>")]
    d.swap(*d.pick(ways))


def foreign(d: Draft) -> None:
    """What would be code, or is not modelled."""
    if d.kind == "urdf":
        d.swap(r'type="([^"]*)"', d.pick(["__import__('os').system('touch x')", "${7*7}", "$(find x)", "{{x}}"]))
        return
    asset = d.pick(['model name="m" file="/etc/passwd"', 'model name="m" file="http://127.0.0.1:9/"',
                    'mesh name="m" file="/etc/passwd"', 'texture file="/etc/passwd" type="2d"',
                    'hfield name="h" file="/dev/zero" size="1 1 1 1"', 'mesh name="m" file="/dev/zero"'])
    d.inside(d.pick(['<extension><plugin plugin="mujoco.elasticity.cable"/></extension>', "<plugin/>",
                     f"<asset><{asset}/></asset>",
                     '<worldbody><body><freejoint/><geom size="1"/><plugin plugin="x"/></body></worldbody>',
                     '<worldbody><body name="o"><attach model="m" body="b" prefix="p"/></body></worldbody>',
                     '<worldbody><flexcomp name="f" type="mesh" file="/etc/passwd" mass="1"/></worldbody>',
                     '<compiler meshdir="/" /><asset><mesh file="/etc/hosts.stl"/></asset>']))


def meshes(d: Draft) -> None:
    """Meshes that are missing, elsewhere, or hostile. URDF is read without the picture, and says so."""
    bad = [f"package://arm/meshes/bad.{kind}" for kind in ("stl", "dae", "obj", "gltf", "zip", "ply")]
    away = "../" * 9 + "etc/passwd"
    name = d.pick([*bad, "package://arm/meshes/none.stl", "package://nobody/a.stl", "http://127.0.0.1:9/a.stl", "file:///etc/passwd",
                   "https://127.0.0.1:9/a.dae", "ftp://127.0.0.1/a.stl", "file:///dev/zero", f"package://arm/{away}", away,
                   "package://..//etc/passwd", "/dev/zero", "", "x" * 5000, "package://arm/robots",
                   "data:model/stl;base64,AA", "bad.py"])
    view = {"buffer": 0, "byteLength": 2**40}
    gltf = {"asset": {"version": "2.0"}, "buffers": [{"uri": "http://127.0.0.1:9/b.bin", "byteLength": 2**40}], "scene": 0,
            "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "bufferViews": [view],
            "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 2**31}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}
    ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n"
    obj = b"mtllib http://127.0.0.1:9/m.mtl\nv nan 0 0\nv 1e999 0 0\nf 1 2 999999999\n"
    stl, dae = b"\0" * 80 + b"\xff" * 4 + b"\0" * 50, f"{BOMB}<COLLADA>&a11;</COLLADA>".encode()
    for extension, data in {"stl": stl, "dae": dae, "obj": obj, "gltf": json.dumps(gltf).encode(), "ply": ply,
                            "zip": b"PK\x03\x04" + b"\0" * 100}.items():
        d.beside(f"../meshes/bad.{extension}", data)
    d.beside("bad.py", "open('executed', 'w').write('x')")
    if d.kind == "urdf":
        d.swap(r'filename="([^"]*)"', name)
    else:
        d.inside(f'<asset><mesh name="m" file="{name.replace("package://arm", "..")}"/></asset>')


WAYS = (truncated, garbage, word_for_number, not_finite, no_body, entities, encodings, includes, absurd, structure, foreign,
        meshes)
TOLD = ("includes", "meshes")  #: ways after which a URDF file may be read all the same, with a sentence on what is left out
FILES = 300
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def made(folder: Path, number: int) -> tuple[Path, str, str]:
    """A damaged file: its path, kind, and the way it was damaged."""
    kind, way = ("urdf", "xml")[number % 2], WAYS[number // 2 % len(WAYS)]
    draft = Draft(folder, kind, number)
    way(draft)
    if not draft.path.exists():
        draft.path.write_bytes(draft.text.encode())
    return draft.path, kind, way.__name__


def watch(seen: list[str]) -> None:
    """Keep what this process fetches, starts or writes from here on."""
    words = ("socket.", "subprocess.", "os.system", "os.exec", "os.posix_spawn", "os.fork", "pickle.", "urllib.", "ftplib.",
             "ctypes.dlopen", "webbrowser.", "os.remove", "os.rename")

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event.startswith(words) and not (event == "os.remove" and str(args[0]) == "MUJOCO_LOG.TXT"):
            seen.append(f"{event} {str(args)[:100]}")
        elif event == "open" and isinstance(args[2], int) and args[2] & WRITING and str(args[0]) != os.devnull:
            seen.append(f"writes {args[0]}")

    sys.addaudithook(hook)


def judged(path: Path, kind: str, way: str) -> tuple[str, str]:
    """What became of a file: "error", "told" or what must not be, and the words."""
    import warnings

    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        try:
            s = mb.read_urdf(path, floating=False) if kind == "urdf" else mb.read_mjcf(path)
        except mb.MbdaeError as error:
            words = str(error)
            return ("error" if 20 < len(words) < 5000 else "unclear"), words
        except BaseException as error:
            return "crashed", f"{type(error).__name__}: {error}"
    left_out = [text for text in s.told if "not drawn" in text or "not read" in text]
    return ("told" if kind == "urdf" and way in TOLD and left_out else "silent"), "; ".join(s.told)


def reading(folder: Path, numbers: list[int]) -> None:
    """Read files under watch, a line of JSON each."""
    for kind, text in (("urdf", URDF), ("xml", MJCF)):  # whole files first: libraries are loaded, and read in earnest
        whole = folder / f"whole.{kind}"
        whole.write_text(text)
        (mb.read_urdf if kind == "urdf" else mb.read_mjcf)(whole)
    files = []
    for n in numbers:
        (folder / str(n)).mkdir()
        files.append((n, *made(folder / str(n), n)))
    seen: list[str] = []
    watch(seen)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))  # whoever writes a byte to a file, in C too, is ended
    resource.setrlimit(resource.RLIMIT_AS, (ALLOWED, ALLOWED))
    for n, path, kind, way in files:
        os.chdir(path.parent)
        before, begin = sorted(folder.rglob("*")), time.process_time()
        verdict, words = judged(path, kind, way)
        spent = time.process_time() - begin
        if seen or sorted(folder.rglob("*")) != before:
            verdict, words = "touched", "; ".join(seen) or "a file was made"
        line = {"n": n, "kind": kind, "way": way, "verdict": verdict, "words": words[:400], "cpu": spent,
                "memory": peak()}
        seen.clear()
        os.write(1, (json.dumps(line) + "\n").encode())


def peak() -> int:
    """Largest memory of this process so far, bytes. What `getrusage` tells contains that of the process that started it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


def read_all(numbers: list[int]) -> list[dict[str, Any]]:
    """What became of damaged files, read by processes of their own; one that ends early has crashed at the file it was at."""
    found: list[dict[str, Any]] = []
    todo = list(numbers)
    while todo:
        with tempfile.TemporaryDirectory(prefix="mbdae-damaged-") as folder:
            ended = subprocess.run([sys.executable, str(Path(__file__).resolve()), folder, *map(str, todo)], capture_output=True,
                                   text=True, check=False, timeout=SECONDS * len(todo) + 60)
        lines = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
        found += lines
        todo = todo[len(lines) :]
        if todo:
            found.append({"n": todo[0], "verdict": "crashed", "words": f"ended by {ended.returncode}: {ended.stderr[-300:]}",
                          "cpu": 0.0, "memory": 0, "kind": "", "way": ""})
            del todo[0]
    return found


if __name__ == "__main__":
    reading(Path(sys.argv[1]), [int(n) for n in sys.argv[2:]])
