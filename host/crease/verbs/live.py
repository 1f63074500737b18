"""`crease view --live`: the closed loop in real time, with a page that leads the tool."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import sys
import webbrowser
from pathlib import Path

from crease.base.ending import raising
from crease.base.errors import UsageError
from crease.base.scene import open_scene
from crease.replay.trajectory import load_trajectory
from crease.verbs.common import print_either


def run(args: argparse.Namespace, files: list[Path]) -> None:
    """Serve until Ctrl-C or SIGTERM, or for --seconds; then say what the loop did.

    Errors: CreaseError for a scene without meshes, a path out of reach, a missing package, a port that is taken.
    """
    from crease.live.page import make_live_page
    from crease.live.server import Server
    from crease.live.session import Session
    from crease.loop.hil import resample

    if args.output is not None:
        raise UsageError(
            f"-o {args.output}: a page that is live is served, not written; leave it out"
        )
    if len(files) > 1:
        raise UsageError(f"{files[1]}: the hand follows one path; give one")
    scene = open_scene(args.scene)
    path = resample(load_trajectory(files[0])) if files else None
    session = Session(scene, path, stiffness=args.stiffness, response=args.response)
    start_m = [float(v) for v in session.home_m]
    title = args.title or args.scene.stem
    server = Server(
        session,
        lambda socket: make_live_page(scene, title, start_m, args.stiffness, socket),
        args.port,
    )

    def ready(address: str) -> None:
        print(f"live: {address}", file=sys.stderr, flush=True)
        if not args.no_open and sys.stdout.isatty():
            webbrowser.open(address)

    async def serve() -> None:
        told, task = signal.SIGTERM, asyncio.current_task()
        if task is not None and signal.getsignal(told) is signal.default_int_handler:
            asyncio.get_running_loop().add_signal_handler(told, task.cancel)
        await server.serve(ready, args.seconds)

    try:
        with raising(), contextlib.suppress(KeyboardInterrupt, asyncio.CancelledError):
            asyncio.run(serve())
    finally:
        session.stop()
    counts = session.counts
    report: dict[str, object] = {
        "ticks": counts.ticks,
        "ticks_lost": counts.lost,
        "late_max_ms": round(counts.late_max_ms, 3),
        "restarts": counts.restarts,
        "views_sent": server.views,
    }
    print_either(
        args.json,
        report,
        [
            (
                "ticks",
                f"{counts.ticks:,}, {counts.lost:,} lost, {counts.late_max_ms:.0f} ms late at most",
            ),
            ("views sent", f"{server.views:,}"),
            ("restarts", f"{counts.restarts}"),
        ],
    )
