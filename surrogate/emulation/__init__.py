"""Emulators: an ensemble's fields at any parameters, from its members' fields."""

from surrogate.emulation.emulator import FieldEmulator
from surrogate.emulation.field import EmulatedField

__all__ = ["EmulatedField", "FieldEmulator"]
