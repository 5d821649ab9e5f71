"""Pictures of scenes."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _raykd
from ._scene import Scene


def camera_rays(
    scene: Scene,
    width: int = 512,
    height: int = 512,
    *,
    eye: Any = None,
    target: Any = None,
    up: Any = (0.0, 1.0, 0.0),
    fov: float = 40.0,
) -> tuple[np.ndarray, np.ndarray]:
    """The origin and, of shape ``(height, width, 3)``, the directions of the rays through the pixels of a picture.

    Without ``eye`` the camera sees the whole scene from the front, the right and a little above. ``fov`` is the angle
    of view from bottom to top, in degrees.
    """
    origin, directions = _raykd.camera_rays(scene._scene, _view(width, height, eye, target, up, fov))
    return np.array(origin), directions.reshape(height, width, 3)


def render(
    scene: Scene,
    width: int = 512,
    height: int = 512,
    *,
    shading: str = "normal",
    samples: int | None = None,
    **camera: Any,
) -> np.ndarray:
    """A picture of the scene as ``raykd render`` draws it, an array of shape ``(height, width, 3)`` of ``uint8``.

    ``shading`` is one of ``raykd.SHADINGS``, ``samples`` the rays along a pixel. ``camera`` is what ``camera_rays``
    takes: ``eye``, ``target``, ``up``, ``fov``.

    >>> from raykd import Mesh
    >>> render(Scene(Mesh.teapot(4), device="cpu"), 32, 24).shape
    (24, 32, 3)
    """
    return _raykd.render(scene._scene, _view(width, height, **camera), shading, samples)


def _view(
    width: int, height: int, eye: Any = None, target: Any = None, up: Any = (0.0, 1.0, 0.0), fov: float = 40.0
) -> tuple[Any, ...]:
    def point(of: Any) -> list[float] | None:
        return None if of is None else [float(x) for x in of]

    return width, height, point(eye), point(target), point(up), float(fov)
