"""Compiles the native core when mbdae is installed or a wheel is made; mbdae/native/build.py says how."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


def native_build(root: str) -> ModuleType:
    """The module mbdae.native.build by its file: the package itself cannot be imported before its requirements are installed."""
    spec = importlib.util.spec_from_file_location("mbdae_native_build", Path(root, "mbdae", "native", "build.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class NativeCore(BuildHookInterface):
    """One library in the package, for all versions of Python on a platform."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """A compiler from the package index where no compiler of the system works."""
        build = native_build(self.root)
        return [build.ZIGLANG] if build.needs_ziglang() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile in place, for a wheel and an editable installation alike, and say what platform the wheel is of."""
        build = native_build(self.root)
        try:
            command = build.compiler()
            if said := build.compile_library(command):
                self.app.display_warning(said)
        except build.BuildError as error:
            self.app.abort(str(error))
        build_data["artifacts"].append(f"/{build.LIBRARY.relative_to(Path(self.root).resolve()).as_posix()}")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{build.wheel_platform(command)}"
