from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ._error import MobeeError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._native import Robot


@dataclass(frozen=True)
class Intrinsics:
    """Projection of a camera: a pinhole with lens distortion.

    Attributes
    ----------
    size : (int, int)
        Width and height, pixels.
    focal : (float, float)
        Focal lengths, pixels.
    center : (float, float)
        Principal point, pixels from the upper left corner of the image; the center of the first pixel is (0.5, 0.5).
    distortion : list of float
        k1, k2, p1, p2 of Brown and Conrady, in the order of OpenCV; all zero: none.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    center: tuple[float, float]
    distortion: Sequence[float]

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The camera matrix, ndarray (3, 3), for points whose first pixel has its center at (0.5, 0.5). OpenCV counts from (0, 0): there,
        subtract 0.5 from the last column."""
        (fx, fy), (cx, cy) = self.focal, self.center
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Frame:
    """Image of one exposure.

    Attributes
    ----------
    camera : str
        ``sensor/camera``.
    at : float
        Time of the middle of the exposure, s of the run's clock.
    pixels : ndarray (height, width, 3) of uint8
        Red, green, blue; read-only.
    intrinsics : Intrinsics
    """

    camera: str
    at: float
    pixels: NDArray[np.uint8]
    intrinsics: Intrinsics


@dataclass(frozen=True, eq=False)
class Region:
    """Part of a frame that shows an object.

    Attributes
    ----------
    object : str
        Name of the object in the world.
    bounds : array (4,)
        Left, top, right, bottom, pixels.
    center : array (2,), optional
        Mean of its pixels; default: the middle of `bounds`. The center of the first pixel is (0.5, 0.5).
    area : float, optional
        Pixels; default: that of `bounds`.
    confidence : float
        0 to 1.
    is_clipped : bool, optional
        It touches the border of the image; default: `bounds` do.
    pose : array (4, 4), optional
        ``camera_from_object``, meters, if one image suffices to estimate it (z along the optical axis, x to the right, y down).
    covariance : array (6, 6), optional
        With `pose`: of the position (m) and of a small rotation about the camera's axes (rad).
    """

    object: str
    bounds: ArrayLike
    center: ArrayLike | None = None
    area: float | None = None
    confidence: float = 1.0
    is_clipped: bool | None = None
    pose: ArrayLike | None = None
    covariance: ArrayLike | None = None

    @staticmethod
    def of_mask(object: str, mask: ArrayLike, confidence: float = 1.0) -> Region | None:
        """The region of the pixels that are not zero; None without any.

        Parameters
        ----------
        object : str
            Name of the object in the world.
        mask : array (height, width)
            As large as the frame.
        confidence : float
            0 to 1.
        """
        pixels = np.asarray(mask) != 0
        if pixels.ndim != 2:
            raise MobeeError("shape", f"mask has {pixels.ndim} dimensions", "mask", "give an array (height, width)")
        rows, columns = np.nonzero(pixels)
        if rows.size == 0:
            return None
        bounds = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        center = (columns.mean() + 0.5, rows.mean() + 0.5)
        return Region(object, np.array(bounds, float), center, float(rows.size), confidence)


@dataclass(frozen=True)
class Sighting:
    """A region with its camera and time.

    Attributes
    ----------
    camera : str
        ``sensor/camera``.
    at : float
        Time of the exposure, s.
    region : Region
    intrinsics : Intrinsics
    """

    camera: str
    at: float
    region: Region
    intrinsics: Intrinsics


@dataclass(frozen=True, eq=False)
class Body:
    """The robot that carries the cameras, at the time of an exposure.

    Attributes
    ----------
    at : float
        That time, s.
    q : ndarray (dof,)
        Its measured configuration, rad or m.
    model : Robot
    base : ndarray (4, 4)
        ``world_from_base``, meters.
    """

    at: float
    q: NDArray[np.float64]
    model: Robot
    base: NDArray[np.float64]

    def pose(self, frame: str) -> NDArray[np.float64]:
        """Pose of a frame, such as a camera's link, ndarray (4, 4), ``world_from_frame``, meters: see `Robot.fk`."""
        q = np.clip(self.q, self.model.lower, self.model.upper)
        pose: NDArray[np.float64] = self.base @ self.model.fk(q, frame)
        return pose


@dataclass(frozen=True, eq=False)
class Located:
    """Position of an object.

    Attributes
    ----------
    object : str
        Its name in the world.
    position : array (3,)
        In the world, meters: the mean of its shapes' centers.
    covariance : array (3, 3)
        Of the position, square meters. The sensor's gate refuses what is too uncertain.
    """

    object: str
    position: ArrayLike
    covariance: ArrayLike


class _Sense:
    takes: float = 0.0

    def export(self) -> Any:
        """What it has learned, as JSON, for its next life. Called after each call."""
        return None

    def import_(self, state: Any) -> None:
        """Takes over what `export` returned last. Called after a death, before the next call."""


class Detector(_Sense):
    """Base of detectors: code that finds regions in the images of a camera, such as a network of torch, or OpenCV.

    All methods are called in the thread that called `mobee.run`. In virtual time the clock stands during a call, and then `takes` passes:
    a run is repeatable, however long the computation took. In real time a detector that is slower than its camera receives the newest
    frame, and agents in Python wait meanwhile. No part of the controller waits for it.

    An exception is the detector's death: the traceback is in the journal (``Run.errors``), and supervision starts it again. After several
    deaths in half a minute the sensor stays down, its objects become stale, and the run goes on.

    Attributes
    ----------
    takes : float
        Simulated duration of a call by a virtual clock, s, 0 to 10.
    """

    takes: float = 0.05

    def detect(self, frame: Frame) -> Sequence[Region]:
        """The regions of a frame, the most confident first: those beyond ``max_regions`` of an object are left out."""
        raise NotImplementedError(f"{type(self).__name__} has no method `detect`")


class Locator(_Sense):
    """Base of locators: code that computes the positions of objects from regions.

    Threads, time and exceptions: as of a `Detector`. Positions pass the sensor's gate before they change the model.

    Attributes
    ----------
    takes : float
        Simulated duration of a call by a virtual clock, s, 0 to 10.
    """

    def locate(self, seen: Sequence[Sighting], body: Body) -> Sequence[Located]:
        """The positions of objects that one camera observed at one instant, as far as they can be computed.

        Parameters
        ----------
        seen : sequence of Sighting
            All of one camera and one instant; one at least.
        body : Body
            The robot at that instant. It has the pose of each frame: ``body.pose("l_eye")``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method `locate`")
