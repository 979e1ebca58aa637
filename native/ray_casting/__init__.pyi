from native.ray_casting.cuts import Cut as Cut
from native.ray_casting.distances import fitting_distance as fitting_distance
from native.ray_casting.fields import SampledField as SampledField
from native.ray_casting.isosurface import SurfaceCaster as SurfaceCaster
from native.ray_casting.isosurface import draw_isosurface as draw_isosurface
from native.ray_casting.volume import VolumeCaster as VolumeCaster
from native.ray_casting.volume import draw_volume as draw_volume
