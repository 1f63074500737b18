"""`crease bench NAME`: run time against error, float32 against double, scaling with scene size, what skipping saves."""

from __future__ import annotations

from crease.lab.setup import Result

from study.against_exact import BenchSetup

__all__ = ["BenchSetup", "run_bench"]


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of `runs`; its files are in setup.out.   Errors: CreaseError."""
    from study import ablation, pareto, precision, scaling

    runs = {
        "pareto": pareto.run,
        "precision": precision.run,
        "scaling": scaling.run,
        "ablation": ablation.run,
    }
    return runs[name](setup)
