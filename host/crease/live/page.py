"""The page of a running loop: bodies and samples once, then views over a socket."""

from __future__ import annotations

import html
import json
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from crease.bake.bodies import read_bodies, reduce_body
from crease.base.scene import Scene
from crease.draw.view.pack import Packer
from crease.draw.view.page import FOLDER as VIEW
from crease.draw.view.page import TRIANGLES_MAX, VIEW_SPAN, add_body, fill
from crease.replay.contacts import tool_samples_m

FOLDER = Path(__file__).parent


def make_live_page(
    scene: Scene, title: str, start_m: list[float], stiffness: float, socket: str
) -> str:
    """The page.   socket: address that it listens to.   Errors: CreaseError without meshes or libraries."""
    packer, meta = Packer(), scene.meta
    for name, body in zip(("static", "tool"), read_bodies(scene), strict=True):
        add_body(packer, name, reduce_body(body, TRIANGLES_MAX))
    packer.add_numbers("samples_m", tool_samples_m(scene), 1e-6)
    low, high = (np.array(list(v)) for v in (meta.static_min_m, meta.static_max_m))
    radius_m, start = float(meta.root_radius_m), np.array(start_m)
    near = np.clip(start, low, high)
    header = {
        "socket": socket,
        "arrays": packer.header,
        "camera": {
            "target_m": (0.5 * (near + start) - [0.0, 0.0, 0.15 * radius_m]).tolist(),
            "direction": [0.42, -0.78, 0.46],
            "span_m": VIEW_SPAN * (1.1 * radius_m + 0.5 * float(np.linalg.norm(start - near))),
        },
        "tool_radius_m": radius_m,
        "spacing_m": float(meta.spacing_m),
        "crease_angle_rad": float(meta.crease_angle_rad),
        "stiffness_N_m": stiffness,
    }
    place = urlsplit(socket)
    return fill(
        (FOLDER / "live.html").read_text(encoding="utf-8"),
        {
            "TITLE": html.escape(title),
            "CONNECT": f"{place.scheme}://{place.netloc}",
            "STYLE": (VIEW / "page.css").read_text("utf-8")
            + (FOLDER / "live.css").read_text("utf-8"),
            "OURS": "\n".join(
                path.read_text("utf-8")
                for path in (
                    VIEW / "decode.js",
                    VIEW / "scene.js",
                    VIEW / "list.js",
                    FOLDER / "live.js",
                )
            ),
            "HEADER": json.dumps(header, allow_nan=False).replace("<", "\\u003c"),
            "DATA": packer.encode(),
        },
    )
