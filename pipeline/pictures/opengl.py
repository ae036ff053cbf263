"""Windows to draw in, off-screen, and the way of drawing that works here. Nothing else makes a window.

VTK may end the process where OpenGL is missing, so child processes try it. No display is ever asked for,
whatever DISPLAY says: that of an old session may not answer.
"""
import functools
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.memory import LIBRARIES, address_space

if TYPE_CHECKING:
    import pyvista

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
# The default looks for a display first, and prints warnings without one: it comes last.
WINDOWS = {"EGL": "vtkEGLRenderWindow", "OSMesa": "vtkOSOpenGLRenderWindow", "default": None}
SECONDS = 600  # after which a trial hangs; on a busy computer one that does not has taken more than 60
# VTK alone: it starts in less than half of the time of pyvista.
# VTK takes another window, with warnings, where one cannot be made: the name tells.
PROBE = """
import os
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules import vtkRenderingCore as vtk
mapper, actor, renderer = vtk.vtkPolyDataMapper(), vtk.vtkActor(), vtk.vtkRenderer()
window, picture = vtk.vtkRenderWindow(), vtk.vtkWindowToImageFilter()
sphere = vtkSphereSource()
mapper.SetInputConnection(sphere.GetOutputPort())
actor.SetMapper(mapper)
actor.GetProperty().SetColor(1.0, 0.0, 0.0)
actor.GetProperty().LightingOff()
renderer.AddActor(actor)
window.SetOffScreenRendering(True)
window.SetSize(32, 32)
window.AddRenderer(renderer)
picture.SetInput(window)
picture.Update()
pixel = [picture.GetOutput().GetScalarComponentAsDouble(16, 16, 0, color) for color in range(3)]
wanted = os.environ.get("VTK_DEFAULT_OPENGL_WINDOW", window.GetClassName())
raise SystemExit(0 if pixel == [255.0, 0.0, 0.0] and window.GetClassName() == wanted else 3)
"""
ADVICE = "no OpenGL to draw with: " + (
    "macOS has it in a session with a screen" if sys.platform == "darwin" else
    "install it with `apt-get install --no-install-recommends libosmesa6` (or `libegl1 libgl1-mesa-dri`)")


def works(window: str | None) -> bool:
    """Whether a child process draws the right pixel with the VTK window class ``window`` (None: VTK's own choice)."""
    environment = {name: value for name, value in os.environ.items() if name not in (VARIABLE, *DISPLAYS)}
    if window:
        environment[VARIABLE] = window
    try:
        child = subprocess.run([sys.executable, "-c", PROBE], env=environment, capture_output=True, timeout=SECONDS,
                               check=False)
    except subprocess.TimeoutExpired:
        return False
    return child.returncode == 0


def find_working_opengl() -> str:
    """Name in ``WINDOWS`` of the first that works; a choice made by the user's environment comes first.

    Raises
    ------
    UserError : none works; the sentence names the package to install.
    MemoryError : ``ulimit -v`` leaves no room for a trial.
    """
    chosen = [name for name, window in WINDOWS.items() if window and window == os.environ.get(VARIABLE)]
    for name in dict.fromkeys([*chosen, *WINDOWS]):
        if works(WINDOWS[name]):
            return name
    if address_space() < LIBRARIES:
        raise MemoryError("no OpenGL could be tried")
    raise UserError(ADVICE)


def use_working_opengl() -> str:
    """Make VTK use a way of drawing that works, in this process, before its first window; return its name.

    Displays are forgotten, for EGL may ask for one too.

    Raises
    ------
    UserError : none works.
    """
    name = find_working_opengl()
    for variable in (VARIABLE, *DISPLAYS):
        os.environ.pop(variable, None)
    if WINDOWS[name]:
        os.environ[VARIABLE] = WINDOWS[name]
    return name


_ready = functools.cache(use_working_opengl)  # once in a process


def off_screen(**options: Any) -> "pyvista.Plotter":
    """Return a window of pyvista that is on no screen; options as of ``pyvista.Plotter``.

    Raises
    ------
    UserError : nothing to draw with works.
    """
    _ready()
    import pyvista

    return pyvista.Plotter(off_screen=True, **options)


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.pictures.opengl``."""
    parser = stage_parser("pictures.opengl", "Check whether pictures can be drawn on this machine.")
    parser.parse_args(arguments)
    print(f"OpenGL works: {find_working_opengl()}")


if __name__ == "__main__":
    run(main)
