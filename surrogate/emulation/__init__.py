"""Emulators: an ensemble's fields at any parameters, from its members' fields."""

from surrogate.emulation.emulator import FieldEmulator
from surrogate.emulation.field import EmulatedField
from surrogate.emulation.fields import EmulatedFields

__all__ = ["EmulatedField", "EmulatedFields", "FieldEmulator"]
