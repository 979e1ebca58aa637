"""Reasons for which a training could not end well, found before it begins: empty images, far members, little memory or disk."""

from __future__ import annotations

import shutil
from pathlib import Path

from surrogate.model.places import beyond_limits
from surrogate.settings import TrainingSettings
from surrogate.training.content import require_content
from surrogate.training.data import MEMORY, training_rows
from surrogate.training.source import Source

NUMBERS = 23  # of a Gaussian, with colours by direction, beside its latents
IN_MEMORY = 7  # of each number: itself, its gradient, two moments, and a step's deformed copies
ON_DISK = 6  # of each number: itself and two moments, in the old checkpoint and in the new one


def require_possible(source: Source, folder: Path) -> None:
    """Raise ValueError where a training in `folder` can't be done, with what helps."""
    _require_near(source)
    _require_memory(source)
    _require_disk(source.settings, folder)
    require_content(source)


def _require_near(source: Source) -> None:
    space = source.catalog.plan.space
    for member in source.catalog.members:
        for parameter in space.parameters:
            if sentence := beyond_limits(parameter, member.parameters[parameter.name]):
                raise ValueError(
                    f"member {member.name}: {sentence}: render the ensemble anew, with bounds that hold all members"
                )


def _require_memory(source: Source) -> None:
    """Check for the images of the base appearance and of one variation, and for all Gaussians."""
    import psutil

    variations = [[s.appearance for s in variation.settings] for variation in source.variations]
    base, *varied = (_image_bytes(source, names) for names in ([source.appearance], *variations))
    images, gaussians = base + max(varied, default=0), _gaussian_bytes(source.settings) * IN_MEMORY
    free = psutil.virtual_memory().available + psutil.swap_memory().free
    if images + gaussians > free:
        raise ValueError(
            f"training needs {_gigabytes(images + gaussians)} of memory, and {_gigabytes(free)} are free: the images take "
            f"{_gigabytes(images)}, {source.settings.gaussians:,} Gaussians {_gigabytes(gaussians)}; take fewer Gaussians "
            "(gaussians=N), or smaller or fewer images"
        )


def _require_disk(settings: TrainingSettings, folder: Path) -> None:
    there = next(place for place in (folder, *folder.absolute().parents) if place.is_dir())
    needed, free = _gaussian_bytes(settings) * ON_DISK, shutil.disk_usage(there).free
    if needed > free:
        raise ValueError(
            f"the checkpoints of {settings.gaussians:,} Gaussians need {_gigabytes(needed)}, and the disk of {folder} has "
            f"{_gigabytes(free)} left: make room, take fewer Gaussians (gaussians=N), or another folder (-o)"
        )


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:,.3g} GB"


def _image_bytes(source: Source, appearances: list[str]) -> int:
    """Of the training images of some appearances that are decoded and kept; others are read when used."""
    channels = 4 if source.catalog.plan.background is None else 3
    cameras = (row.member.cameras[row.view] for row in training_rows(source.catalog, appearances))
    return min(MEMORY, sum(camera.width * camera.height for camera in cameras) * channels)


def _gaussian_bytes(settings: TrainingSettings) -> int:
    """Of one copy of all Gaussians' numbers."""
    return 4 * (NUMBERS + settings.latent_size) * max(settings.gaussians, settings.count_on_surfaces)
