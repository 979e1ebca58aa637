"""One off-screen OpenGL window per process, and pictures read back from it."""

from __future__ import annotations

import atexit
import ctypes
import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera

SYSTEM_PACKAGES = "libegl1 libgl1-mesa-dri (or, for software rendering without EGL, libosmesa6)"
SUM, LARGEST = 0x8006, 0x8008  # OpenGL's GL_FUNC_ADD and GL_MAX: how a fragment is blended with what is there
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")  # the names that VTK tries


class Window:
    """An off-screen OpenGL window that draws one `vtkRenderer` at a time.

    It opens with EGL, else OSMesa on Linux; with the platform's own window elsewhere.  A process needs one
    (`open_window`): a new one costs about 25 ms, and every renderer can use it in turn.  Any thread may use it, one at a time:
    an OpenGL context belongs to one thread, so each takes it and lets it go again.  A forked child may not.

    Raises RuntimeError where the machine offers no usable OpenGL, naming the system packages to install.
    """

    def __init__(self) -> None:
        self._window, self.backend = _usable_window()
        self._process, self._lock = os.getpid(), threading.RLock()
        self._float_pass: Any = None
        self._window.ReleaseCurrent()

    @contextmanager
    def _current(self) -> Iterator[None]:
        """OpenGL belongs to this thread meanwhile."""
        with self._lock:
            self._window.MakeCurrent()
            try:
                yield
            finally:
                self._window.ReleaseCurrent()

    def add(self, renderer: Any) -> None:
        """Take in a `vtkRenderer`: transparent black background, drawn only when asked."""
        renderer.SetBackground(0.0, 0.0, 0.0)  # any other colour would be added into the picture where alpha < 1
        renderer.SetBackgroundAlpha(0.0)
        renderer.DrawOff()
        with self._lock:  # VTK draws without Python's own lock
            self._window.AddRenderer(renderer)

    def remove(self, renderer: Any) -> None:
        """Let go of a `vtkRenderer` and free what it holds in graphics memory."""
        if self._usable_here():
            with self._current():
                renderer.SetPass(None)
                self._window.RemoveRenderer(renderer)

    def draw(
        self, renderer: Any, width: int, height: int, *, float_output: bool = False, once: bool = False
    ) -> NDArray[Any]:
        """Draw `renderer` alone; premultiplied RGBA [height, width, 4], top row first, uint8 or float32 in [0, 1].

        With `once` what is drawn twice in a pixel, the same both times, counts once: faces of a volume's box that are seen edge-on
        may overlap by rounding.
        """
        return self._draw(renderer, width, height, float_output, once=once)[0]

    def draw_with_depths(
        self, renderer: Any, width: int, height: int, *, float_output: bool = False
    ) -> tuple[NDArray[Any], NDArray[np.float32]]:
        """The same, and the depths [height, width], from 0 at the near plane to 1 at the far one, and 1 where nothing is."""
        image, depths = self._draw(renderer, width, height, False, depths=True)
        if float_output:  # drawn twice: the float picture's own depths can't be read back everywhere
            image = self.draw(renderer, width, height, float_output=True)
        return image, depths

    def _draw(
        self, renderer: Any, width: int, height: int, float_output: bool, *, depths: bool = False, once: bool = False
    ) -> tuple[NDArray[Any], Any]:
        if not self._usable_here():
            raise RuntimeError(
                "the OpenGL window was opened before a fork: start worker processes with the 'spawn' method"
            )
        with self._current():
            if self._window.GetSize() != (width, height):
                self._window.SetSize(width, height)
            renderer.SetPass(self._float_target() if float_output else None)
            renderer.DrawOn()
            state = self._window.GetState()
            try:
                state.vtkglBlendEquation(LARGEST if once else SUM)
                self._window.Render()
                image = self._read_float(width, height) if float_output else self._read_bytes(width, height)
                depth_image = self._read_depths(width, height)[::-1].copy() if depths else None
            finally:
                state.vtkglBlendEquation(SUM)
                renderer.DrawOff()
        return image[::-1].copy(), depth_image  # OpenGL's rows start at the bottom

    def driver(self) -> tuple[str, str, str]:
        """OpenGL's vendor, renderer and version, "" for what VTK does not report."""
        with self._current():
            report = self._window.ReportCapabilities()
        strings = dict(re.findall(r"^OpenGL (\w+) string: *(.*?) *$", report, re.MULTILINE))
        return strings.get("vendor", ""), strings.get("renderer", ""), strings.get("version", "")

    @property
    def longest_volume(self) -> int:
        """Samples per axis that a volume's texture may have."""
        from vtkmodules.vtkRenderingOpenGL2 import vtkTextureObject

        with self._current():
            return int(vtkTextureObject.GetMaximumTextureSize3D(self._window))

    @cached_property
    def longest_side(self) -> int:
        """Pixels that a picture may be wide or high."""
        from vtkmodules.vtkRenderingOpenGL2 import vtkTextureObject

        with self._current():
            return int(vtkTextureObject.GetMaximumTextureSize(self._window))

    def close(self) -> None:
        """Free the OpenGL context; the window cannot be used afterwards."""
        if self._usable_here():
            with self._lock:
                self._window.MakeCurrent()
                if self._float_pass is not None:
                    self._float_pass.ReleaseGraphicsResources(self._window)
                    self._float_pass = None
                self._window.Finalize()

    def _usable_here(self) -> bool:
        return os.getpid() == self._process

    def _float_target(self) -> Any:
        from vtkmodules.vtkRenderingOpenGL2 import vtkFramebufferPass, vtkRenderStepsPass, vtkTextureObject

        if self._float_pass is None:
            self._float_pass = vtkFramebufferPass()
            self._float_pass.SetColorFormat(vtkTextureObject.Float32)
            self._float_pass.SetDepthFormat(vtkTextureObject.Fixed32)  # the window's own: else rays end at once
            self._float_pass.SetDelegatePass(vtkRenderStepsPass())
        return self._float_pass

    def _read_float(self, width: int, height: int) -> NDArray[np.float32]:
        from vtkmodules.vtkCommonCore import VTK_FLOAT

        image = np.empty((height, width, 4), dtype=np.float32)
        pixels = self._float_pass.GetColorTexture().Download()
        if pixels.GetReferenceCount() > 1:  # VTK gives one away for good, and its Python wrapper takes another
            pixels.UnRegister(None)
        if not pixels.Download2D(VTK_FLOAT, image, (width, height), 4, (0, 0)):
            raise RuntimeError(f"reading a {width} x {height} float picture back from OpenGL failed")
        return image

    def _read_bytes(self, width: int, height: int) -> NDArray[np.uint8]:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        pixels = vtkUnsignedCharArray()
        self._window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, pixels)
        return vtk_to_numpy(pixels).reshape(height, width, 4)

    def _read_depths(self, width: int, height: int) -> NDArray[np.float32]:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkFloatArray

        depths = vtkFloatArray()
        self._window.GetZbufferData(0, 0, width - 1, height - 1, depths)
        return vtk_to_numpy(depths).reshape(height, width)


_opening = threading.Lock()
_opened: dict[int, Window] = {}  # process id -> its window: OpenGL contexts are per process and expensive


def open_window() -> Window:
    """This process's window, opened at the first call."""
    with _opening:
        window = _opened.get(os.getpid())
        if window is None:
            if _opened:
                raise RuntimeError(
                    "this process was forked after its parent had opened an OpenGL window, which breaks the driver's "
                    "threads: start worker processes with the 'spawn' method"
                )
            window = _opened[os.getpid()] = Window()
            atexit.register(_close_all)
        return window


def aim(renderer: Any, camera: Camera, near: float, far: float) -> None:
    """Point the VTK camera of `renderer` like `camera`, with clipping planes at `near` and `far`.

    The projection is an explicit matrix, so that unequal focal lengths and off-centre principal points come out exactly.  VTK's
    `SetWindowCenter` and view angle know neither pixels nor two focal lengths.
    """
    from vtkmodules.vtkCommonMath import vtkMatrix4x4

    view = renderer.GetActiveCamera()
    view.SetPosition(*camera.position)
    view.SetFocalPoint(*(camera.position + camera.forward))
    view.SetViewUp(*camera.up)
    view.SetClippingRange(near, far)
    matrix = vtkMatrix4x4()
    for (row, column), value in np.ndenumerate(projection_matrix(camera, near, far)):
        matrix.SetElement(row, column, value)
    view.SetExplicitProjectionTransformMatrix(matrix)
    view.UseExplicitProjectionTransformMatrixOn()


def projection_matrix(camera: Camera, near: float, far: float) -> NDArray[np.float64]:
    """OpenGL clip matrix (4, 4) of a pinhole camera, for eye axes x right, y up, z backward.

    Hartley & Zisserman's K written as the frustum of the OpenGL specification, section "Viewing volumes".
    """
    return np.array(
        [
            [2.0 * camera.fx / camera.width, 0.0, 1.0 - 2.0 * camera.cx / camera.width, 0.0],
            [0.0, 2.0 * camera.fy / camera.height, 2.0 * camera.cy / camera.height - 1.0, 0.0],
            [0.0, 0.0, -(far + near) / (far - near), -2.0 * far * near / (far - near)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )


def _usable_window() -> tuple[Any, str]:
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    display = vtkObject.GetGlobalWarningDisplay()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)  # a refused backend needs no message: the next is tried
    vtkObject.GlobalWarningDisplayOff()
    try:
        for backend, make in _backends():
            window = make()
            window.SetOffScreenRendering(True)
            window.SetShowWindow(False)
            window.SetMultiSamples(0)  # multisampled windows neither keep alpha exactly nor sample volumes better
            window.SetAlphaBitPlanes(1)
            window.SetSize(64, 64)
            if window.SupportsOpenGL():
                window.Initialize()
                return window, backend
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(verbosity))
        vtkObject.SetGlobalWarningDisplay(display)
    raise RuntimeError(
        f"no usable OpenGL on this machine: install the system packages {SYSTEM_PACKAGES}"
        ' with, on Debian or Ubuntu, `sudo apt-get install`; or draw without OpenGL, with backend="cpu"'
    )


def _backends() -> list[tuple[str, Any]]:
    """Ways to open a window here, best first; only those whose library loads, because VTK crashes without OSMesa."""
    import vtkmodules.vtkRenderingOpenGL2 as opengl

    if not sys.platform.startswith("linux"):
        from vtkmodules.vtkRenderingCore import vtkRenderWindow

        return [("native", vtkRenderWindow)]
    backends: list[tuple[str, Any]] = []
    if _loads("libEGL.so.1"):
        backends.append(("EGL", opengl.vtkEGLRenderWindow))
    if any(map(_loads, OSMESA_LIBRARIES)):
        backends.append(("OSMesa", opengl.vtkOSOpenGLRenderWindow))
    return backends


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _close_all() -> None:
    for window in _opened.values():
        window.close()
    _opened.clear()
