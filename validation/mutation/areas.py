"""Areas of the package: their sources, and the tests that are theirs, the quickest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Area:
    """sources: files or folders of mbdae; tests: files or folders of tests; share: mutants of 200."""

    name: str
    share: int
    sources: tuple[str, ...]
    tests: tuple[str, ...]

    def files(self, root: Path, endings: tuple[str, ...] = (".py", ".c", ".h", ".inc")) -> list[Path]:
        """Its sources in a checkout, sorted."""
        return sorted(path for path in _files(root / "mbdae", self.sources) if path.suffix in endings)

    def test_files(self, root: Path) -> list[str]:
        """Its test files in a checkout, in the order stated."""
        found = _files(root / "tests", self.tests)
        return list(dict.fromkeys(str(p.relative_to(root)) for p in found if p.name.startswith("test_")))


def _files(root: Path, names: tuple[str, ...]) -> Iterator[Path]:
    for name in names:
        place = root / name
        if not place.exists():
            raise ValueError(f"areas.py names {place}, which does not exist")
        yield from [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.is_file())


AREAS = (
    Area("laws", 30, ("laws/joints.py", "laws/joint_rows.py", "laws/forces.py", "laws/on_coordinates.py"),
         ("laws/joints", "laws/forces", "laws/test_own_laws_stay.py", "scene/test_couplings.py", "scene/test_joint_limits.py",
          "oracles", "system/test_joint_stops.py", "scene/test_three_frames.py", "control", "reference/test_joint_models.py",
          "analysis/test_equilibrium.py", "contracts")),
    Area("contact", 20, ("laws/contact.py", "laws/surfaces.py", "laws/journal.py"),
         ("laws/contact/test_surfaces.py", "laws/contact/test_free_bodies.py", "native/test_contacts.py",
          "system/test_contact_start.py", "scene/test_clearance.py", "laws/contact/test_journal.py",
          "results/test_contact_stability.py", "contracts/test_laws.py")),
    Area("friction", 10, ("laws/friction.py", "laws/on_coordinates.py"),
         ("laws/friction", "scene/test_joint_friction.py", "contracts/test_laws.py")),
    Area("elements", 20, ("laws/bodies.py", "laws/beam.py", "laws/line_mesh.py"),
         ("laws/elements", "system/test_beam_signs.py", "results/test_beam_energy.py", "scene/test_bent_start.py",
          "scene/test_beams_stored.py", "native/test_line_program.py", "oracles", "analysis/test_beams.py")),
    Area("symbolic", 30, ("symbolic",),
         ("laws/joints", "laws/forces", "system/test_tree_rates.py", "system/test_recursive_models.py", "trees", "oracles",
          "scene/test_own_joint.py", "scene/test_three_frames.py", "system/test_switches.py", "contracts/test_law_mistakes.py",
          "contracts/test_motion.py", "contracts/test_paper.py", "contracts/test_domain.py", "contracts/test_undefined.py",
          "disk/test_keys.py", "kernels", "laws/elements/test_line_law.py", "laws/friction", "reports/test_laws.py",
          "scene/test_storage_laws.py", "contracts/test_laws.py")),
    Area("system", 30, ("system",),
         ("system/test_system.py", "system/test_needed.py", "trees", "system", "oracles", "scene/test_start.py",
          "scene/test_stated_velocities.py", "scene/test_own_joint.py", "scene/test_check.py", "scene/test_recursive_scenes.py",
          "reference/test_singular_positions.py", "reference/test_loops.py", "control", "integrators/test_dae.py",
          "results/test_accelerations.py", "results/test_guards.py", "scene/test_bent_start.py", "results/test_choice_by_laws.py",
          "scene/test_stiff_beams.py", "scene/test_clearance.py")),
    Area("integrators", 20, ("integrators",),
         ("integrators/test_dop853.py", "integrators/test_estimate.py", "integrators/test_orders.py", "integrators",
          "inputs/test_timed_runs.py", "results/test_defect.py")),
    Area("native", 20, ("native",),
         ("native", "inputs/test_tables.py", "integrators/test_counts.py", "integrators/test_dop853.py",
          "integrators/test_native_sundials.py", "integrators/test_cvode.py", "integrators/test_callbacks.py",
          "integrators/test_batch.py", "integrators/test_interruption.py", "integrators/test_contact_steps.py",
          "integrators/test_switching.py", "integrators/test_radau_order.py", "trees")),
    Area("run", 20, ("run",),
         ("integrators/test_estimate.py", "scene/test_simulate.py", "results/test_defect.py", "results/test_choice_by_laws.py",
          "results/test_guards.py", "results/test_covers.py", "inputs/test_timed_runs.py", "integrators/test_accuracy.py",
          "integrators/test_batch.py", "integrators/test_services.py", "integrators/test_checkpoints.py", "control",
          "results/test_choice.py", "results/test_continued.py", "results/test_cost.py", "results/test_check_of_joints.py",
          "results/test_nearer.py",
          "scene/test_check.py", "results/test_contact_stability.py", "system/test_needed.py",
          "system/test_recursive_motion.py", "test_ties.py")),
)


def area(name: str) -> Area:
    """The area of a name."""
    return next(a for a in AREAS if a.name == name)
