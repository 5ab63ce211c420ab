"""Files that `resume` keeps: what is damaged in them is told, with the file and what to do; nothing is taken over wrongly."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.compare import Checkpoint
from mbdae.compare.measures import Reference
from mbdae.compare.table import Row, TightestRun

HOSTILE = ["os:system", "__import__('os').system('touch X')", "", "x" * 100_000, -1, 10**400, 1e308, float("nan"), True, None,
    [], {}, [1], "1"]


def state(path: Path = Path("w.json")) -> Checkpoint:
    rows = [Row("IDA", "IDA", "GGL", None, 1e-3, 1e-5, 2e-4, 0.1, None, 12), Row("Radau", "R", "GGL", "m", 1e-3,
        failure="stopped")]
    finals = {"IDA": TightestRun("IDA", "1e-03", 1e-5, np.linspace(0, 1, 24).reshape(4, 3, 2))}
    reference = Reference("Radau", 1e-5, "IDA", 1e-6, differences={"motion": 1e-6, "energy": 1e-3})
    known = {"": (reference, [np.arange(12.0).reshape(4, 3), None])}
    return Checkpoint(path, {"t_end": 1.0}, known, rows, finals, True, 1e-6, 0.5, 0.75)


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    state(tmp_path / "w.json").save(0.5, 0.75)
    again = Checkpoint(tmp_path / "w.json", {"t_end": 1.0})
    again.load()
    (reference, values), (own, own_values) = again.references[""], state().references[""]
    assert (again.rows, reference, again.settled, again.cpu_s, again.total_cpu_s) == (state().rows, own, True, 0.5, 0.75)
    assert np.array_equal(values[0], own_values[0])
    assert values[1] is None
    assert np.array_equal(again.tightest_runs["IDA"].values, state().tightest_runs["IDA"].values)
    assert [path.name for path in tmp_path.iterdir()] == ["w.json"]


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield (*path, key)
        yield from places(part, (*path, key))


def attempt(path: Path) -> tuple[Checkpoint | None, str]:
    """What is kept, or why it is refused."""
    kept = Checkpoint(path, {"t_end": 1.0})
    try:
        kept.load()
        return kept, ""
    except mb.OptionError as error:
        return None, str(error)


def test_damaged_entries_are_told_or_of_their_kind(tmp_path: Path) -> None:
    kept = state(tmp_path / "w.json")
    kept.save(0.5, 0.75)
    good = json.loads(kept.path.read_text())
    refused = 0
    for path in places(good):
        for new in HOSTILE:
            changed = copy.deepcopy(good)
            holder = changed
            for key in path[:-1]:
                holder = holder[key]
            holder[path[-1]] = new
            kept.path.write_text(json.dumps(changed))
            found, told = attempt(kept.path)
            if found is None:
                refused += 1
                assert "w.json" in told
                assert len(told) < 1000
            else:
                assert all(type(row.steps) is int and isinstance(row.label, str) for row in found.rows)
                assert all(final.values.dtype == float for final in found.tightest_runs.values())
                assert all(isinstance(one, Reference) for one, _ in found.references.values())
    assert refused > 300


@pytest.mark.parametrize("text", ["", "[" * 100_000, "null", "\x00", '{"format": "mbdae comparison in progress 1"}', b"\xff\xfe"])
def test_other_texts_are_told(text: Any, tmp_path: Path) -> None:
    kept = Checkpoint(tmp_path / "w.json", {"t_end": 1.0})
    kept.path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(mb.OptionError, match=r"resume = .*w\.json"):
        kept.load()


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    kept = Checkpoint(tmp_path / "w.json", {}, {"": (Reference("Radau", 1e-5, "IDA", 1e-6), [np.zeros(1_000_000)])})
    kept.save(0.0, 0.0)
    data = json.loads(kept.path.read_text())
    for shape in ([1], [2_000_000], [10**15], [-1], [1.5], ["1"], [True]):
        data["references"][""]["values"][0]["shape"] = shape
        kept.path.write_text(json.dumps(data))
        with pytest.raises(mb.OptionError, match="is damaged"):
            kept.load()


def _double(point: dict[str, Any]) -> dict[str, Any]:
    return {"twice": 2 * point["x"]}


@pytest.mark.parametrize("line", ['{"number": -1, "values": {}, "error": null, "died": false}', '{"number": 9}', "[1]", "1",
                                  '{"number": 0, "values": 1, "error": null, "died": false}',
                                  '{"number": true, "values": {}, "error": null, "died": false}'])
def test_damaged_rows_of_a_sweep_are_told(line: str, tmp_path: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    file = tmp_path / "s.jsonl"
    with ThreadPoolExecutor(1) as pool:
        mb.sweep(_double, [{"x": 1.0}, {"x": 2.0}], executor=pool, resume=file)
        whole = file.read_text()
        file.write_text(whole + line[:-3])  # cut off: left out
        assert len(mb.sweep(_double, [{"x": 1.0}, {"x": 2.0}], executor=pool, resume=file).rows) == 2
        file.write_text(whole + line + "\n")
        with pytest.warns(mb.AccuracyWarning, match=r"s\.jsonl': the row of .* \(line 4\) was changed or damaged"):
            mb.sweep(_double, [{"x": 1.0}, {"x": 2.0}], executor=pool, resume=file)
