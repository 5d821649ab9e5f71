"""Pictures of scenes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from . import _raykd
from ._arrays import text, whole
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
    origin, directions = _raykd.camera_rays(_of(scene), _view(width, height, eye, target, up, fov))
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
    if samples is not None:
        samples = whole(samples, "samples", 1, 8)
    return _raykd.render(_of(scene), _view(width, height, **camera), text(shading, "shading"), samples)


def _of(scene: Any) -> _raykd.Scene:
    if not isinstance(scene, Scene):
        raise TypeError(f"pictures are of a raykd.Scene, but {type(scene).__name__} is given")
    return scene._scene


def _view(
    width: int, height: int, eye: Any = None, target: Any = None, up: Any = (0.0, 1.0, 0.0), fov: float = 40.0
) -> tuple[Any, ...]:
    def point(of: Any, name: str) -> list[float]:
        numbers = [float(x) for x in of]
        if len(numbers) != 3 or not all(math.isfinite(x) for x in numbers):
            raise ValueError(f"{name} must be three finite numbers, but is {of}")
        return numbers

    size = [whole(pixels, "width and height", 1, 16384) for pixels in (width, height)]
    if target is not None and eye is None:
        raise ValueError("target needs eye: without eye the camera sees the whole scene")
    ends = [None if end is None else point(end, name) for end, name in ((eye, "eye"), (target, "target"))]
    upwards = point(up, "up")
    if not any(upwards):
        raise ValueError("up must not be zero")
    return (*size, *ends, upwards, float(fov))
