from catalogs.store.catalog import Catalog as Catalog
from catalogs.store.members import Member as Member
from catalogs.store.plan import CatalogError as CatalogError
from catalogs.store.plan import CatalogPlan as CatalogPlan
from catalogs.store.summary import FieldSummary as FieldSummary
from catalogs.vocabulary.appearance import ImportedImages as ImportedImages
from catalogs.vocabulary.appearance import Isosurface as Isosurface
from catalogs.vocabulary.appearance import TransferFunction as TransferFunction
from catalogs.vocabulary.appearance import VolumeRendering as VolumeRendering
from catalogs.vocabulary.cameras import Camera as Camera
from catalogs.vocabulary.cameras import icosphere as icosphere
from catalogs.vocabulary.cameras import orbit as orbit
from catalogs.vocabulary.parameters import Parameter as Parameter
from catalogs.vocabulary.parameters import ParameterSpace as ParameterSpace
from catalogs.vocabulary.scene import Scene as Scene

__version__: str
