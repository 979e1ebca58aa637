from catalogs.store.catalog import Catalog as Catalog
from catalogs.store.plan import CatalogError as CatalogError
from catalogs.vocabulary.appearance import Isosurface as Isosurface
from catalogs.vocabulary.appearance import TransferFunction as TransferFunction
from catalogs.vocabulary.appearance import VolumeRendering as VolumeRendering
from catalogs.vocabulary.parameters import Parameter as Parameter
from catalogs.vocabulary.parameters import ParameterSpace as ParameterSpace
from catalogs.vocabulary.quantity import Quantity as Quantity
from catalogs.vocabulary.scene import ViewPlan as ViewPlan
from catalogs.vocabulary.variations import field_variation as field_variation
from catalogs.vocabulary.variations import isovalue_family as isovalue_family
from catalogs.vocabulary.variations import transfer_function_family as transfer_function_family
from insitu.ensembles.dataset import make_dataset as make_dataset
from insitu.ensembles.ensemble import EnsembleResult as EnsembleResult
from insitu.ensembles.ensemble import run_ensemble as run_ensemble
from insitu.ensembles.probe import probe_fields as probe_fields
from insitu.fields.field import Field as Field
from insitu.hook.member import render_member as render_member
from insitu.hook.session import Session as Session
from insitu.members.result import RenderedMember as RenderedMember

__version__: str
