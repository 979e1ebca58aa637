"""A trained surrogate: Gaussians and their deformation, ready to be looked at from anywhere at any parameters."""

from surrogate.model.deformed import DeformedGaussians
from surrogate.model.differentiable import DifferentiableSurrogate
from surrogate.model.rigid import look_at
from surrogate.model.surrogate import Surrogate

__all__ = ["DeformedGaussians", "DifferentiableSurrogate", "Surrogate", "look_at"]
