"""Seeded Monte-Carlo campaigns against the tick: random scenes and poses, truths that must hold in all of them.

    solids   random closed solids, and awkward triangulations of them
    pool     scenes of two solids, baked, and the same scene turned and shifted
    cases    what a case does: poses, settings, checks
    checks   the truths, each with its bound
    campaign chunks of cases, in processes or on a Dask cluster; resumable
    shrink   a violation with fewer poses and simpler solids
    keep     a violation as files that `crease replay` runs

A case is known by (seed, chunk, number): the same three give the same case on every machine.
"""
