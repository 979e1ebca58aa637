import json
import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import displaced
from surrogate import Surrogate
from surrogate.splatting import render
from tests.support.comparing import same
from tests.support.field_blobs import FUNCTION, FUNCTIONS, ISOVALUE
from tests.support.surrogates import CENTER, EXTENT, some_surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

CAMERA = Camera.look_at(CENTER + np.array([90.0, 120.0, 60.0]), CENTER, vertical_fov_degrees=35, width=24, height=20)


def test_what_is_drawn_is_what_the_world_units_say() -> None:
    deformed = some_surrogate().at(Re=2500.0, time=2.0)
    shifted = np.eye(4)
    shifted[:3, :3] = CAMERA.rotation
    shifted[:3, 3] = CAMERA.rotation @ CENTER + CAMERA.world_to_camera[:3, 3]
    near = Camera(shifted, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.width, CAMERA.height)
    drawn = render(
        torch.from_numpy(deformed.means - CENTER).float(),
        torch.from_numpy(deformed.scales).float(),
        deformed.gaussians.quats,
        torch.from_numpy(deformed.opacities),
        deformed.gaussians.colors,
        near,
        near=deformed.rasterizer.constants.near * EXTENT,
        dilation=deformed.rasterizer.constants.dilation,
        alpha_floor=deformed.rasterizer.constants.alpha_floor,
        backend="reference",
    )
    picture = deformed.render(CAMERA)
    assert picture.shape == (20, 24, 4)
    assert picture.dtype == np.float32
    np.testing.assert_allclose(picture[..., 3], drawn.alpha.numpy(), atol=2e-4)
    np.testing.assert_allclose(picture[..., :3], drawn.color.numpy().clip(0, 1), atol=2e-4)


def test_a_background_makes_it_opaque() -> None:
    deformed = some_surrogate().at(Re=1500.0, time=1.0)
    clear, opaque = deformed.render(CAMERA), deformed.render(CAMERA, background=(0.0, 0.5, 1.0))
    assert (opaque[..., 3] == 1.0).all()
    np.testing.assert_allclose(opaque[..., :3], clear[..., :3] + (1 - clear[..., 3:]) * [0.0, 0.5, 1.0], atol=1e-6)


def test_parameters_move_the_gaussians() -> None:
    surrogate = some_surrogate()
    low, high = surrogate.at(Re=1500.0, time=0.0), surrogate.at(Re=2500.0, time=0.0)
    assert np.abs(low.means - high.means).max() > 1e-3 * EXTENT
    np.testing.assert_array_equal(surrogate.at(time=0.0, Re=1500.0).means, low.means)


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"Re": 1600.0}, r"missing time"),
        ({"Re": 1600.0, "time": 1.0, "Ma": 0.1}, r"unknown Ma"),
        ({"re": 1600.0, "time": 1.0}, r"missing Re, unknown re"),
        ({"Re": math.nan, "time": 1.0}, "Re must be finite"),
    ],
)
def test_wrong_parameters_are_named(parameters: dict[str, float], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        some_surrogate().at(**parameters)


def test_extrapolation_warns() -> None:
    with pytest.warns(UserWarning, match=r"Re = 2600 lies outside its bounds \[1500, 2500\]") as caught:
        some_surrogate().at(Re=2600.0, time=1.0)
    assert caught[0].filename == __file__


def test_printing_shows_what_it_is() -> None:
    surrogate = some_surrogate()
    assert repr(surrogate) == ("<Surrogate of Re 1500..2500, time 0..2 s: 30 Gaussians, bilinear deformation, 0.0 MB>")
    assert repr(surrogate.at(Re=1830.0, time=1.0)) == "<DeformedGaussians at Re=1830, time=1: 30 Gaussians>"


def varied() -> Surrogate:
    """It follows p, an isovalue and transfer functions, which are applied."""
    fitted = base()
    return surrogate(fitted, of_isovalue(fitted, 1), of_functions(fitted))


def test_visualization_parameters_are_those_of_its_variations() -> None:
    model = varied()
    assert model.visualization_names == ("isovalue", "c1_value", "c1_opacity", "c2_value", "c2_opacity")
    assert some_surrogate().visualization_names == ()
    functions, isovalue = model.visualizations[1], model.visualizations[0]
    place = torch.tensor([2.0 * 0.3 - 1.0, *FUNCTIONS.normalize([0.1, 0.0, 0.0, -0.2])], dtype=torch.float32)
    expected = functions.gaussians_at(model.gaussians, model.deformation, place)
    assert same(model.at(p=0.3, c2_opacity=-0.2, c1_value=0.1).gaussians, expected)  # those left out are zero
    place = torch.tensor([2.0 * 0.3 - 1.0, *ISOVALUE.normalize([0.4])], dtype=torch.float32)
    expected = isovalue.gaussians_at(model.gaussians, model.deformation, place)
    assert same(model.at(isovalue=0.4, p=0.3).gaussians, expected)


@pytest.mark.parametrize("name", ["self", "outside", "lambda", "appearance", "transfer_function", "values"])
def test_parameters_of_any_name_are_set_in_a_mapping(name: str) -> None:
    plain = some_surrogate()
    space = ParameterSpace((replace(plain.space.parameters[0], name=name), plain.space.parameters[1]))
    named = replace(plain, space=space)
    assert same(named.at({name: 1600.0}, time=1.0).gaussians, plain.at(Re=1600.0, time=1.0).gaussians)
    if name != "outside":
        assert same(named.at(**{name: 1600.0, "time": 1.0}).gaussians, plain.at(Re=1600.0, time=1.0).gaussians)


def test_without_visualization_parameters_it_looks_as_the_base() -> None:
    model = varied()
    plain = replace(model, visualizations=())
    assert same(model.at(p=0.3).gaussians, plain.at(p=0.3).gaussians)
    assert dict(model.at(p=0.3).parameters) == {"p": 0.3}
    shown = model.at(p=0.3, c1_value=0.1).parameters
    assert dict(shown) == {"p": 0.3, "c1_value": 0.1, "c1_opacity": 0.0, "c2_value": 0.0, "c2_opacity": 0.0}
    assert repr(model.at(p=0.3, isovalue=0.4)).startswith("<DeformedGaussians at p=0.3, isovalue=0.4: ")


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"p": 0.3, "isovalue": 0.3, "c1_value": 0.1}, r"c1_value, isovalue belong to different variations"),
        ({"isovalue": 0.3}, r"missing p"),
        ({"p": 0.3, "isovalu": 0.3}, r"unknown isovalu"),
        ({"p": 0.3, "isovalue": math.nan}, "isovalue must be finite"),
        ({"p": 0.3, "c1_opacity": math.inf}, "c1_opacity must be finite"),
    ],
)
def test_wrong_visualization_parameters_are_named(parameters: dict[str, float], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        varied().at(**parameters)


@pytest.mark.parametrize("more", [{"isovalue": 0.9}, {"c2_value": 0.5}], ids=str)
def test_visualization_parameters_out_of_bounds_warn(more: dict[str, float]) -> None:
    with pytest.warns(UserWarning, match="lies outside its bounds") as caught:
        shown = varied().at(p=0.3, **more)
    assert np.isfinite(shown.means).all()
    assert [w.filename for w in caught] == [__file__]


def test_what_is_allowed_outside_brings_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        varied().at(p=1.5, isovalue=0.9, outside="allow")
        varied().under(FUNCTION, p=1.5, outside="allow")


def test_any_transfer_function_may_be_given() -> None:
    model = varied()
    moved = displaced(FUNCTION, [0.1, -0.1, 0.2, 0.3])
    named = model.at(p=0.3, c1_value=0.1, c1_opacity=-0.1, c2_value=0.2, c2_opacity=0.3)
    given = model.under(moved, p=0.3)
    np.testing.assert_allclose(given.opacities, named.opacities, atol=1e-6)
    palette, own = moved.colors(np.linspace(0.0, 3.0, 301)), model.at(p=0.3).gaussians.colors.numpy()
    low, high = np.minimum(own, palette.min(axis=0)), np.maximum(own, palette.max(axis=0))
    np.testing.assert_allclose(
        given.gaussians.colors.numpy(), named.gaussians.colors.numpy().clip(low, high), atol=1e-4
    )
    assert same(model.under(FUNCTION, p=0.3).gaussians, model.at(p=0.3).gaussians)
    swapped = replace(FUNCTION, color_points=tuple((v, b, g, r) for v, r, g, b in FUNCTION.color_points))
    assert not np.allclose(model.under(swapped, p=0.3).gaussians.colors, model.at(p=0.3).gaussians.colors)
    with pytest.raises(ValueError, match=r"missing p"):
        model.under(moved)


def test_what_has_learnt_no_transfer_functions_says_so() -> None:
    fitted = base()
    for model in (surrogate(fitted), surrogate(fitted, of_isovalue(fitted))):
        with pytest.raises(ValueError, match="know no transfer functions"):
            model.under(FUNCTION, p=0.3)


def test_printing_says_what_it_follows() -> None:
    assert "bilinear deformation, any isovalue and transfer function, " in repr(varied())


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda record: record["visualizations"].pop(), "tensor 'visualization1[^ ]*: it must belong"),
        (
            lambda record: record["visualizations"][0]["deformation"].update(kind="warp"),
            "visualization 0: unknown deformation 'warp'",
        ),
        (lambda record: record["visualizations"][1]["variation"].pop("base"), "visualization 1: 'base' is missing"),
        (lambda record: record["visualizations"][1]["deformation"].update(values=[0, 1]), "2 increasing values"),
    ],
)
def test_damaged_visualizations_are_named(tmp_path: Path, damage: object, complaint: str) -> None:
    varied().save(tmp_path)
    record = json.loads((tmp_path / "model.json").read_text())
    damage(record)  # type: ignore[operator]
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=complaint):
        Surrogate.load(tmp_path)


def test_it_all_moves_to_another_device() -> None:
    moved = varied().to("cpu")
    assert same(moved.at(p=0.2, isovalue=0.3).gaussians, varied().at(p=0.2, isovalue=0.3).gaussians)
    assert moved.visualization_names == varied().visualization_names


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        (
            {"Re": 1e9, "time": 1.0},
            r"Re = 1e\+09 lies too far outside its bounds \[1500, 2500\]: it can be drawn from 500 to 3500",
        ),
        ({"Re": -1e300, "time": 1.0}, r"Re = -1e\+300 lies too far outside"),
        (
            {"Re": 1600.0, "time": 30.0},
            r"time = 30 lies too far outside its bounds \[0, 2\]: it can be drawn from -2 to 4",
        ),
    ],
)
@pytest.mark.parametrize("outside", ["warn", "allow"])
def test_absurd_parameters_are_refused_at_once(parameters: dict[str, float], complaint: str, outside: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        some_surrogate().at(**parameters, outside=outside)


@pytest.mark.parametrize("values", [3.0, "Re=3", [1600.0, 1.0]])
def test_parameters_without_names_are_refused(values: object) -> None:
    with pytest.raises(ValueError, match="parameters are values by name, for Re, time, got"):
        some_surrogate().at(values)  # type: ignore[arg-type]


def test_absurd_isovalues_are_refused_at_once() -> None:
    with pytest.raises(ValueError, match=r"isovalue = -1e\+06 lies too far outside"):
        varied().at(p=0.3, isovalue=-1e6)


def test_what_extrapolates_to_no_numbers_is_refused() -> None:
    model = some_surrogate()
    wild = replace(model.deformation, weights_out=1e4 * model.deformation.tensors()["weights_out"])  # type: ignore[type-var]
    with pytest.raises(ValueError, match=r"not finite at Re=3400, time=1: choose values nearer"):
        replace(model, deformation=wild).at(Re=3400.0, time=1.0, outside="allow")


@pytest.mark.parametrize(
    "background",
    [(1.0, 0.5), 1.0, "red", (0.0, math.nan, 0.0), (0.0, 0.5, 1.5), (-0.1, 0, 0), np.zeros((3, 1)), np.zeros(4)],
    ids=str,
)
def test_backgrounds_that_are_no_colours_are_named(background: object) -> None:
    deformed = some_surrogate().at(Re=1500.0, time=1.0)
    with pytest.raises(ValueError, match=r"background, \(red, green, blue\) each in \[0, 1\], must"):
        deformed.render(CAMERA, background=background)  # type: ignore[arg-type]


def test_backgrounds_may_be_arrays_and_tensors() -> None:
    deformed = some_surrogate().at(Re=1500.0, time=1.0)
    expected = deformed.render(CAMERA, background=(0.0, 0.5, 1.0))
    for form in (np.array([0.0, 0.5, 1.0]), torch.tensor([0.0, 0.5, 1.0]), [0, 0.5, 1]):
        np.testing.assert_array_equal(deformed.render(CAMERA, background=form), expected)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_a_gpu_that_is_not_there_is_told_in_one_sentence() -> None:
    with pytest.raises(RuntimeError, match=r'the device "cuda" can\'t be used: '):
        some_surrogate().to("cuda")


@pytest.mark.parametrize("device", ["meta", "gpu", "mps", "", None, 3.5], ids=str)
def test_devices_that_can_not_draw_are_named(device: object) -> None:
    with pytest.raises(ValueError, match=r'device must be "cpu" or "cuda"'):
        some_surrogate().to(device)  # type: ignore[arg-type]
