"""`crease bench NAME`: properties of the force, run time against error, float32, scaling, what skipping saves."""

from __future__ import annotations

from crease.bench.setup import BenchSetup
from crease.experiment.setup import Result

NAMES = ("properties", "pareto", "precision", "scaling", "ablation")


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of NAMES; its files are in setup.out.   Errors: CreaseError."""
    from crease.bench import ablation, pareto, precision, scaling
    from crease.bench.properties import run as judged

    runs = {
        "properties": judged.run,
        "pareto": pareto.run,
        "precision": precision.run,
        "scaling": scaling.run,
        "ablation": ablation.run,
    }
    return runs[name](setup)
