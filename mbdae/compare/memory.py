"""Peak memory of the process during a run, where the operating system measures it (Linux)."""

from __future__ import annotations

from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def reset_peak() -> bool:
    """Start a new measurement; False where the system does not offer one."""
    try:
        _RESET.write_text("5")  # Linux then measures the peak anew, beginning with the present size of the process
    except OSError:
        return False
    return True


def peak_bytes() -> int | None:
    """Largest resident size of the process since the last `reset_peak`, bytes; None where it is not measured."""
    try:
        lines = _STATUS.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kilobytes = next((line.split()[1] for line in lines if line.startswith("VmHWM:")), None)
    return None if kilobytes is None else 1024 * int(kilobytes)
