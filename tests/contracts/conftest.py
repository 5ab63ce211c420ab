"""Few variants, for tests whose mistake stands in every one of them."""

from __future__ import annotations

from importlib import import_module

import pytest

from mbdae.contracts.variants import variants


@pytest.fixture
def between_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the variants of a law those between bodies in space, or of one, with the ground and points at one side at most."""
    selftest = import_module("mbdae.contracts")  # the package exports a function of that name
    monkeypatch.setattr(selftest, "variants", lambda *given: (v for v in variants(*given) if v[0].startswith("spatial")))
