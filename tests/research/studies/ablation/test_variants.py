import pytest

from research.studies.ablation.variants import DEFAULT, VARIANTS, selected
from surrogate.settings import TrainingSettings

SCENE = TrainingSettings(gaussians=1001, canonical_steps=30, deformation_steps=70)


def variant(name: str):
    return next(v for v in VARIANTS if v.name == name)


def test_the_default_is_the_scene_and_every_other_variant_changes_it() -> None:
    assert VARIANTS[0].name == DEFAULT
    assert VARIANTS[0].settings(SCENE) == SCENE
    for other in VARIANTS[1:]:
        assert other.settings(SCENE) != SCENE or other.steps_of, other.name
        assert other.why
        assert other.what != "nothing"


def test_names_are_unique_and_make_file_names() -> None:
    names = [v.name for v in VARIANTS]
    assert len(set(names)) == len(names)
    assert all(c.isalnum() or c in ".-" for name in names for c in name)


def test_steps_are_taken_of_variants_that_stand_before() -> None:
    for place, one in enumerate(VARIANTS):
        assert not one.steps_of or one.steps_of in [v.name for v in VARIANTS[:place]]


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("gaussians-x0.5", {"gaussians": 500}),
        ("joint", {"canonical_steps": 0, "deformation_steps": 100}),
        ("start-in-situ", {"initialization": "in-situ"}),
        ("samples-2-in-default-steps", {"samples": 2}),
        ("pictures-alone", {"field_value_weight": 0.0}),
    ],
)
def test_a_variant_changes_what_its_name_says_and_nothing_else(name: str, changed: dict) -> None:
    assert variant(name).settings(SCENE) == SCENE.changed(**changed)


def test_a_selection_holds_what_it_is_compared_with() -> None:
    assert [v.name for v in selected([], VARIANTS)] == [v.name for v in VARIANTS]
    assert [v.name for v in selected(["joint"], VARIANTS)] == [DEFAULT, "joint"]
    assert [v.name for v in selected(["default-in-samples-2-steps"], VARIANTS)] == [
        DEFAULT,
        "samples-2",
        "default-in-samples-2-steps",
    ]
    with pytest.raises(ValueError, match=r"unknown variants \['nonsense'\]; known are \['default', 'no-relocation'"):
        selected(["nonsense"], VARIANTS)
