"""`crease replay` of a recording: its ticks run through the library again, compared to the bit."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from crease.base.errors import RecordingError
from crease.base.scene import open_scene
from crease.base.table import write_table
from crease.replay.recording import (
    ages_text,
    contact_ages,
    cut_warning,
    fault_names,
    load_recording,
    rerun,
    to_columns,
)
from crease.verbs.common import print_either, warn


def run(args: argparse.Namespace) -> None:
    """args as of `crease replay`. Settings come from the recording, not from the command line.

    Errors: RecordingError when the recording does not fit the scene, or does not come out the same.
    """
    start_s = time.monotonic()
    scene, recording = open_scene(args.scene), load_recording(args.path)
    result = rerun(recording, scene)
    if args.output.suffix == ".mcap":
        from crease.replay.export import write_recording

        write_recording(args.output, replace(recording, rows=result.rows), scene)
    else:
        write_table(args.output, to_columns(result.rows))
    warnings = cut_warning(recording)
    if result.gap:
        warnings.append(
            f"records are missing after tick {int(recording.rows['tick'][result.records - 1])}: "
            f"{len(recording) - result.records} ticks were not run again"
        )
    warn(warnings)
    faults = sorted(
        {name for bits in set(recording.rows["faults"].tolist()) for name in fault_names(bits)}
    )
    report: dict[str, object] = {
        "output": str(args.output),
        "ticks": result.records,
        "ticks_different": result.different,
        "ticks_rendering": int(recording.rows["counters"]["ticks_rendering"][result.records - 1]),
        "contact_late_ticks_max": int(contact_ages(result.rows).max(initial=-1)),
        "faults": faults,
        "time_s": round(time.monotonic() - start_s, 3),
        "warnings": warnings,
    }
    print_either(
        args.json,
        report,
        [
            ("table", str(args.output)),
            ("ticks", f"{result.records:,} run again, {report['ticks_rendering']:,} rendering"),
            ("contact", ages_text(result.rows)),
            ("different", f"{result.different:,}"),
            ("faults", ", ".join(faults) or "none"),
            ("time", f"{report['time_s']:.2f} s"),
        ],
    )
    if result.different:
        raise RecordingError(
            f"{args.path}: {result.different} of {result.records} ticks do not come out the same, "
            f"the first is {result.first}; was it recorded with another version?"
        )
