"""The folder of stored kernels: the user's folder for caches or one named by the environment; and whether it is safe to use."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from pathlib import Path

#: environment variable: the folder of the cache, or "off" for no cache; unset: the system's usual folder
VARIABLE = "MBDAE_CACHE"
OTHERS = 0o077  #: permission bits of the group and of all others: a file or folder of the cache with one of them set is not used
#: flags with which every file of the cache is opened, as far as the system has them: follow no symbolic link, do not wait for the
#: other end of a pipe, do not pass the file on to child processes, do not change line ends
FLAGS = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))


def chosen_folder() -> tuple[Path | None, str]:
    """The folder; or None and the reason why nothing is stored."""
    said = os.environ.get(VARIABLE, "")
    if said.lower() == "off":
        return None, f"{VARIABLE}=off"
    try:
        return (Path(os.path.abspath(Path(said).expanduser())) if said else _usual_folder()), ""
    except (OSError, RuntimeError, ValueError) as error:  # no home folder, or a name that no folder can have
        return None, f"there is no folder for caches ({error})"


def _usual_folder() -> Path:
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA", "")
        return Path(local) / "mbdae" / "Cache" if local else Path.home() / "AppData" / "Local" / "mbdae" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "mbdae"
    given = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(given) if os.path.isabs(given) else Path.home() / ".cache") / "mbdae"


def made(folder: Path) -> str:
    """Make the folder, for this user only, where it is missing; returns "" where it may be used, else the reason why not."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        return unsafe(os.lstat(folder), is_folder=True)
    except (OSError, ValueError) as error:
        return f"it cannot be made ({getattr(error, 'strerror', None) or error})"


def opened(path: Path | str, flags: int) -> int:
    """A descriptor of a regular file that only this user can access; OSError for any other file. flags: of `os.open`."""
    found = os.open(path, flags | FLAGS, 0o600)
    why = unsafe(os.fstat(found))
    if why:
        os.close(found)
        raise OSError(why)
    return found


def unsafe(found: os.stat_result, is_folder: bool = False) -> str:
    """Reason not to trust a file or folder; "" where only this user can have written it, as far as the system tells."""
    if not (stat.S_ISDIR if is_folder else stat.S_ISREG)(found.st_mode):
        return f"it is no {'folder' if is_folder else 'file'}"
    if not hasattr(os, "geteuid"):  # Windows: the permissions of the user's profile protect it
        return ""
    if found.st_uid != os.geteuid():
        return "it belongs to another user"
    return "others than its owner have rights on it (chmod 700)" if found.st_mode & OTHERS else ""
