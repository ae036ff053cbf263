"""Which device the solver of a stage runs on: what users ask for, checked before anything is computed."""
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.scenes.model import Scene
from pipeline.scenes.reader import describe
from sim.backend.devices import AUTO, DEVICES, best_device, lack, usable_devices

CHOICES = (AUTO, *DEVICES)
HELP = (f"device of the solver, one of {', '.join(CHOICES)}; auto is cuda where there is an NVIDIA GPU, else cpu; "
        "threads mean nothing on a GPU")


def checked_device(device: object, where: str, precision: str = "f32") -> str:
    """Return the device that a user asks for, or the one that "auto" stands for.

    Parameters
    ----------
    where : option, or file and key, that errors name.
    precision : of the real fields.

    Raises
    ------
    UserError : there is no such word, or the solver cannot run on that device of this computer.
    """
    if device not in CHOICES:
        raise UserError(f"{where} is {describe(device)}, but must be one of {', '.join(CHOICES)}")
    if device == AUTO:
        return best_device()
    if reason := lack(device, precision):
        raise UserError(f"{where} is {device}, but {reason}; here it may be "
                        f"{', '.join([AUTO, *usable_devices(precision)])}")
    return device


def chosen_device(option: str | None, scene: Scene, path: Path, where: str = "--device") -> str:
    """Return what an option asks for or, without it, ``numerics.device`` of the scene in a file.

    Parameters
    ----------
    where : name of the option.

    Raises
    ------
    UserError : there is no such word, or the solver cannot run on that device of this computer.
    """
    numerics = scene.numerics
    if option is None:
        return checked_device(numerics.device, f"{path}: numerics.device", numerics.precision)
    return checked_device(option, where, numerics.precision)
