import pytest
from hypothesis import given
from hypothesis import strategies as st

from surrogate.settings import TrainingSettings


def test_an_empty_table_means_the_defaults() -> None:
    assert TrainingSettings.from_table({}) == TrainingSettings()


def test_settings_survive_json() -> None:
    settings = TrainingSettings(gaussians=77, initialization="random", mean_rate=0.25)
    assert TrainingSettings.from_table(settings.to_json()) == settings


def test_a_whole_number_will_do_for_a_float() -> None:
    assert TrainingSettings.from_table({"dilation": 1}).dilation == 1.0


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"gausians": 10}, r"unknown keys \['gausians'\]; known are"),
        ({"gaussians": 10.5}, "training.gaussians must be of type int, got 10.5"),
        ({"gaussians": "many"}, "training.gaussians must be of type int"),
        ({"gaussians": True}, "training.gaussians must be of type int, got True"),
        ({"gaussians": 0}, "training.gaussians must be at least 1, got 0"),
        ({"seed": -1}, "training.seed must be at least 0"),
        ({"mean_rate": float("nan")}, "training.mean_rate must be finite"),
        ({"mean_rate": 0.0}, "training.mean_rate must be positive"),
        ({"ssim_weight": 1.5}, r"training.ssim_weight must be in \[0, 1\], got 1.5"),
        ({"dead_opacity": 1.0}, "training.dead_opacity must be between 0 and 1"),
        ({"color_degree": 2}, r"training.color_degree must be one of \['auto', 0, 1\], got 2"),
        ({"initialization": 3}, r"training.initialization must be one of \['auto', 'in-situ', 'random'\], got 3"),
        ({"checkpoint_seconds": 0}, "training.checkpoint_seconds must be positive"),
    ],
)
def test_bad_tables_are_named(table: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        TrainingSettings.from_table(table)


@given(st.dictionaries(st.text(max_size=8), st.one_of(st.none(), st.lists(st.integers(), max_size=2)), min_size=1))
def test_nonsense_never_passes(table: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="training"):
        TrainingSettings.from_table(table)
