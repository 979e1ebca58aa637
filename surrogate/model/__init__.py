"""A trained surrogate: Gaussians and their deformation, ready to be looked at from anywhere at any parameters."""

from surrogate.model.deformed import DeformedGaussians
from surrogate.model.differentiable import DifferentiableSurrogate
from surrogate.model.differentiable_field import DifferentiableChoice, DifferentiableField
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.field_model import FieldModel
from surrogate.model.mean_member import MeanMember, MemberModel
from surrogate.model.rigid import look_at
from surrogate.model.surrogate import Surrogate

__all__ = [
    "DeformedGaussians",
    "DifferentiableChoice",
    "DifferentiableField",
    "DifferentiableSurrogate",
    "EmulatedMember",
    "FieldModel",
    "MeanMember",
    "MemberModel",
    "Surrogate",
    "look_at",
]
