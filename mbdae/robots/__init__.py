"""Robots: files read into scenes, joint-space dynamics.

Files of robots, read with bounds: no entities, no network, nothing outside of the folders that were given.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

from mbdae.errors import OptionError

EXTRA = "pip install 'mbdae[robots]'"
#: bytes of a file of XML, of a mesh, and how many elements one may have and how deep
LARGEST, LARGEST_MESH, MOST_ELEMENTS, DEEPEST = 32_000_000, 256_000_000, 200_000, 200
ENCODINGS = ("utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1")


def library(name: str, what: str) -> Any:
    """A library of the extra `robots`."""
    try:
        return import_module(name)
    except ImportError as error:
        raise OptionError(f"{what} needs {name.partition('.')[0]}, which is not installed: {EXTRA}") from error


def text_of(path: Any, what: str) -> tuple[Path, bytes]:
    """A file as bytes, which are XML in UTF-8 without declarations of types and entities."""
    try:
        found = Path(path)
    except TypeError as error:
        raise OptionError(f"{what}: path = {path!r} is no path of a file") from error
    if not found.is_file():
        raise OptionError(f"{what}: there is no file {str(found)!r}")
    size = found.stat().st_size
    if size > LARGEST:
        raise OptionError(f"{what}: {found.name} has {size} bytes, more than the {LARGEST} that are read")
    data = found.read_bytes()
    return found, clean(data, found.name)


def clean(data: bytes, name: str) -> bytes:
    """The bytes as they are, after checks; OptionError where they may hide something from these."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    declared = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)[\"']", data[:400])
    encoding = declared.group(1).decode("ascii", "replace").lower() if declared else "utf-8"
    if encoding not in ENCODINGS or b"\0" in data:
        raise OptionError(f"{name}: its encoding is not UTF-8; save it as UTF-8")
    if encoding == "utf-8":
        try:
            data.decode()
        except UnicodeDecodeError as error:
            raise OptionError(f"{name}: byte {error.start} is no UTF-8; save the file as UTF-8") from error
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", data, re.IGNORECASE):
        raise OptionError(f"{name}: it declares types or entities (<!DOCTYPE, <!ENTITY), which are not read; remove them")
    return data


def parsed(data: bytes, name: str, root: str) -> Any:
    """The root element of XML, without comments; OptionError with the place of the mistake."""
    etree = library("lxml.etree", f"reading {name}")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True,
                             remove_pis=True, recover=False)
    try:
        found = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise OptionError(f"{name}: no XML: {error}") from error
    if found.tag != root:
        raise OptionError(f"{name}: its outermost element is <{found.tag}>; <{root}> is needed")
    count = 0
    stack = [(found, 1)]
    while stack:
        element, depth = stack.pop()
        count += 1
        if depth > DEEPEST or count > MOST_ELEMENTS:
            raise OptionError(f"{name}: more than {MOST_ELEMENTS} elements, or more than {DEEPEST} inside each other")
        stack += [(child, depth + 1) for child in element]
    return found


def bounds_of(path: Path, scale: Any) -> Any:
    """Middle and edges (2, 3), m, of the box about a mesh; None where it cannot be read."""
    import numpy as np

    trimesh = library("trimesh", "drawing meshes")
    if not path.is_file() or path.stat().st_size > LARGEST_MESH:
        return None
    try:
        found = np.asarray(trimesh.load_scene(str(path), allow_remote=False).bounds, dtype=float)
    except Exception:  # a picture alone: what a mesh reader raises depends on the format
        return None
    if found.shape != (2, 3) or not np.all(np.isfinite(found)):
        return None
    found = np.sort(found * np.asarray(1.0 if scale is None else scale), axis=0)
    return np.array([found.mean(axis=0), np.maximum(found[1] - found[0], 1e-9)])
