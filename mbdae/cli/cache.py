"""The command `mbdae cache`."""

from __future__ import annotations

import argparse
import json

from mbdae.disk.store import store


def cache(a: argparse.Namespace) -> int:
    """Print where derived and compiled laws are stored on disk and how much there is, or remove all of it."""
    kept = store()
    removed = kept.clear() if a.what == "clear" else None
    found = kept.content()
    if a.json:
        data = {"path": str(kept.folder) if kept.folder else None, "used": kept.used, "why_not": kept.why or None,
                "limit": kept.limit, "files": found.entries, "bytes": found.size, "hits": found.hits, "misses": found.misses,
                "removed": removed}  # fmt: skip
        print(json.dumps(data, indent=1), file=a.stdout)
        return 0
    print(f"{kept.folder or 'nothing is kept on disk'}{'' if kept.used else f', not used: {kept.why}'}")
    if removed is not None:
        print(f"{removed} files removed")
    if kept.used:
        print(f"{found.entries} files, {found.size / 1e6:.1f} MB of at most {kept.limit / 1e6:.0f} MB; "
              f"{found.hits} hits, {found.misses} misses")  # fmt: skip
    return 0
