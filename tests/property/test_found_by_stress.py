"""Cases in which `crease stress` found a defect of `extent`, and that any response has to hold.

Asked of extent each fails when its mend is taken out again. One of them way_out does not hold: it is named, with
how far it jumps.

A case is known by its chunk and number in the campaign of seed 1; the scene is baked anew.
"""

from __future__ import annotations

from functools import cache

import pytest
from stress.campaign import SCENE_SEED
from stress.cases import run_case
from stress.pool import Pair, random_pair

SCENES = 4
"""Of a chunk: the case draws one of them."""

FOUND: dict[str, tuple[tuple[int, int, int], ...]] = {
    # (chunk, case, scene of the chunk)
    "plane of zones that face each other, anywhere above the overlap": ((3, 718, 2), (5, 332, 0)),
    "full depth at a balance of both faces of a plate, none beyond": ((17, 747, 1),),
    "corner of the tool on a face, turned by a static edge far from it": ((19, 126, 2),),
    "crease of the tool that goes on beyond its end": ((4, 828, 0),),
    "nearest face of clusters deep inside changes": ((5, 906, 0),),
    "zone of no weight beyond a concave crease answers in full": ((6, 32, 2),),
}


@cache
def scene(chunk: int, number: int) -> Pair:
    return random_pair((1, chunk, SCENE_SEED + number))[0]


@pytest.mark.slow
@pytest.mark.parametrize("response", ["way_out", "extent"])
@pytest.mark.parametrize("cause", FOUND)
def test_cases_that_were_violated_hold(cause: str, response: str) -> None:
    for chunk, case, number in FOUND[cause]:
        pair = scene(chunk, number)
        # The other scenes of the chunk are not baked: the case draws this one.
        kind, _, found = run_case((1, chunk, case), [pair] * SCENES, response)
        assert kind == "step"
        assert found.violation is None, (chunk, case, found.violation.text)
