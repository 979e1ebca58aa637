"""Agreement and truth of predictions of members that were not learnt from: what doubt is calibrated with.

The emulator is judged by its own members, each predicted by one that learnt without it, and the Gaussians by validation members.
Test members and test views are never looked at.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import ImageError
from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.calibration import Unseen
from surrogate.answers.committee import Committee, left_out
from surrogate.evaluation.metrics import WHITE, composite, decibels, psnr
from surrogate.evaluation.scoring import Report, spread
from surrogate.model import Surrogate
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.field_model import FieldModel
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS, VIEW

VIEWS = 4  # of a member


@dataclass(frozen=True)
class Shown:
    """A member in one appearance, which shows a kind of question, with the visualization parameters that ask for it."""

    member: Member
    kind: str
    appearance: str
    varied: Mapping[str, float | str]

    @property
    def parameters(self) -> dict[str, float | str]:
        """All that `Surrogate.at` takes for it."""
        return {**self.member.parameters, **self.varied}

    @property
    def views(self) -> list[int]:
        """Some of the member's that are not for testing."""
        numbers = untested_views(self.member)
        return [numbers[i] for i in spread(len(numbers), VIEWS)]


@dataclass(frozen=True)
class UnseenPicture:
    """Agreement of predictions of a member's picture with each other and with the truth, dB.

    Attributes
    ----------
    using : the representation whose picture is meant.
    point : (P,) normalized parameters.
    open_share : of the variance that runs left open there; 0 for Gaussians.
    """

    member: str
    kind: str
    using: str
    agreement: float
    truth: float
    point: tuple[float, ...]
    open_share: float = 0.0


def untested_views(member: Member) -> list[int]:
    """The numbers of a member's views that are not for testing."""
    return [view for view, split in enumerate(member.view_splits) if split != "test"]


def cases_of(model: FieldModel, members: Sequence[Member]) -> Iterator[Shown]:
    """Each member in the base appearance, and in one that was trained of each kind of variation."""
    base = model.appearances[0].name
    for member in members:
        if base in member.appearances:
            yield Shown(member, VIEW, base, {})
        for variation in model.variations:
            settings = [
                s
                for s in variation.settings
                if s.split != "test" and s.appearance in member.appearances and s.appearance != base
            ]
            if settings:
                setting = settings[zlib.crc32(member.name.encode()) % len(settings)]
                yield Shown(member, variation.kind, setting.appearance, variation.arguments(setting))


def of_emulator(model: FieldModel, catalog: Catalog, progress: Report) -> Iterator[UnseenPicture]:
    """Of pictures of the emulated field, by emulators that left their members out."""
    background = catalog.plan.background
    learnt = [member for member in catalog.members if member.split in model.splits]
    names = {field_of(appearance) for appearance in model.appearances}
    for name, emulator in model.emulators.items():
        if name not in names:
            continue
        coarse = [(member, own[name]) for member in learnt if name in (own := member.coarse_fields())]
        having = [member for member, _ in coarse]
        if len(having) != len(emulator.processes.points):
            raise ValueError(f"{catalog.path} has other members than the emulator of its run learnt from")
        points = model.space.normalize(np.array([[m.parameters[p] for p in model.space.names] for m in having]))
        fields = np.stack([one.values for _, one in coarse])
        done = 0
        for other, numbers in left_out(emulator, points, fields):
            committee = Committee.of(other)
            for case in cases_of(model, [having[i] for i in numbers]):
                point = model.point(case.parameters, "allow")
                if field_of(point.appearance) != name:
                    continue
                prediction = EmulatedMember(
                    other, point.simulation, point.appearance, {}, model.normalization, point.sample_distance
                )
                opinions, share = committee.at(point), committee.open_share(point.simulation)
                for truth, camera in _true_pictures(catalog, case):
                    picture = composite(prediction.render(camera), background or WHITE)
                    agreement = decibels(float(opinions.squares(camera, background).mean()))
                    yield UnseenPicture(
                        case.member.name,
                        case.kind,
                        FIELD,
                        agreement,
                        psnr(truth, picture),
                        tuple(point.simulation),
                        share,
                    )
            done += len(numbers)
            progress("how sure the emulator is", done, len(having))


def of_gaussians(surrogate: Surrogate, catalog: Catalog) -> Iterator[UnseenPicture]:
    """Of pictures by Gaussians, alone and as the mean image, of validation members; `surrogate` has not learnt from these."""
    assert surrogate.field is not None
    unseen = [m for m in catalog.members if m.split == "validation"]
    for case in cases_of(surrogate.field, unseen):
        by = {name: surrogate.using(name).at(case.parameters, outside="allow") for name in (GAUSSIANS, FIELD)}
        point = tuple(surrogate.field.point(case.parameters, "allow").simulation)
        for truth, camera in _true_pictures(catalog, case):
            first, second = (composite(m.render(camera), catalog.plan.background or WHITE) for m in by.values())
            agreement = psnr(first, second)
            for using, picture in ((GAUSSIANS, first), (BOTH, 0.5 * (first + second))):
                yield UnseenPicture(case.member.name, case.kind, using, agreement, psnr(truth, picture), point)


def by_member(pictures: Sequence[UnseenPicture]) -> Unseen:
    """Those of the members that have as many pictures as most."""
    groups: dict[str, list[UnseenPicture]] = {}
    for picture in pictures:
        groups.setdefault(picture.member, []).append(picture)
    most = max(map(len, groups.values()))
    whole = [group for group in groups.values() if len(group) == most]
    rows = np.array([[(one.agreement, one.truth) for one in group] for group in whole])  # [M, V, 2]
    return Unseen(np.array([group[0].point for group in whole], dtype=np.float64), rows[..., 0], rows[..., 1])


def _true_pictures(catalog: Catalog, case: Shown) -> Iterator[tuple[NDArray[np.float32], Camera]]:
    """The stored pictures, as displayed, with their cameras; those that can't be read are left out."""
    for view in case.views:
        with suppress(ImageError):
            image = catalog.image(case.member, case.appearance, view)
            yield composite(image, catalog.plan.background or WHITE), case.member.cameras[view]
