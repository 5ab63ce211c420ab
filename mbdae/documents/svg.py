"""Small pictures without a plotting library: a curve, a pattern of dots."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

WIDTH, HEIGHT, MARGIN = 520, 260, 46


def curve(x: Any, y: Any, across: str, up: str) -> str:
    """A curve over its axes."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    low, high = min(0.0, float(y.min())), max(0.0, float(y.max()))
    span = (high - low) or 1.0
    px = MARGIN + (x - x.min()) / (x.max() - x.min()) * (WIDTH - MARGIN - 12)
    py = HEIGHT - 34 - (y - low) / span * (HEIGHT - 52)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))
    zero = HEIGHT - 34 - (0 - low) / span * (HEIGHT - 52)
    marks = "".join(
        f'<text x="{MARGIN - 6}" y="{HEIGHT - 34 - (t - low) / span * (HEIGHT - 52) + 4:.1f}" text-anchor="end">{t:.3g}</text>'
        for t in dict.fromkeys((low, 0.0, high))
    )
    ends = "".join(
        f'<text x="{p:.1f}" y="{HEIGHT - 18}" text-anchor="middle">{v:.3g}</text>'
        for p, v in ((px[0], x[0]), (px[-1] - 4, x[-1]))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(up)} over {escape(across)}" viewBox="0 0 {WIDTH}'
        f' {HEIGHT}" width="{WIDTH}" font-family="system-ui, Liberation Sans, sans-serif" font-size="12" fill="#333"><path'
        f' d="M{MARGIN} {zero:.1f}H{WIDTH - 12}M{MARGIN} 12V{HEIGHT - 34}" stroke="#999" fill="none"/><polyline points="{points}"'
        f' fill="none" stroke="#0072b2" stroke-width="2"/>{marks}{ends}<text x="{(WIDTH + MARGIN) / 2}" y="{HEIGHT - 4}"'
        f' text-anchor="middle">{escape(across)}</text><text x="{MARGIN + 6}" y="14">{escape(up)}</text></svg>'
    )


def pattern(entries: Any, n: int, title: str) -> str:
    """Entries (row, column) of a square matrix as dots; those of a large matrix merge."""
    size = 420
    cell = size / max(n, 1)
    dots = "".join(
        f'<rect x="{j * cell:.2f}" y="{i * cell:.2f}" width="{max(cell * 0.92, 0.7):.2f}" height="{max(cell * 0.92, 0.7):.2f}"/>'
        for i, j in entries
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(title)}" viewBox="-1 -1 {size + 2} {size + 2}"'
        f' width="{size}"><rect width="{size}" height="{size}" fill="#fff" stroke="#999"/><g fill="#0072b2">{dots}</g></svg>'
    )
