from render.datasets import to_grid as to_grid
from render.grids import Grid as Grid
from render.quality import SampleDistance as SampleDistance
from render.quality import choose_sample_distance as choose_sample_distance
from render.views import render_views as render_views

__version__: str
