"""Variations of a scene: what they add, which members show them, and mistakes in them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.scene import PlannedMember, Scene
from tests.support.scenes import REYNOLDS, SIMULATED, scene

SCENES = sorted((Path(__file__).resolve().parents[3] / "scenes").glob("*.toml"))


VARIED = f"""
name = "demo"
{SIMULATED}{REYNOLDS}[members]
train = 8
validation = [120.0, 180.0]
test = [150.0]
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]
opacity_points = [[0.0, 0.0], [0.3, 0.2], [0.6, 0.5], [1.0, 1.0]]
opacity_unit_distance = 0.5
[[appearance]]
kind = "isosurface"
name = "surface"
isovalue = 0.55
[[variation]]
kind = "isovalue"
of = "dvr"
train = [0.2, 0.4, 0.8]
validation = [0.3]
test = [0.5]
style = {{ color = [1.0, 0.5, 0.0] }}
[[variation]]
kind = "transfer_function"
of = "dvr"
first_step = [0.1, 0.1]
second_step = [0.1, 0.25]
validation = 2
test = 3
members = 0.5
compared = 10
"""


def settings_of(member: PlannedMember, loaded: Scene) -> dict[tuple[str, str], int]:
    """The number of settings of each kind and split that a member shows."""
    assert member.appearances is not None
    settings = {s.appearance: (v.kind, s.split) for v in loaded.variations for s in v.settings}
    return Counter(settings[name] for name in member.appearances if name in settings)


def test_variations_add_appearances(tmp_path: Path) -> None:
    loaded = scene(tmp_path, VARIED)
    isovalue, function = loaded.variations
    assert (isovalue.kind, function.kind) == ("isovalue", "transfer_function")
    assert [a.name for a in loaded.appearances] == [
        *("dvr", "surface"),
        *(s.appearance for s in isovalue.settings),
        *(s.appearance for s in function.settings),
    ]
    assert loaded.appearances[2] == Isosurface("iso=0.2", 0.2, (1.0, 0.5, 0.0))
    assert [(v.share, v.compared) for v in loaded.varied] == [(1.0, None), (0.5, 10)]
    assert loaded.variations == scene(tmp_path, VARIED).variations


def test_members_show_the_settings_of_their_split(tmp_path: Path) -> None:
    loaded = scene(tmp_path, VARIED)
    assigned = loaded.assigned(loaded.members)
    assert [(m.name, m.parameters, m.split) for m in assigned] == [
        (m.name, m.parameters, m.split) for m in loaded.members
    ]
    isovalues = {("isovalue", "train"): 3, ("isovalue", "test"): 1}
    functions = {("transfer_function", "train"): 76, ("transfer_function", "test"): 3}
    shown = [settings_of(member, loaded) for member in assigned]
    with_functions = [both for both in shown[:8] if both == isovalues | functions]
    assert len(with_functions) == 4, "half of the training members"
    assert sum(both == isovalues for both in shown[:8]) == 4
    assert shown[8:10] == [{("isovalue", "validation"): 1, ("transfer_function", "validation"): 2}] * 2
    assert shown[10] == isovalues | {("transfer_function", "train"): 10, ("transfer_function", "test"): 3}
    for member in assigned:
        assert member.appearances is not None
        assert member.appearances[:2] == ("dvr", "surface"), "what is not varied is shown by all"
        assert len(set(member.appearances)) == len(member.appearances)


def test_members_are_drawn_by_the_seed(tmp_path: Path) -> None:
    loaded = scene(tmp_path, VARIED)
    assert loaded.assigned(loaded.members) == scene(tmp_path, VARIED).assigned(loaded.members)
    seeded = [scene(tmp_path, VARIED.replace("train = 8", f"train = 8\nseed = {i}")) for i in range(5)]
    drawn = [[len(m.appearances or ()) > 40 for m in s.assigned(loaded.members)[:8]] for s in seeded]
    assert len({tuple(chosen) for chosen in drawn}) > 1


def test_compared_functions_are_spread_over_all(tmp_path: Path) -> None:
    loaded = scene(tmp_path, VARIED)
    names = loaded.variations[1].named("train")
    compared = loaded.varied[1].shown_by("test")[:10]
    places = [names.index(name) for name in compared]
    assert places == sorted(set(places))
    assert set(np.diff(places)) <= {7, 8}
    everything = replace(loaded.varied[1], compared=500)
    assert everything.shown_by("test") == replace(everything, compared=None).shown_by("test")


@pytest.mark.parametrize(
    ("share", "members", "count"), [(0.25, 10, 3), (0.07, 100, 7), (0.01, 5, 1), (1.0, 7, 7), (0.5, 0, 0)]
)
def test_a_share_is_rounded_up(tmp_path: Path, share: float, members: int, count: int) -> None:
    varied = replace(scene(tmp_path, VARIED).varied[0], share=share)
    assert len(varied.choose([f"m{i}" for i in range(members)], np.random.default_rng(0))) == count


@pytest.mark.parametrize(
    ("name", "kind", "settings", "shown"),
    [
        ("tgv-iso", "isovalue", {"train": 7, "validation": 2, "test": 3}, {"train": 10, "validation": 2, "test": 10}),
        (
            "tgv-tf",
            "transfer_function",
            {"train": 76, "validation": 8, "test": 20},
            {"train": 96, "validation": 8, "test": 40},
        ),
    ],
)
def test_the_varied_scenes_of_the_repository(
    name: str, kind: str, settings: dict[str, int], shown: dict[str, int]
) -> None:
    loaded = Scene.load(SCENES[0].parent / f"{name}.toml")
    (variation,) = loaded.variations
    assert variation.kind == kind
    assert Counter(s.split for s in variation.settings) == settings
    for member in loaded.assigned(loaded.members):
        assert member.appearances is not None
        assert len(member.appearances) in {1, 1 + shown[member.split]}
    varied = [m for m in loaded.assigned(loaded.members) if len(m.appearances or ()) > 1]
    training = [m for m in varied if m.split == "train"]
    assert len(training) == (10 if kind == "isovalue" else 3)
    assert len(varied) - len(training) == 6
    plan = CatalogPlan(loaded.space, loaded.appearances, (), (), ((0, 0, 0), (1, 1, 1)), variations=loaded.variations)
    assert len(plan.plain_appearances) == 1


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('of = "dvr"', 'of = "drv"', "variation.of must name a volume rendering among the appearances, got 'drv'"),
        ('of = "dvr"', 'of = "surface"', "got 'surface'"),
        ('of = "dvr"', "", "got None"),
        ('kind = "isovalue"', 'kind = "isovalues"', "got 'isovalues'"),
        (
            "test = [0.5]",
            "test = [0.9]",
            "variation of dvr: every isovalue must lie within the trained ones, 0.2 to 0.8",
        ),
        (
            "test = [0.5]",
            "tests = [0.5]",
            "variation of dvr: isovalue_family() got an unexpected keyword argument 'tests'",
        ),
        ("train = [0.2, 0.4, 0.8]", "train = 3", "variation of dvr: 'int' object is not iterable"),
        ("train = [0.2, 0.4, 0.8]", "", "missing 1 required keyword-only argument: 'train'"),
        ("style = { color", "style = { colour", "'colour'"),
        ("first_step = [0.1, 0.1]", "first_step = [0.4, 0.1]", "take smaller steps"),
        ("first_step = [0.1, 0.1]", "", "'first_step'"),
        ("[0.3, 0.2], [0.6, 0.5]", "[0.6, 0.5]", "dvr: a transfer function to be varied has four opacity points"),
        (
            "members = 0.5",
            "members = 0.0",
            "variation.members, the share of training members, must lie in (0, 1], got 0.0",
        ),
        ("members = 0.5", "members = 4", "got 4"),
        ("members = 0.5", 'members = "half"', "got 'half'"),
        ("compared = 10", "compared = 0", "variation.compared must be a count, at least 1, got 0"),
        ("compared = 10", "compared = 2.5", "got 2.5"),
        ("validation = 2", "validation = -2", "got -2 and 3"),
        ('name = "surface"', 'name = "iso=0.2"', "unique"),
        ('name = "surface"', 'name = "dvr-train-07"', "unique"),
    ],
)
def test_a_mistake_in_a_variation_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert old in VARIED
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        scene(tmp_path, VARIED.replace(old, new, 1))
    assert named in str(caught.value)


def test_a_single_variation_table_is_told_from_a_list_of_them(tmp_path: Path) -> None:
    text = VARIED[: VARIED.index('[[variation]]\nkind = "transfer')].replace("[[variation]]", "[variation]")
    with pytest.raises(ValueError, match=r"double brackets, \[\[variation\]\]"):
        scene(tmp_path, text)


FIELDS = (
    VARIED.replace('name = "dvr"', 'name = "dvr"\nfield = "q"').replace(
        'name = "surface"', 'name = "surface"\nfield = "speed"'
    )
    + """
[[variation]]
kind = "field"
of = "dvr"
appearances = ["surface"]
"""
)


def test_every_member_shows_every_field(tmp_path: Path) -> None:
    loaded, plain = scene(tmp_path, FIELDS), scene(tmp_path, VARIED)
    assert [v.kind for v in loaded.variations] == ["isovalue", "transfer_function", "field"]
    assert {a.field for a in loaded.appearances if a.name not in ("dvr", "surface")} == {"q"}, (
        "settings are of the base's field"
    )
    assert loaded.assigned(loaded.members) == plain.assigned(plain.members), "the others are drawn as ever"
    assert all("surface" in (m.appearances or ()) for m in loaded.assigned(loaded.members))
    CatalogPlan(loaded.space, loaded.appearances, (), (), ((0, 0, 0), (1, 1, 1)), variations=loaded.variations)


def test_surfaces_may_be_of_another_field_than_the_volume_beside_them(tmp_path: Path) -> None:
    loaded = scene(tmp_path, FIELDS.replace("style = { color", 'style = { field = "speed", color'))
    assert {a.field for a in loaded.appearances if a.name.startswith("iso=")} == {"speed"}


def test_the_scene_of_two_fields() -> None:
    loaded = Scene.load(SCENES[0].parent / "tiny-fields.toml")
    assert loaded.source["fields"] == ["q_criterion", "speed"]
    assert [(a.name, a.field) for a in loaded.appearances] == [("dvr", "q_criterion"), ("speed-dvr", "speed")]
    (variation,) = loaded.variations
    assert (variation.kind, variation.base, variation.named("train")) == ("field", "dvr", ("speed-dvr",))
    assert {m.appearances for m in loaded.assigned(loaded.members)} == {("dvr", "speed-dvr")}


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('field = "speed"', "", "surface do not"),
        ('field = "speed"', "field = 3", "appearance 'surface': field must be a printable name"),
        ('appearances = ["surface"]', 'appearances = ["surfaces"]', "dvr, surface, each an [[appearance]] table"),
        ('appearances = ["surface"]', 'appearances = ["iso=0.2"]', "got iso=0.2"),
        ('appearances = ["surface"]', 'appearances = ["dvr"]', "beside the base dvr"),
        ('appearances = ["surface"]', "", "appearances must name some beside the base dvr"),
        ('appearances = ["surface"]', 'appearances = ["surface"]\nmembers = 0.5', "leave out members and compared"),
        ('appearances = ["surface"]', 'appearances = ["surface"]\ntrain = [1]', "'train'"),
    ],
)
def test_a_mistake_in_a_field_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert old in FIELDS
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        scene(tmp_path, FIELDS.replace(old, new, 1))
    assert named in str(caught.value)
