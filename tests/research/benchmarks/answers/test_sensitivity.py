"""Maps of sensitivity against those of the Taylor-Green vortex itself, which runs anew for them."""

from __future__ import annotations

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.simulations.taylor_green_fields import dumps
from research.benchmarks.answers.sensitivity import simulated_maps, stored_first
from surrogate.answers.sensitivity import correlations, sensitivity
from surrogate.answers.sobol import Distribution, picture_response, sobol_indices
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.training.run import train

RESOLUTION, SOLVER = 24, 32
SPACE = ParameterSpace((Parameter("Re", 50.0, 200.0), Parameter("time", 2.0, 4.0)))
FUNCTION = TransferFunction(
    ((-0.5, 0.1, 0.3, 0.8), (0.5, 0.9, 0.4, 0.1)), ((-0.5, 0.4), (-0.05, 0.0), (0.05, 0.0), (0.5, 0.6)), 1.0
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Five runs with four or five dumps each."""
    path = tmp_path_factory.mktemp("run") / "catalog.cdb"
    views = ViewPlan(frequency=1, width=48, height=48)
    with insitu.Session(path, space=SPACE, appearances=[VolumeRendering("dvr", FUNCTION)], views=views) as session:
        for number, reynolds in enumerate(np.linspace(50.0, 200.0, 5)):
            times = np.linspace(2.0, 4.0, 5) if number % 2 else np.linspace(2.25, 3.75, 4)
            made = dumps(
                {"Re": float(reynolds)},
                fields=["q_criterion"],
                resolution=RESOLUTION,
                times=times.tolist(),
                solver_resolution=SOLVER,
            )
            for time, dump in zip(times, made, strict=True):
                field = dump["q_criterion"]
                at = {"Re": float(reynolds), "time": float(time)}
                session.render_member(field.values, at, spacing=field.spacing, origin=field.origin, split="train")
    return Catalog.open(path)


@pytest.fixture(scope="module")
def surrogate(catalog: Catalog) -> Surrogate:
    folder = catalog.path.parent / "surrogate"
    train(TrainingSettings(fit_to_need=False), catalog, folder, only_field=True)
    return Surrogate.load(folder)


@pytest.mark.slow
@pytest.mark.parametrize("place", [{"Re": 90.0, "time": 3.1}, {"Re": 160.0, "time": 2.6}], ids=str)
def test_maps_are_those_of_the_simulation(catalog: Catalog, surrogate: Surrogate, place: dict[str, float]) -> None:
    camera = catalog.plan.cameras[2]
    (truth,) = simulated_maps(catalog, SPACE, [(place, camera)], RESOLUTION, SOLVER)
    answer = sensitivity(surrogate, place, camera)
    assert correlations(answer.maps, truth).min() > 0.9
    assert np.allclose(answer.of_view, np.abs(truth).mean((1, 2, 3)), rtol=0.15)


@pytest.mark.slow
def test_stored_pictures_have_the_surrogates_first_indices(catalog: Catalog, surrogate: Surrogate) -> None:
    response = picture_response(surrogate, catalog.plan.cameras[2])
    answer = sobol_indices(SPACE, response, Distribution.of_members(SPACE, catalog), samples=128)
    assert np.abs(answer.first - stored_first(catalog, SPACE, 2, None)).max() < 0.2
