"""Ray tracing of triangle meshes with kd-trees: the same bytes on every CPU and GPU.

    >>> import numpy as np, raykd
    >>> scene = raykd.Scene(raykd.Mesh.teapot(4), device="cpu")
    >>> hits = scene.closest([0, 0, 50], [0, 0, -1])
    >>> bool(hits.is_hit), bool(30 < hits.t < 50)
    (True, True)

Rays are given as arrays of origins and directions, of shape ``(..., 3)``; they are broadcast against each other, and
answers have the shape of what is before the 3. ``float32`` is taken as it is. All else is taken as ``float64``, which
loses nothing where a mesh lies far from zero; a ray's ``t_min`` and ``t_max`` are inclusive. Directions need not be of
length 1: ``t`` is in lengths of the direction.

A ray with NaN, an infinite number or a zero direction misses, and is counted in ``invalid``.
"""

from ._arrays import AllHits, Crossings, Hits, Steps
from ._raykd import BUILDERS, MISS, SHADINGS, TESTS, TRAVERSALS, __version__, devices
from ._scene import Mesh, Scene, load
from ._render import camera_rays, render

__all__ = [
    "BUILDERS",
    "MISS",
    "SHADINGS",
    "TESTS",
    "TRAVERSALS",
    "AllHits",
    "Crossings",
    "Hits",
    "Mesh",
    "Scene",
    "Steps",
    "__version__",
    "camera_rays",
    "devices",
    "load",
    "render",
]
