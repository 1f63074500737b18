"""`crease bench NAME`: properties of the force, time against error, float32, scaling, skipping, bytes read."""

from __future__ import annotations

from crease.lab.setup import Result

from study.against_exact import BenchSetup

__all__ = ["BenchSetup", "run_bench"]


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of `runs`; its files are in setup.out.   Errors: CreaseError."""
    from study import ablation, pareto, precision, scaling, touched
    from study.properties import run as judged

    runs = {
        "properties": judged.run,
        "pareto": pareto.run,
        "precision": precision.run,
        "scaling": scaling.run,
        "ablation": ablation.run,
        "touched": touched.run,
    }
    return runs[name](setup)
