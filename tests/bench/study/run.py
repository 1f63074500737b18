"""`crease bench NAME`: properties of the force, run time against error, float32, scaling, what skipping saves."""

from __future__ import annotations

from crease.lab.setup import Result

from study.against_exact import BenchSetup

__all__ = ["BenchSetup", "run_bench"]


def run_bench(name: str, setup: BenchSetup) -> Result:
    """Run one of `runs`; its files are in setup.out.   Errors: CreaseError."""
    from study import ablation, pareto, precision, scaling
    from study.properties import run as judged

    runs = {
        "properties": judged.run,
        "pareto": pareto.run,
        "precision": precision.run,
        "scaling": scaling.run,
        "ablation": ablation.run,
    }
    return runs[name](setup)
