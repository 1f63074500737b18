"""`crease bench NAME`: run time against error, scaling with scene size, what each level of skipping saves."""

from __future__ import annotations

from crease.bench.setup import BenchSetup
from crease.experiment.setup import Result

NAMES = ("pareto", "scaling", "ablation")


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of NAMES; its files are in setup.out.   Errors: CreaseError."""
    from crease.bench import ablation, pareto, scaling

    return {"pareto": pareto.run, "scaling": scaling.run, "ablation": ablation.run}[name](setup)
