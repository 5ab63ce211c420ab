"""Runs operations of a native program on an array of numbers."""

import ctypes

import numpy as np

from mbdae.native.program import Scene, core


def run(operations, W):
    """The code of the run; W, which is as long as the operations say, holds the result."""
    operations.fill(W)
    part, kept = operations.table(len(W))
    x, read = np.zeros(operations.widest + 1), np.array([np.nan, np.inf])
    scene = Scene(W=W.ctypes.data, x=x.ctypes.data, bad=-1, read=read.ctypes.data, t=np.nan, side=np.nan)
    code = core().scene_part(ctypes.addressof(scene), ctypes.addressof(part), 0.0, W.ctypes.data, W.ctypes.data)
    del kept
    return code, int(scene.bad)
