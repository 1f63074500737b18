"""`crease hil`: the closed loop of servo, bus, drives, mechanism and operator, along a path."""

from __future__ import annotations

import argparse
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from crease.base.progress import Progress
from crease.base.scene import open_scene
from crease.base.table import (
    check_suffix,
    check_target,
    together,
    write_atomic,
    write_bytes,
    write_table,
)
from crease.replay.replay import DEFAULT_RESPONSE
from crease.replay.trajectory import load_trajectory
from crease.verbs.common import (
    SubParsers,
    add_couple,
    add_force,
    add_json,
    add_scene,
    add_stiffness,
    couple_options,
    far_centre,
    number,
    print_either,
    warn,
    whole_in,
)


def add_parser(sub: SubParsers) -> None:
    """The command line of the verb."""
    parser = sub.add_parser(
        "hil",
        help="close the loop: servo, bus, drives, mechanism and operator along a path",
        description="An operator leads the tool along a path while the servo of the firmware renders the contact. "
        "Every tick is recorded. inprocess: both ends here, in lock-step, the same to the bit each time. "
        "socketcan: `creased` and `crease sim` on a real interface. Exit status 4 when the servo stopped in fault.",
    )
    add_scene(parser)
    parser.add_argument(
        "--operator",
        metavar="PATH.csv",
        type=Path,
        required=True,
        help="where the hand wants the tool: t_s,x_m,y_m,z_m,qw,qx,qy,qz",
    )
    parser.add_argument(
        "-i",
        "--interface",
        choices=("inprocess", "socketcan"),
        default="inprocess",
        help="default: inprocess",
    )
    parser.add_argument("-c", "--channel", metavar="NAME", help="of socketcan (default: vcan0)")
    parser.add_argument(
        "-b",
        "--bitrate",
        metavar="BIT/S",
        type=int,
        default=None,
        help="of socketcan, where the interface sets it: 1000000",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.crr",
        type=Path,
        required=True,
        help="the recording; or OUT.mcap: ROS 2 messages with contact points and areas; with --couple a table, "
        "CSV or NPZ",
    )
    parser.add_argument(
        "--table", metavar="OUT.csv", type=Path, help="the ticks of the path as CSV or NPZ"
    )
    parser.add_argument(
        "--log", metavar="OUT.log", type=Path, help="the frames (in process): .log, .asc or .blf"
    )
    parser.add_argument(
        "--device",
        metavar="SIM.toml",
        type=Path,
        help="parameters of the simulated device, as for `crease sim`; table wrist: its motors (in process)",
    )
    parser.add_argument(
        "--fault",
        metavar="KIND:tick=N,...",
        action="append",
        default=[],
        help="as for `crease sim`, such as drop:tick=1500,id=0x191; repeatable (in process)",
    )
    add_stiffness(parser, couple=True)
    parser.add_argument(
        "--response",
        metavar="NAME",
        default=DEFAULT_RESPONSE,
        help=f"as for `crease replay` (in process; default: {DEFAULT_RESPONSE})",
    )
    add_couple(
        parser,
        "a handle of six axes, in process: the tool is held outside the mock-up, --stiffness and --damping are of the "
        "spring to the hand, and a wrist with motors, simulated beside the bus, gives its torque",
    )
    parser.add_argument(
        "--damping",
        metavar="Ns/m",
        type=number(0.0, 1e4),
        help="of the spring along, with --couple: 0 to 1e4 (default: 0)",
    )
    parser.add_argument(
        "--delay",
        metavar="MS",
        type=whole_in(0, 7),
        help="from a sample to its wrench, with --couple: 0 to 7 (default: that of the bus, 1)",
    )
    add_json(parser)
    add_force(parser)
    parser.set_defaults(run=run)


_ELSEWHERE = {
    "device": "--device: only with -i inprocess; start `crease sim --device` and `creased` by hand",
    "fault": "--fault: only with -i inprocess; start `crease sim --fault` and `creased` by hand",
    "log": "--log: only with -i inprocess; run `crease bus -o LOG` beside it",
    "response": "--response: only with -i inprocess; creased has way_out alone",
}
"""What to do on a real interface about the options that this program cannot give."""


FAULTED = 4
"""Exit status of a servo that stopped in fault, as of creased."""


def run(args: argparse.Namespace) -> int:
    """Output: 0; 4: the servo stopped in fault, and the outputs are there all the same.

    Errors: CreaseError for bad inputs, an output that cannot be written, or a loop that does not come up.
    """
    from crease.base.ending import raising
    from crease.base.errors import UsageError
    from crease.bus.transport import check_bitrate, check_channel
    from crease.loop.hil import describe, run_socketcan
    from crease.replay.recording import SUFFIX, recording_bytes
    from crease.verbs.sim import never_acted, parse_faults

    faults = parse_faults(args.fault)
    handle = _handle_of(args)
    _check_outputs(args, (".csv", ".npz") if handle else (SUFFIX, ".mcap"))
    check_bitrate(args.bitrate)
    for letter, given in (("c", args.channel), ("b", args.bitrate)):
        if given is not None and args.interface != "socketcan":
            raise UsageError(f"-{letter} is of a bus; give -i socketcan too, or leave it out")
    channel = args.channel or "vcan0"
    scene, path = open_scene(args.scene), load_trajectory(args.operator)
    warn(far_centre(scene, couple_options(args)))
    if args.interface == "socketcan":
        given = [name for name in ("device", "fault", "log") if getattr(args, name)]
        if given or args.response != DEFAULT_RESPONSE:
            raise UsageError(_ELSEWHERE[(*given, "response")[0]])
        check_channel(args.interface, channel)
    with together():
        if args.interface == "socketcan":
            with raising(), tempfile.TemporaryDirectory(prefix="crease-hil-") as folder:
                record = Path(folder) / "run.crr"
                result = run_socketcan(args.scene, scene, path, channel, record, args.stiffness)
        else:
            result = _run_inprocess(args, scene, path, handle, faults)
        rows = result.recording.rows
        warn(never_acted(args.fault, result.syncs, result.injected))
        if handle is not None:
            write_table(args.output, _held_table(result))
        elif args.output.suffix == ".mcap":
            from crease.replay.export import write_recording

            write_recording(args.output, result.recording, scene)
        else:
            write_bytes(args.output, recording_bytes(rows, result.recording.config, scene))
        if args.table is not None:
            write_table(args.table, _table(result))
    report = {"output": str(args.output), "transport": args.interface, **describe(result)}
    print_either(args.json, report, _lines(report))
    return FAULTED if report["faulted"] else 0


_LOGS = (".log", ".asc", ".blf")


def _check_outputs(args: argparse.Namespace, suffixes: tuple[str, ...]) -> None:
    """Errors: CreaseError for an output that cannot be written.   suffixes: of -o."""
    outputs = ((args.output, suffixes), (args.table, (".csv", ".npz")), (args.log, _LOGS))
    for path, known in outputs:
        if path is not None:
            check_suffix(path, known)
            check_target(path, args.force, (args.scene, args.operator))


def _handle_of(args: argparse.Namespace) -> Any:
    """A `HandleSetup` with --couple, else None.   Errors: UsageError for options that do not go together."""
    from crease.base.errors import UsageError

    couple = couple_options(args)
    if couple is None:
        for name in ("damping", "delay"):
            if getattr(args, name) is not None:
                raise UsageError(f"--{name} is of a held tool; give --couple too")
        return None
    if args.interface == "socketcan":
        raise UsageError("--couple: only with -i inprocess; the wrist is simulated beside the bus")
    if args.response != DEFAULT_RESPONSE:
        raise UsageError(f"--response {args.response}: a held tool has no response but its own")
    if args.table is not None:
        raise UsageError("--couple has no --table; the table is what -o names")
    from crease.loop.handle import HandleSetup
    from crease.verbs.sim import load_device

    return HandleSetup(args.stiffness, args.damping or 0.0, couple, load_device(args.device)[1])


def _run_inprocess(
    args: argparse.Namespace, scene: Any, path: Any, handle: Any, faults: Any
) -> Any:
    from crease.base.errors import UsageError
    from crease.base.native import RESPONSES, ffi, lib
    from crease.loop.hil import run_inprocess
    from crease.verbs.sim import load_params

    if args.response not in RESPONSES:
        raise UsageError(f"--response {args.response}: is not known; use {' or '.join(RESPONSES)}")
    config = ffi.new("cr_servo_config *", lib.cr_servo_config_default())
    config.world.stiffness_N_m = args.stiffness
    config.world.response = RESPONSES[args.response]
    params = load_params(args.device)
    if args.delay is not None:
        params.c.torque_delay_s = 1e-3 * args.delay
    held = {"handle": handle, "at_once": args.delay is not None}
    with Progress() as progress:

        def say(part: float) -> None:
            progress("hil", part)

        if args.log is None:
            return run_inprocess(scene, path, config, params, faults, progress=say, **held)
        results: list[Any] = []

        def run_into(keep: Callable[[float, Any], None]) -> None:
            results.append(
                run_inprocess(
                    scene, path, config, params, faults, on_frame=keep, progress=say, **held
                )
            )

        write_atomic(args.log, lambda file: _log_into(file, args.log.suffix.lower(), run_into))
        return results[0]


def _log_into(
    file: BinaryIO, suffix: str, run_into: Callable[[Callable[[float, Any], None]], None]
) -> None:
    """Write the frames of a run to a file in the format of the suffix, one of _LOGS.

    run_into: makes the run, and tells what it is given of every frame: when, s, and what.
    """
    import can

    make: Any = {".log": can.CanutilsLogWriter, ".asc": can.ASCWriter, ".blf": can.BLFWriter}
    with make[suffix](file if suffix == ".blf" else io.TextIOWrapper(file, "ascii")) as log:

        def keep(t_s: float, frame: Any) -> None:
            log.on_message_received(
                can.Message(
                    timestamp=t_s,
                    arbitration_id=frame.id,
                    data=frame.data,
                    is_extended_id=False,
                    channel="inprocess",
                )
            )

        run_into(keep)


def _felt_columns(felt: Any) -> dict[str, Any]:
    """Columns of what the simulator knows."""
    columns: dict[str, Any] = {}
    for field, names in (
        ("hand_force_N", ("hand_fx_N", "hand_fy_N", "hand_fz_N")),
        ("tip_acc_m_s2", ("ax_m_s2", "ay_m_s2", "az_m_s2")),
        ("hand_target_m", ("hand_x_m", "hand_y_m", "hand_z_m")),
    ):
        columns.update(zip(names, np.ascontiguousarray(felt[field].T), strict=True))
    return columns


def _held_table(result: Any) -> dict[str, Any]:
    """Every tick of the path, with the held tool."""
    from crease.loop.handle import handle_columns

    along = result.along
    columns = handle_columns(result.handle[along], result.recording.rows[along])
    return columns | _felt_columns(result.mechanism[along])


def _table(result: Any) -> dict[str, Any]:
    from crease.replay.recording import to_columns

    along = result.along
    columns = to_columns(result.recording.rows[along])
    if len(result.mechanism):
        columns |= _felt_columns(result.mechanism[along])
    return columns


def _lines(report: dict[str, Any]) -> list[tuple[str, str]]:
    held = "torque_max_Nm" in report
    coupling = report["couple_faults"] if held else 0
    first = report["first_faults"]
    marked = [f"{name} (first)" for name in first]
    marked += [name for name in report["faults"] if name not in first]
    faults = ", ".join([*marked, *([f"coupling {coupling:#x}"] if coupling else [])])
    lines = [
        ("table" if held else "recording", report["output"]),
        ("transport", report["transport"]),
        (
            "ticks",
            f"{report['ticks']:,}, {report['ticks_rendering']:,} rendering, {report['ticks_in_contact']:,} in contact, "
            f"{report['ticks_limited']:,} limited",
        ),
        *([] if held else [("contact", report["contact"])]),
        ("force", f"{report['force_max_N']:.4g} N max"),
        *([("torque", f"{report['torque_max_Nm']:.4g} N m max")] if held else []),
        ("hand", f"{1e3 * report['depth_max_m']:.4g} mm from the held tool at most")
        if held
        else ("depth", f"{1e3 * report['depth_max_m']:.4g} mm max"),
        ("energy", f"{1e3 * report['energy_max_J']:.3g} mJ given to the hand at most"),
    ]
    if "buzz_m_s2" in report:
        lines.append(("buzz", f"{report['buzz_m_s2']:.3g} m/s^2, 20..250 Hz"))
    lines.append(
        (
            "bus",
            f"{report['missing']} states missing, {report['late']} late, {report['frames_lost']} lost",
        )
    )
    if held:
        late, limited = report["ticks_late"], report["ticks_couple_limited"]
        lines.append(("held tool", f"{late:,} ticks behind its hand, {limited:,} limited"))
    lines.append(("faults", faults or "none"))
    return lines
