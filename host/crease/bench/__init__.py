"""`crease bench NAME`: run time against error, float32 against double, scaling with scene size, what skipping saves."""

from __future__ import annotations

from crease.bench.setup import BenchSetup
from crease.experiment.setup import Result

NAMES = ("pareto", "precision", "scaling", "ablation")


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of NAMES; its files are in setup.out.   Errors: CreaseError."""
    from crease.bench import ablation, pareto, precision, scaling

    runs = {
        "pareto": pareto.run,
        "precision": precision.run,
        "scaling": scaling.run,
        "ablation": ablation.run,
    }
    return runs[name](setup)
